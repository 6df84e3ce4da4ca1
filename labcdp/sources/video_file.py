"""Video files that OpenCV opens, as frames of grey DN."""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property
from math import isfinite
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..frame import Frame
from .picture import PictureOptions, frame_of_pixels
from .told_options import unused_options
from .video import Entry, require_frames
from .video_pixels import Pixels, grey_pixels, look, text_of_code
from .video_timeline import Timeline

_log = logging.getLogger(__name__)

#: Failures in a row after which a file counts as ended, if its packets do not say.
_MOST_FAILURES = 64
#: Frames that are looked at to learn what the numbers are.
_LOOKED_AT = 3
#: Where the last line of FFmpeg's messages would go to the terminal; -8 is none.
_FFMPEG_MESSAGES = ("OPENCV_FFMPEG_LOGLEVEL", "-8")


@dataclass(frozen=True, eq=False)
class VideoFile:
    """A video file; made by `open_video_file`.

    Parameters
    ----------
    path : Path
        The file.
    shape : (int, int)
        Height and width of its frames.
    frame_count : int or None
        As the file announces it.
    frame_rate : float or None
        As the file announces it.
    pixels : {'luma', 'limited luma', 'colours'}
        What is taken of a frame: its grey or Y' values as they are stored, these stretched from 16..235 to 0..255, or
        the grey of red, green and blue.
    motion_jpeg : bool
        Whether its packets are JPEG images.
    options : PictureOptions
        What the file does not say.
    modified : datetime
        Time of the file.
    notes, warnings : tuple of str
        What was done to the pixels, and what to mind.
    """

    path: Path
    shape: tuple[int, int]
    frame_count: int | None
    frame_rate: float | None
    pixels: Pixels
    motion_jpeg: bool
    options: PictureOptions
    modified: datetime
    notes: tuple[str, ...]
    warnings: tuple[str, ...]

    @cached_property
    def sha256(self) -> str:
        """Hash of its bytes."""
        return _hash(self.path)

    @property
    def exposure_stated(self) -> bool:
        """Never: no container says it."""
        return False

    def entries(self) -> Iterator[Entry]:
        """Go through all frames; one that cannot be decoded has a fault, and costs no other."""
        with _capture(self.path, self.pixels) as capture, _capture(self.path, "packets") as packets:
            clock = _Clock(Timeline(packets, self.motion_jpeg), self.frame_rate)
            failures = 0
            while True:
                if not capture.grab():
                    failures += 1
                    if clock.ended or failures > _MOST_FAILURES:
                        break
                    continue
                yield from clock.frame(_time_ms(capture), failures, self.shape, lambda: self._frame(capture, clock))
                failures = 0
            yield from clock.rest()

    def _frame(self, capture: Any, clock: _Clock) -> Frame:
        return self._of(_retrieved(capture), clock.number - 1)

    def _of(self, pixels: NDArray[Any], number: int) -> Frame:
        dn = grey_pixels(pixels, self.pixels)
        if dn.dtype != np.uint8:
            return frame_of_pixels(dn, self.options, self.modified, number)
        # Nobody else knows the pixels: they need not be copied.
        dn.flags.writeable = False
        return replace(self._example, dn=dn, frame_id=number)

    @cached_property
    def _example(self) -> Frame:
        """A frame of 8 bits."""
        return frame_of_pixels(np.zeros((1, 1), np.uint8), self.options, self.modified)


def open_video_file(path: Path, options: PictureOptions) -> VideoFile:
    """Open a video file.

    Luma (Y') is taken as it is stored: grey pictures hold nothing else, and nothing is lost to a way over red, green
    and blue. Its limited range is stretched to 0..255, rounded, as every player does. Of 16-bit grey (FFV1) all bits
    are kept.

    Parameters
    ----------
    path : Path
        The file.
    options : PictureOptions
        What it does not say: exposure, gain, camera, and bits of 16-bit values.

    Raises
    ------
    InputError
        If it cannot be read, is empty, no video, or holds no frame that can be decoded.
    """
    import cv2

    _require_file(path)
    with _capture(path, "colours") as capture:
        count, rate = capture.get(cv2.CAP_PROP_FRAME_COUNT), capture.get(cv2.CAP_PROP_FPS)
        tag = int(capture.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT)) & 0xFFFFFFFF
        codec = int(capture.get(cv2.CAP_PROP_FOURCC)) & 0xFFFFFFFF
        height, width = (int(capture.get(p)) for p in (cv2.CAP_PROP_FRAME_HEIGHT, cv2.CAP_PROP_FRAME_WIDTH))
        if height * width > options.max_pixels:
            raise InputError(
                f"{path} has frames of {width} x {height} pixels, more than {options.max_pixels / 1e6:g} megapixels: "
                "raise the limit if they are so large"
            )
        colours = _first(capture)
    require_frames(bool(colours), path)
    with _capture(path, "luma") as capture:
        stored = _first(capture)
    motion_jpeg = text_of_code(codec).upper() in ("MJPG", "JPEG")
    seen = look(colours, stored, tag, motion_jpeg)
    found = VideoFile(
        path=path,
        shape=(colours[0].shape[0], colours[0].shape[1]),
        frame_count=int(count) if isfinite(count) and count > 0 else None,
        frame_rate=rate if isfinite(rate) and rate > 0 else None,
        pixels=seen.pixels,
        motion_jpeg=motion_jpeg,
        options=options,
        modified=datetime.fromtimestamp(path.stat().st_mtime, UTC),
        notes=tuple(seen.notes),
        warnings=tuple(seen.warnings),
    )
    # Options that do not fit fail at once, and not once for each frame.
    frame = found._of(colours[0] if seen.pixels == "colours" else stored[0], 0)
    return replace(found, warnings=(*found.warnings, *unused_options(frame, frame.bit_depth, options)))


class _Clock:
    """Number and time of each decoded frame.

    Parameters
    ----------
    timeline : Timeline
        Time stamps of the packets.
    frame_rate : float or None
        For files without time stamps.
    """

    def __init__(self, timeline: Timeline, frame_rate: float | None) -> None:
        self.number = 0
        self.ended = False
        self._timeline: Timeline | None = timeline
        self._period_s = 1 / frame_rate if frame_rate else 0.0
        self._last_ms = -1.0
        self._stamped = True
        self._damaged = False

    def frame(self, time_ms: float, failures: int, shape: tuple[int, int], load: Any) -> Iterator[Entry]:
        """Return the entry of a frame, after those of the frames that were lost before it."""
        lost: list[float] | None = None
        self._stamped = self._stamped and time_ms > self._last_ms
        size = None
        if self._timeline is not None and self._stamped:
            lost = self._timeline.lost_before(time_ms)
            size = self._timeline.size
            # What the decoder makes of a frame that builds on a lost one looks whole and is not.
            self._damaged = (self._damaged or bool(lost)) and not self._timeline.key
        if lost is None:
            # The packets do not tell: each failure of the decoder counts as one frame.
            self._timeline = None
            step = (time_ms - self._last_ms) / (failures + 1)
            lost = [self._last_ms + step * (n + 1) for n in range(failures)]
        for one in lost:
            yield self._entry(one, "broken: it cannot be decoded", load)
        self._last_ms = time_ms
        fault = "builds on a broken frame before it" if self._damaged else ""
        if size is not None and size != shape:
            fault = f"has {size[1]} x {size[0]} pixels, the video has {shape[1]} x {shape[0]}"
        yield self._entry(time_ms, fault, load)

    def rest(self) -> Iterator[Entry]:
        """Entries of the frames that were lost at the end."""
        if self._timeline is not None and self._stamped:
            for time_ms in self._timeline.rest():
                yield self._entry(time_ms, "broken: it cannot be decoded", _nothing)

    def _entry(self, time_ms: float, fault: str, load: Any) -> Entry:
        time_s = time_ms / 1000 if self._stamped else self.number * self._period_s
        entry = Entry(self.number, time_s, fault, load)
        self.number += 1
        return entry


def _nothing() -> Frame:
    raise InputError("it cannot be decoded")


def _first(capture: Any) -> list[NDArray[Any]]:
    """First frames that can be decoded."""
    found: list[NDArray[Any]] = []
    failures = 0
    while len(found) < _LOOKED_AT and failures <= _MOST_FAILURES:
        if capture.grab():
            found.append(_retrieved(capture))
            failures = 0
        else:
            failures += 1
    return found


def _retrieved(capture: Any) -> NDArray[Any]:
    done, pixels = capture.retrieve()
    if not done or pixels is None or pixels.size == 0:
        raise InputError("it cannot be decoded")
    return np.asarray(pixels)


def _time_ms(capture: Any) -> float:
    import cv2

    return float(capture.get(cv2.CAP_PROP_POS_MSEC))


@contextmanager
def _capture(path: Path, what: Literal["packets"] | Pixels) -> Iterator[Any]:
    """Open a file for its packets, for what is stored, or for colours."""
    import cv2

    # What goes wrong is reported as a fault of its frame; that planes beside the first are left out is asked for.
    os.environ.setdefault(*_FFMPEG_MESSAGES)
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    try:
        if not capture.isOpened():
            raise InputError(
                f"{path} is no video that OpenCV opens, or is cut off: copy it again, or convert it to FFV1 or MJPEG"
            )
        if what == "packets":
            capture.set(cv2.CAP_PROP_FORMAT, -1)
        elif what != "colours":
            capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
        yield capture
    finally:
        capture.release()


def _require_file(path: Path) -> None:
    try:
        if not path.is_file():
            raise InputError(f"{path} is no file: give a video, a folder of images, or a recorded session")
        if path.stat().st_size == 0:
            raise InputError(f"{path} is empty: copy it again from the camera")
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): give a file you can read") from error


def _hash(path: Path) -> str:
    """SHA-256 of a file, in pieces: a video may be larger than the memory."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): give a file you can read") from error
