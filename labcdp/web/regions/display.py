"""Preparation of images for display: crop, reduce, convert to 8 bits."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import ceil
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

#: Percentiles of the values shown as black and white.
_BLACK, _WHITE = 0.1, 99.9
#: Number of values sampled for the percentiles.
_SAMPLE = 1_000_000
#: Largest ratio spanned by the logarithm, so that noise around zero does not dominate.
LARGEST_RATIO = 1e5

ScaleName = Literal["linear", "gamma", "logarithm"]
SCALES: tuple[ScaleName, ...] = ("linear", "gamma", "logarithm")


@dataclass(frozen=True)
class DisplayScale:
    """Mapping of values to grey levels.

    Parameters
    ----------
    name : {'linear', 'gamma', 'logarithm'}
        Shape; the exponent of the gamma is 1 / 2.2, which is about perceptually uniform.
    black, white : float
        Values shown as 0 and 255.
    ends_apart : bool
        Whether 0 and 255 are only for what is infinite, below and above; the finite values are 1 to 254.
    """

    name: ScaleName
    black: float
    white: float
    ends_apart: bool = False

    @classmethod
    def of(cls, values: NDArray[Any], name: ScaleName | None = None) -> DisplayScale:
        """Return a scale for an image: black and white by percentiles, the shape by their ratio unless given.

        Parameters
        ----------
        values : ndarray of int or float, shape (height, width)
            The image; non-finite values are ignored.
        name : {'linear', 'gamma', 'logarithm'} or None
            The shape; None for the logarithm if the values span more than two decades, else the gamma.
        """
        step = ceil((values.size / _SAMPLE) ** 0.5)
        sample = values[::step, ::step].astype(np.float64, copy=False).ravel()
        sample = sample[np.isfinite(sample)]
        if not sample.size:
            return cls(name or "gamma", 0.0, 1.0)
        black, white = (float(percentile) for percentile in np.percentile(sample, (_BLACK, _WHITE)))
        if not white > black:
            black, white = min(black, 0.0), max(white, black + 1)
        if name is None:
            name = "logarithm" if white > 100 * max(float(np.percentile(sample, 10)), 0.0) else "gamma"
        return cls(name, black, white)

    def to_8_bit(self, values: NDArray[Any]) -> NDArray[np.uint8]:
        """Return values as 0 (black) to 255 (white); what is no number is black."""
        if values.dtype in (np.uint8, np.uint16):
            return np.asarray(self._tones_of_dn[values])
        return self._tones(values)

    @cached_property
    def _tones_of_dn(self) -> NDArray[np.uint8]:
        return self._tones(np.arange(2**16))

    def _tones(self, values: NDArray[Any]) -> NDArray[np.uint8]:
        with np.errstate(invalid="ignore", over="ignore"):
            share = (values.astype(np.float32) - self.black) / (self.white - self.black)
        below, above = np.isneginf(share), np.isposinf(share)
        share = np.clip(np.nan_to_num(share, nan=0.0), 0, 1)
        if self.name == "gamma":
            share = share ** (1 / 2.2)
        elif self.name == "logarithm":
            ratio = self._ratio
            share = np.log1p(share * (ratio - 1)) / np.log(ratio)
        first, last = (1, 254) if self.ends_apart else (0, 255)
        tones: NDArray[np.uint8] = np.rint(first + share * (last - first)).astype(np.uint8)
        tones[below], tones[above] = 0, 255
        return tones

    @property
    def _ratio(self) -> float:
        """Ratio of the brightest to the darkest value resolved by the logarithm."""
        if self.black <= 0:
            return 1000.0
        return float(np.clip(self.white / self.black, 1.001, LARGEST_RATIO))


@dataclass(frozen=True, eq=False)
class Tile:
    """A part of an image prepared for display.

    Parameters
    ----------
    pixels : ndarray of uint8, shape (rows, columns)
        0 to 255.
    x, y, width, height : float
        Its position, in pixels of the image.
    """

    pixels: NDArray[np.uint8]
    x: float
    y: float
    width: float
    height: float


def tile(
    values: NDArray[Any], scale: DisplayScale, part: tuple[float, float, float, float], screen: tuple[int, int]
) -> Tile:
    """Crop a part of an image and reduce it to at most its number of pixels on the screen.

    Parameters
    ----------
    values : ndarray of int or float, shape (height, width)
        The image.
    scale : DisplayScale
        Mapping of values to grey levels.
    part : (float, float, float, float)
        Left, top, right and bottom of the part, in pixels; it may extend beyond the image.
    screen : (int, int)
        Width and height of the part on the screen, in pixels.

    Returns
    -------
    Tile
        Whole blocks of pixels, averaged before the scale is applied, as by a camera with larger pixels.
    """
    height, width = values.shape
    left, top, right, bottom = part
    n = max(1, ceil(max((right - left) / max(screen[0], 1), (bottom - top) / max(screen[1], 1)) - 1e-9))
    # Blocks begin at multiples of their size, so that panning does not change them.
    x0, y0 = (max(0, int(edge // n) * n) for edge in (left, top))
    x1, y1 = (min(length, ceil(edge / n) * n) for edge, length in ((right, width), (bottom, height)))
    x0, y0 = min(x0, width - 1), min(y0, height - 1)
    x1, y1 = max(x1, x0 + 1), max(y1, y0 + 1)
    pixels = scale.to_8_bit(block_means(values[y0:y1, x0:x1], n))
    # The last blocks may extend beyond the image.
    return Tile(pixels, float(x0), float(y0), float(n * pixels.shape[1]), float(n * pixels.shape[0]))


def any_in_blocks(flags: NDArray[np.bool_], n: int) -> NDArray[np.bool_]:
    """Return whether any pixel of each block of n x n is flagged; the last blocks may be incomplete."""
    height, width = flags.shape
    if height % n or width % n:
        flags = np.pad(flags, ((0, -height % n), (0, -width % n)))
    # Rows first, which are contiguous: ten times as fast as both at once.
    rows = np.logical_or.reduce(flags.reshape(-1, n, flags.shape[1]), axis=1)
    return np.asarray(rows.reshape(len(rows), -1, n).any(axis=2))


def block_means(values: NDArray[Any], n: int) -> NDArray[Any]:
    """Return the mean of each block of n x n values; the last blocks may be incomplete."""
    if n == 1:
        return values
    import cv2

    size = ceil(values.shape[1] / n), ceil(values.shape[0] / n)
    if (size[0] * n, size[1] * n) != values.shape[::-1]:
        # The last blocks may be incomplete: the edge is repeated.
        values = np.pad(values, ((0, size[1] * n - values.shape[0]), (0, size[0] * n - values.shape[1])), mode="edge")
    with_type = values if values.dtype in (np.uint8, np.uint16, np.float32) else values.astype(np.float32)
    return np.asarray(cv2.resize(np.ascontiguousarray(with_type), size, interpolation=cv2.INTER_AREA))
