"""A frame as trackers see it: of full depth, and with the noise of 8 bits."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
