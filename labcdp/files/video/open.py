"""Videos as frames: files that FFmpeg reads, numbered images, recorded sessions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from os import PathLike
from pathlib import Path

from ...core.disk import open_regular, reading
from ...core.disk.files import SESSION_JOURNAL
from ...core.errors import InputError
from ..kinds import TIFF
from ..picture import PictureOptions
from .source import VideoSource

#: Endings of the names of video files in a folder; a file that is given itself may have any.
VIDEO_SUFFIXES = (
    ".3gp", ".avi", ".flv", ".h264", ".h265", ".hevc", ".m2ts", ".m4v", ".mjpeg", ".mjpg", ".mkv", ".mov", ".mp4",
    ".mpeg", ".mpg", ".mts", ".ogv", ".ts", ".webm", ".wmv",
)  # fmt: skip


def open_video(path: str | PathLike[str], options: PictureOptions | None = None) -> VideoSource:
    """Open a video.

    Parameters
    ----------
    path : path
        A file that FFmpeg reads, a TIFF of several pages, a folder of numbered images, or the folder of a recorded
        session.
    options : PictureOptions or None
        What the video does not say, such as exposure and camera.

    Raises
    ------
    InputError
        If there is no video at `path`, or nothing of it can be read.
    SessionError
        If it is a session that was altered.
    """
    from ..read import RAW_SUFFIXES
    from .file import open_video_file
    from .sequence import open_sequence, open_session_video, open_stack

    path, options = Path(path), options or PictureOptions()
    opened: Callable[[Path, PictureOptions], VideoSource]
    if path.is_dir():
        opened = open_session_video if (path / SESSION_JOURNAL).is_file() else open_sequence
    else:
        suffix = path.suffix.lower()
        is_stack = suffix in (".tif", ".tiff") or (suffix not in RAW_SUFFIXES and _begins_as_tiff(path))
        opened = open_stack if is_stack else open_video_file
    if options.frame_rate_hz is not None and opened not in (open_sequence, open_stack):
        raise InputError(f"{path} states the times of its frames: leave the frame rate out")
    return opened(path, options)


def _begins_as_tiff(path: Path) -> bool:
    with reading(path, "a video, a folder of images, or a recorded session"), open_regular(path) as file:
        return file.read(len(TIFF[0])) in TIFF


def video_paths(paths: Sequence[str | PathLike[str]]) -> list[Path]:
    """Videos to evaluate: those given, and of a folder of video files these, by name.

    A folder that holds no video file is a video itself: images or a session.

    Raises
    ------
    InputError
        If a folder cannot be read.
    """
    videos: list[Path] = []
    for path in map(Path, paths):
        with reading(path, "a folder you can read"):
            inside = sorted(path.iterdir()) if path.is_dir() else []
        videos += [file for file in inside if file.suffix.lower() in VIDEO_SUFFIXES] or [path]
    return videos


def left_out(folder: Path) -> list[Path]:
    """Folders with images in a folder of video files: `video_paths` leaves them out."""
    from ..read import STATED_SUFFIXES

    folders = sorted(entry for entry in folder.iterdir() if entry.is_dir())
    return [entry for entry in folders if any(file.suffix.lower() in STATED_SUFFIXES for file in entry.iterdir())]
