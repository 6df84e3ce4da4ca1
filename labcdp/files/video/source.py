"""What a video is, whatever it is read from."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache, cached_property
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError, LabcdpError
from ...core.frame import Frame, Readout
from ...core.luminance import Window
from ...core.result import Finding, warning
from ...core.vignetting import Lens
from ..doubts import CERTAIN, Doubts
from ..transfer import Encoding
from .selection import TIME_TOLERANCE_S, Selection


@dataclass(frozen=True, eq=False)
class StoredPixels:
    """Pixels of a frame as they are stored.

    Parameters
    ----------
    planes : tuple of ndarray
        All numbers that decide them.
    followed : ndarray of uint8 or uint16, shape (height, width)
        What trackers look at.
    levels : (float, float, float)
        What the DN of that are, as `labcdp.tracking.make_tracker` takes it.
    whole : callable
        Makes the frame.
    part : callable or None
        Makes a frame of some rows and columns only, in less time; None if the whole one is there.
    colours : callable or None
        Makes linear red, green and blue of some rows and columns, and which of their pixels are saturated; None of
        grey.
    """

    planes: tuple[NDArray[Any], ...]
    followed: NDArray[Any]
    levels: tuple[float, float, float]
    whole: Callable[[], Frame]
    part: Callable[[Window], Frame] | None = None
    colours: Callable[[Window], tuple[NDArray[np.float32], NDArray[np.bool_]]] | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        return self.followed.shape[0], self.followed.shape[1]

    @cached_property
    def frame(self) -> Frame:
        """The frame."""
        return self.whole()

    def same_as(self, other: StoredPixels) -> bool:
        """Whether all numbers are the same."""
        pairs = list(zip(self.planes, other.planes, strict=True))
        # A few rows suffice to distinguish them.
        return all(np.array_equal(a[::64], b[::64]) and np.array_equal(a, b) for a, b in pairs)


def stored_pixels(frame: Frame) -> StoredPixels:
    """Pixels of a frame that is there; trackers do not see the pattern of a colour filter."""
    followed = frame.dn
    if frame.colour_filter is not None:
        import cv2

        followed = np.asarray(cv2.blur(frame.dn, (2, 2)))
    return StoredPixels((frame.dn,), followed, (0.0, nan, 0.0), lambda: frame)


@dataclass(frozen=True, eq=False)
class VideoFrame:
    """A frame of a video.

    Parameters
    ----------
    number : int
        Number of the frame in the video, from 0; lost ones count.
    time_s : float
        Time since the first frame, by the container's time stamps.
    fault : Finding or None
        Why there are no pixels; None if there are.
    load : function without arguments
        Give the pixels; to be called before the next frame is taken. Raises InputError if they are broken.
    note : Finding or None
        What is wrong with pixels that are used all the same.
    chosen : bool
        Whether the selection takes it; others are there for a tracker that follows from frame to frame.
    pixels : StoredPixels or None
        The pixels; None if they are lost or were not loaded.
    """

    number: int
    time_s: float
    fault: Finding | None
    load: Callable[[], StoredPixels]
    note: Finding | None = None
    chosen: bool = False
    pixels: StoredPixels | None = None

    @property
    def frame(self) -> Frame | None:
        """The whole frame; None if its pixels are lost or were not loaded."""
        return None if self.pixels is None else self.pixels.frame

    @cached_property
    def grey(self) -> NDArray[np.uint8]:
        """The frame in 8 bits, for eyes; shape (height, width)."""
        assert self.frame is not None
        return grey_of(self.frame)


@dataclass(frozen=True, eq=False)
class VideoSource:
    """A video, whatever it is read from; readers make subclasses of it.

    Parameters
    ----------
    path : Path
        File or folder.
    shape : (int, int)
        Height and width of the frames in pixels.
    frame_count : int or None
        Number of frames as the file announces it, which may be wrong, or an estimate; None if it is not known.
    frame_rate : float or None
        Frames per second as the file announces it, or None.
    exposure_stated : bool
        Whether the frames say their exposure themselves.
    encoding : {'linear', 'srgb', 'bt709'}
        How the DN of the frames are encoded.
    findings : tuple of Finding
        What was done to the pixels, and what a user should know about them.
    is_estimate : bool
        Whether the number of frames follows from a length: it is wrong where they follow each other irregularly.
    length_s : float or None
        Time from the first frame to the end, of files that announce that and no number of frames; else None.
    readout : Readout or None
        Which part of the sensor the first frame shows; None if unknown.
    lens : Lens or None
        The lens, where it is stated; else None.
    doubts : Doubts
        What is doubtful about the values of the first frame.
    """

    path: Path
    shape: tuple[int, int]
    frame_count: int | None
    frame_rate: float | None
    exposure_stated: bool
    encoding: Encoding
    findings: tuple[Finding, ...]
    is_estimate: bool = False
    length_s: float | None = None
    readout: Readout | None = None
    lens: Lens | None = None
    doubts: Doubts = CERTAIN

    def entries(self) -> Iterator[VideoFrame]:
        """Go through all frames, none of them loaded; each time from the first one on."""
        raise NotImplementedError

    @property
    def sha256(self) -> str:
        """Hash of all that decides the pixels."""
        raise NotImplementedError


def grey_of(frame: Frame) -> NDArray[np.uint8]:
    """Frame in 8 bits; the four pixels of a colour filter are averaged, so that its pattern does not show."""
    if frame.clipped is not None:
        # Of colours: linear light, whose root is close to the values that are stored.
        return np.asarray(_roots()[frame.dn], dtype=np.uint8)
    dn = frame.dn if frame.bit_depth <= 8 else (frame.dn >> (frame.bit_depth - 8)).astype(np.uint8)
    if frame.colour_filter is None:
        return dn.astype(np.uint8, copy=False)
    import cv2

    return np.asarray(cv2.blur(dn.astype(np.uint8), (2, 2)), dtype=np.uint8)


@cache
def _roots() -> NDArray[np.uint8]:
    return np.asarray(np.rint(255 * np.sqrt(np.arange(2**16) / (2**16 - 1))).astype(np.uint8))


def require_frames(any_frame: bool, path: Path) -> None:
    """Raise InputError if nothing of a video could be read."""
    if not any_frame:
        raise InputError(
            f"{path} holds no frame that can be read: if another program shows it, convert it to FFV1 or MJPEG"
        )


def size_differs(shape: tuple[int, int], expected: tuple[int, int]) -> Finding:
    """Return the fault of a frame whose height and width are not those of the video."""
    (height, width), (video_height, video_width) = shape, expected
    return warning("frame-size-differs", width=width, height=height, video_width=video_width, video_height=video_height)


def frames_of(
    source: VideoSource,
    selection: Selection,
    needed: Callable[[int, bool], bool] = lambda _number, chosen: chosen,
    entries: Iterable[VideoFrame] | None = None,
) -> Generator[VideoFrame, None, None]:
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
    entries : iterable of VideoFrame or None
        All its frames, none of them loaded; None for `VideoSource.entries`.

    Yields
    ------
    VideoFrame
        Those that are chosen or needed, and those that are lost among them.
    """
    for entry, chosen in _selected(source.entries() if entries is None else entries, selection):
        wanted = needed(entry.number, chosen)
        if wanted or chosen:
            pixels, fault = _loaded(entry, source.shape) if wanted and not entry.fault else (None, entry.fault)
            note = None if pixels is None else entry.note
            yield replace(entry, chosen=chosen, pixels=pixels, fault=fault, note=note)


def _selected(entries: Iterable[VideoFrame], selection: Selection) -> Iterator[tuple[VideoFrame, bool]]:
    """Frames from the start of a selection to its end, and whether each is chosen."""
    start, stop, every = selection.start, selection.stop, selection.every
    first_number, first_s, next_s = None, 0.0, 0.0
    for entry in entries:
        number, time_s = entry.number, entry.time_s
        if stop is not None and stop.reached(number, time_s):
            return
        if not start.reached(number, time_s):
            continue
        if first_number is None:
            # Numbers may begin later, as those of images do; of times, multiples are taken.
            first_number, first_s = number, time_s if start.seconds is None else start.seconds
            next_s = first_s
        if every.seconds is None:
            yield entry, (number - first_number) % (every.frames or 1) == 0
            continue
        chosen = time_s >= next_s - TIME_TOLERANCE_S
        if chosen:
            next_s = first_s + ((time_s + TIME_TOLERANCE_S - first_s) // every.seconds + 1) * every.seconds
        yield entry, chosen


def _loaded(entry: VideoFrame, shape: tuple[int, int]) -> tuple[StoredPixels | None, Finding | None]:
    """Load a frame, or say why it cannot be used: one broken frame does not cost the others."""
    try:
        pixels = entry.load()
    except LabcdpError as error:
        return None, warning("frame-broken", reason=str(error))
    if pixels.shape != shape:
        return None, size_differs(pixels.shape, shape)
    return pixels, None
