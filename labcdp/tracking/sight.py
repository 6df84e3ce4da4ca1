"""A frame as trackers see it: of full depth, and with the noise of 8 bits."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import ceil, dist, floor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .geometry import Matrix, box_of, moved, shift

#: Longest side of the frame made small.
_SMALL = 480
#: Least noise in DN: that of rounding.
_ROUNDING_DN = 0.3
#: Standard deviation of the noise that frames of more than 8 bits are scaled to, in DN.
_NOISE_DN = 3.2
#: Pixels of a frame along each side that its noise is estimated from.
_SAMPLE = 512


@dataclass(frozen=True, eq=False)
class Sight:
    """A frame.

    Parameters
    ----------
    frame : ndarray of uint8 or uint16, shape (height, width)
        Its DN.
    scale : float
        Factor on them.
    """

    frame: NDArray[Any]
    scale: float = 1.0

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        return self.frame.shape[0], self.frame.shape[1]

    def part(self, left: int, top: int, right: int, bottom: int) -> NDArray[np.float32]:
        """Pixels of a window."""
        return self._scaled(self.frame[top:bottom, left:right].astype(np.float32))

    def reduced(self, left: int, top: int, right: int, bottom: int, size: tuple[int, int]) -> NDArray[np.float32]:
        """Window in another size (width, height): averaged if smaller, else interpolated."""
        import cv2

        smaller = size[0] <= right - left and size[1] <= bottom - top
        how = cv2.INTER_AREA if smaller else cv2.INTER_LINEAR
        window = self.frame[top:bottom, left:right].astype(np.float32)
        return self._scaled(np.asarray(cv2.resize(window, size, interpolation=how), dtype=np.float32))

    @cached_property
    def small(self) -> NDArray[np.float32]:
        """Whole frame, at most `_SMALL` pixels long, averaged."""
        import cv2

        height, width = self.shape
        every = max(1, -(-max(height, width) // _SMALL))
        frame = self.frame[: height // every * every, : width // every * every]
        # OpenCV is many times as fast at halves.
        while every > 1:
            step = 2 if every % 2 == 0 else every
            frame = cv2.resize(frame, None, fx=1 / step, fy=1 / step, interpolation=cv2.INTER_AREA)
            every //= step
        return self._scaled(np.asarray(frame, dtype=np.float32))

    @property
    def reduction(self) -> float:
        """Pixels of `small` for each of the frame."""
        return 1 / max(1, -(-max(self.shape) // _SMALL))

    def _scaled(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        return values if self.scale == 1 else values * np.float32(self.scale)


def scale_of(frame: NDArray[Any]) -> float:
    """Factor that gives a frame of more than 8 bits the noise of one of 8 bits, estimated from its middle."""
    if frame.dtype == np.uint8:
        return 1.0
    top, left = (max(side - _SAMPLE, 0) // 2 for side in frame.shape)
    return _NOISE_DN / noise_dn(frame[top : top + _SAMPLE, left : left + _SAMPLE].astype(np.float32))


def smooth(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Image smoothed by 1 2 1 along both axes."""
    import cv2

    kernel = np.array([0.25, 0.5, 0.25], np.float32)
    return np.asarray(cv2.sepFilter2D(image, cv2.CV_32F, kernel, kernel))


def noise_dn(window: NDArray[np.float32]) -> float:
    """Estimate the standard deviation of the noise, at least that of rounding.

    Notes
    -----
    Median of the absolute answers of the mask (1 -2 1; -2 4 -2; 1 -2 1), which is blind to planes and edges along the
    axes (J. Immerkaer, Fast noise variance estimation, Comput. Vis. Image Underst. 64, 1996; the median instead of the
    mean lets structure count less).
    """
    z = window[2:] - 2 * window[1:-1] + window[:-2]
    answers = z[:, 2:] - 2 * z[:, 1:-1] + z[:, :-2]
    if answers.size == 0:
        return _ROUNDING_DN
    return max(float(np.median(np.abs(answers))) / 0.6745 / 6, _ROUNDING_DN)


#: Longest side of what is searched for, in pixels of the reduced frame, and of that frame.
_LONGEST, _FRAME_LONGEST = 24, 960
#: Least correlation of a place that is looked at.
_LEAST = 0.35
#: Sizes of the first look that are searched besides the last one's.
_SIZES = (0.87, 1.15)
#: Places of each look and size; distance of places from each other, in parts of its size.
_PLACES, _APART = 4, 0.3


@dataclass(frozen=True, eq=False)
class Look:
    """How a region looked in a frame.

    Parameters
    ----------
    pixels : ndarray of float32, shape (h, w)
        What lay under the box around it.
    corner : (int, int)
        Left and top end of the box in the frame.
    to_image : ndarray of float, shape (3, 3)
        Template pixels to pixels of that frame.
    """

    pixels: NDArray[np.float32]
    corner: tuple[int, int]
    to_image: Matrix


def look_at(sight: Sight, to_image: Matrix, patch: tuple[float, float, float, float]) -> Look | None:
    """Look of a region whose patch lies at `patch` (left, top, right, bottom) of the template; None if not in sight."""
    left, top, right, bottom = box_of(to_image @ shift(patch[0], patch[1]), patch[2] - patch[0], patch[3] - patch[1])
    height, width = sight.shape
    if not (left > -0.5 and top > -0.5 and right < width + 0.5 and bottom < height + 0.5):
        return None
    x, y = max(floor(left), 0), max(floor(top), 0)
    return Look(sight.part(x, y, min(ceil(right), width), min(ceil(bottom), height)), (x, y), to_image)


def candidates(sight: Sight, looks: list[tuple[Look, float]], most: int) -> list[Matrix]:
    """Up to `most` places where a region may be, template to frame pixels, best first.

    Parameters
    ----------
    looks : list of (Look, float)
        Looks, and the size that each is expected in, relative to its own.

    Notes
    -----
    Peaks of the correlation after removal of the mean, in the frame reduced until the look is small.
    """
    import cv2

    found: list[tuple[float, float, Matrix]] = []
    height, width = sight.shape
    pictures: dict[tuple[int, int], NDArray[np.float32]] = {}
    for look, expected in looks:
        longest = expected * max(look.pixels.shape)
        reduction = min(_LONGEST / longest, _FRAME_LONGEST / max(height, width), 1.0)
        shape = max(round(reduction * width), 1), max(round(reduction * height), 1)
        if shape not in pictures:
            pictures[shape] = _sized(sight, shape)
        picture = pictures[shape]
        for size in (1.0, *_SIZES):
            scale = expected * size
            across, down = (max(round(reduction * scale * side), 1) for side in look.pixels.shape[::-1])
            if across > shape[0] or down > shape[1] or min(across, down) < 3:
                continue
            how = cv2.INTER_AREA if reduction * scale < 1 else cv2.INTER_LINEAR
            pattern = cv2.resize(look.pixels, (across, down), interpolation=how)
            answers = np.nan_to_num(cv2.matchTemplate(picture, pattern, cv2.TM_CCOEFF_NORMED), nan=-1.0)
            for score, x, y in _peaks(answers, max(_APART * across, 2), max(_APART * down, 2)):
                placed = shift(x * width / shape[0], y * height / shape[1]) @ np.diag([scale, scale, 1.0])
                found.append((score, scale * longest, placed @ shift(-look.corner[0], -look.corner[1]) @ look.to_image))
    return _distinct(found, most)


def _sized(sight: Sight, shape: tuple[int, int]) -> NDArray[np.float32]:
    height, width = sight.shape
    return sight.reduced(0, 0, width, height, shape)


def _peaks(answers: NDArray[np.float32], across: float, down: float) -> list[tuple[float, float, float]]:
    """Highest answers that are apart from each other, with their places."""
    import cv2

    peaks = []
    answers = answers.copy()
    for _ in range(_PLACES):
        _, best, _, (x, y) = cv2.minMaxLoc(answers)
        if best < _LEAST:
            break
        peaks.append((best, float(x), float(y)))
        answers[max(y - ceil(down), 0) : y + ceil(down) + 1, max(x - ceil(across), 0) : x + ceil(across) + 1] = -1
    return peaks


def _distinct(found: list[tuple[float, float, Matrix]], most: int) -> list[Matrix]:
    """Keep the best of each place."""
    kept: list[tuple[tuple[float, float], Matrix]] = []
    for _, size, matrix in sorted(found, key=lambda item: -item[0]):
        middle = moved(matrix, 0, 0)
        if all(dist(middle, other) > _APART * size / 2 for other, _ in kept):
            kept.append((middle, matrix))
    return [matrix for _, matrix in kept[:most]]
