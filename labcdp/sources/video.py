"""Videos as frames: files that OpenCV opens, numbered images, recorded sessions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, LabcdpError
from ..frame import Frame
from .picture import PictureOptions
from .video_selection import Chooser, Selection

#: Endings of the names of video files in a folder; a file that is given itself may have any.
VIDEO_SUFFIXES = (
    ".3gp", ".avi", ".flv", ".h264", ".h265", ".hevc", ".m2ts", ".m4v", ".mjpeg", ".mjpg", ".mkv", ".mov", ".mp4",
    ".mpeg", ".mpg", ".mts", ".ogv", ".ts", ".webm", ".wmv",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Entry:
    """A frame of a video whose pixels have not been asked for.

    Parameters
    ----------
    number : int
        Number of the frame in the video, from 0; lost ones count.
    time_s : float
        Time since the first frame.
    fault : str
        Why there are no pixels; empty if there are.
    load : function without arguments
        Return the frame; to be called before the next entry is taken. Raises InputError if it is broken.
    """

    number: int
    time_s: float
    fault: str
    load: Callable[[], Frame]


@dataclass(frozen=True, eq=False)
class VideoFrame:
    """A frame of a video.

    Parameters
    ----------
    number : int
        Number of the frame in the video, from 0; lost ones count.
    time_s : float
        Time since the first frame, by the container's time stamps.
    chosen : bool
        Whether the selection takes it; others are there for a tracker that follows from frame to frame.
    frame : Frame or None
        The pixels; None if they are lost or were not asked for.
    fault : str
        Why they are lost, else empty.
    """

    number: int
    time_s: float
    chosen: bool
    frame: Frame | None
    fault: str

    @cached_property
    def grey(self) -> NDArray[np.uint8]:
        """The frame in 8 bits, for trackers and eyes; shape (height, width)."""
        assert self.frame is not None
        return grey_of(self.frame)


class VideoSource(Protocol):
    """A video; each iteration begins at its first frame."""

    @property
    def path(self) -> Path:
        """File or folder."""

    @property
    def sha256(self) -> str:
        """Hash of all that decides the pixels."""

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the frames in pixels."""

    @property
    def frame_count(self) -> int | None:
        """Number of frames as the file announces it, which may be wrong; None if it does not."""

    @property
    def frame_rate(self) -> float | None:
        """Frames per second as the file announces it, or None."""

    @property
    def exposure_stated(self) -> bool:
        """Whether the frames say their exposure themselves."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What was done to the pixels."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to mind."""

    def entries(self) -> Iterator[Entry]:
        """Go through all frames."""


def open_video(path: str | PathLike[str], options: PictureOptions | None = None) -> VideoSource:
    """Open a video.

    Parameters
    ----------
    path : path
        A file that OpenCV opens, a folder of numbered images, or the folder of a recorded session.
    options : PictureOptions or None
        What the video does not say, such as exposure and camera.

    Raises
    ------
    InputError
        If there is no video at `path`, or nothing of it can be read.
    SessionError
        If it is a session that was altered.
    """
    path, options = Path(path), options or PictureOptions()
    if path.is_dir():
        from ..session.journal_text import JOURNAL

        if (path / JOURNAL).is_file():
            from .video_session import open_session_video

            return open_session_video(path, options)
        from .video_sequence import open_sequence

        return open_sequence(path, options)
    from .video_file import open_video_file

    return open_video_file(path, options)


def video_paths(paths: Sequence[str | PathLike[str]]) -> list[Path]:
    """Videos to evaluate: those given, and of a folder of video files these, by name.

    A folder that holds no video file is a video itself: images or a session.

    Raises
    ------
    InputError
        If a folder cannot be read.
    """
    found: list[Path] = []
    for path in map(Path, paths):
        try:
            files = (
                sorted(one for one in path.iterdir() if one.suffix.lower() in VIDEO_SUFFIXES) if path.is_dir() else []
            )
        except OSError as error:
            raise InputError(f"{path} cannot be read ({error.strerror}): give a folder you can read") from error
        found += files or [path]
    return found


def left_out(folder: Path) -> list[Path]:
    """Folders with images in a folder of video files: `video_paths` leaves them out."""
    from .picture_paths import STATED_SUFFIXES

    folders = sorted(one for one in folder.iterdir() if one.is_dir())
    return [one for one in folders if any(file.suffix.lower() in STATED_SUFFIXES for file in one.iterdir())]


def frames_of(
    source: VideoSource, selection: Selection, needed: Callable[[int, bool], bool] = lambda _number, chosen: chosen
) -> Iterator[VideoFrame]:
    """Frames of a video from the start of a selection to its end.

    Parameters
    ----------
    source : VideoSource
        The video.
    selection : Selection
        Which frames are chosen.
    needed : function of (int, bool)
        Whether the pixels of the frame of this number, chosen or not, are needed: others are not loaded, which saves
        most of the time.

    Yields
    ------
    VideoFrame
        Those that are chosen or needed, and those that are lost among them.
    """
    chooser = Chooser(selection)
    for entry in source.entries():
        if selection.ended(entry.number, entry.time_s):
            return
        if not chooser.started(entry.number, entry.time_s):
            continue
        chosen = chooser.takes(entry.number, entry.time_s)
        wanted = needed(entry.number, chosen)
        if wanted or chosen:
            frame, fault = _loaded(entry, source.shape) if wanted and not entry.fault else (None, entry.fault)
            yield VideoFrame(entry.number, entry.time_s, chosen, frame, fault)


def grey_of(frame: Frame) -> NDArray[np.uint8]:
    """Frame in 8 bits; the four pixels of a colour filter are averaged, so that its pattern does not show."""
    dn = frame.dn if frame.bit_depth <= 8 else (frame.dn >> (frame.bit_depth - 8)).astype(np.uint8)
    if frame.colour_filter is None:
        return dn.astype(np.uint8, copy=False)
    import cv2

    return np.asarray(cv2.blur(dn.astype(np.uint8), (2, 2)), dtype=np.uint8)


def _loaded(entry: Entry, shape: tuple[int, int]) -> tuple[Frame | None, str]:
    """Load a frame, or say why it cannot be used: one broken frame does not cost the others."""
    try:
        frame = entry.load()
    except LabcdpError as error:
        return None, f"broken: {error}"
    if frame.shape != shape:
        sizes = [f"{width} x {height}" for height, width in (frame.shape, shape)]
        return None, f"has {sizes[0]} pixels, the video has {sizes[1]}"
    return frame, ""


def require_frames(found: bool, path: Path) -> None:
    """Raise InputError if nothing of a video could be read."""
    if not found:
        raise InputError(f"{path} holds no frame that can be read: copy it again, or give another video")
