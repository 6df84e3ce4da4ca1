"""Superpixels: an image cut into connected regions of about one size whose borders follow the edges of the scene."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError

#: Smallest side of a superpixel: fewer pixels than this squared are no region to measure.
SMALLEST_SIZE_PX = 6

#: Standard deviation, in pixels, of the Gaussian the image is smoothed with before it is cut.
_SMOOTHING_PX = 1.5

#: The logarithm becomes linear below this many standard deviations of a dark pixel's noise.
_FLOOR_SIGMAS = 3.0

#: The floor is at least this part of the brightest values, for images without noise.
_LEAST_FLOOR = 1e-6

#: Light is clipped at this many floors.
_LARGEST_RATIO = np.float32(1e12)

#: Step of the logarithm that weighs as much as the distance from a superpixel's middle to the next: that of a contrast
#: of 10 %, or so many standard deviations of the smoothed noise if that is more.
_LEAST_STEP, _STEP_SIGMAS = 0.1, 3.0

#: Side of the blocks in which noise is estimated.
_BLOCK_PX = 32

_ITERATIONS = 10

#: A superpixel is a strip if less than this share of it is further from its border than this part of the size.
_STRIP_SHARE, _STRIP_MARGIN = 0.25, 1 / 12

#: A piece smaller than this percentage of a superpixel joins a neighbour.
_LEAST_PIECE_PERCENT = 25


@dataclass(frozen=True, eq=False)
class Neighbours:
    """Pairs of neighbouring labels, and the sides of pixels that lie between them.

    Parameters
    ----------
    pairs : ndarray of int32, shape (n, 2)
        The two labels, the smaller one first; rows in rising order.
    border_px : ndarray of int64, shape (n,)
        Length of the common border: number of its sides.
    sides_px : ndarray of float32, shape (m, 2)
        Middle (x, y) of each side of a pixel between two labels; the upper left corner of the image is (0, 0).
    sides_pair : ndarray of int64, shape (m,)
        Row of `pairs` that each side belongs to.
    """

    pairs: NDArray[np.int32]
    border_px: NDArray[np.int64]
    sides_px: NDArray[np.float32]
    sides_pair: NDArray[np.int64]

    @property
    def middle_px(self) -> NDArray[np.float64]:
        """Middle (x, y) of the side that is closest to the mean of all sides of a pair, shape (n, 2).

        The mean itself lies inside what a border surrounds.
        """
        sums = [np.bincount(self.sides_pair, weights=self.sides_px[:, i]) for i in (0, 1)]
        mean = np.stack(sums, axis=1) / self.border_px[:, None]
        distance = np.square(self.sides_px - mean[self.sides_pair]).sum(axis=1)
        order = np.lexsort((distance, self.sides_pair))
        middle: NDArray[np.float64] = self.sides_px[order[np.cumsum(self.border_px) - self.border_px]].astype(
            np.float64
        )
        return middle


def superpixel_labels(image: NDArray[Any], size_px: int, *, half: bool = False) -> NDArray[np.int32]:
    """Cut an image into superpixels.

    Parameters
    ----------
    image : ndarray of int or float, shape (height, width)
        Linear light: cd/m^2, or DN above black. Pixels that are not finite count as the nearest finite extreme.
    size_px : int
        Side of a superpixel: they have about `size_px` squared pixels each.
    half : bool
        Whether to look only at the pixels that `seen_half` marks, as on the white squares of a chessboard. The others
        then know nothing of how their noise would have moved the borders, and can be measured without that bias.

    Returns
    -------
    ndarray of int32, shape (height, width)
        Labels 0, 1, ... n - 1; the pixels of each are connected along rows and columns. Equal images give equal labels.

    Raises
    ------
    InputError
        If the image is not of two dimensions or not of numbers, is smaller than a superpixel, or the size is below 6.

    Notes
    -----
    SLIC (R. Achanta et al., SLIC superpixels compared to state-of-the-art superpixel methods, IEEE Trans. PAMI 34,
    2012), in the program of OpenCV's ximgproc, on asinh(L / 2 L0) smoothed by a Gaussian: the logarithm of the light,
    in which a step is a contrast however bright it is, that below L0 = 3 standard deviations of the noise in the
    darkest parts turns into a straight line, so that noise in darkness makes no steps. The compactness is chosen by the
    noise: what is only noise is cut into squares. At a strong edge that the lens has blurred SLIC makes strips
    of what lies between the two sides; they are divided among their neighbours.

    At a step of 30 % in noise, the share of pixels cut off wrongly along it amounts to 0.1 pixel rows at a
    contrast-to-noise ratio of 2, to 0.4 at 1 and to 1 at 0.5 (`size_px` 40).
    """
    from cv2 import ximgproc

    light = _finite_light(image)
    height, width = light.shape
    if size_px < SMALLEST_SIZE_PX:
        raise InputError(f"superpixels of {size_px} pixels are too small to measure: give {SMALLEST_SIZE_PX} or more")
    if size_px > min(height, width):
        raise InputError(
            f"superpixels of {size_px} pixels are larger than the image ({width} x {height}): give a smaller size"
        )
    tones, step = _tones(light, half)
    slic = ximgproc.createSuperpixelSLIC(tones, ximgproc.SLIC, int(size_px), step)
    slic.iterate(_ITERATIONS)
    slic.enforceLabelConnectivity(_LEAST_PIECE_PERCENT)
    return _without_strips(np.asarray(slic.getLabels(), dtype=np.int32), size_px)


def seen_half(shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Mask of the half of an image of `shape` (height, width) that superpixels of a half are found with."""
    mask = np.zeros(shape, dtype=np.bool_)
    mask[::2, ::2] = mask[1::2, 1::2] = True
    return mask


def neighbours(labels: NDArray[np.int32]) -> Neighbours:
    """Find which labels share a border along rows or columns, and how long it is.

    Parameters
    ----------
    labels : ndarray of int, shape (height, width)
        Labels of 0 or more.

    Returns
    -------
    Neighbours
    """
    n = int(labels.max()) + 1
    keys, places = [], []
    for first, second, shift in ((labels[:, :-1], labels[:, 1:], (1.0, 0.5)), (labels[:-1], labels[1:], (0.5, 1.0))):
        rows, columns = np.nonzero(first != second)
        a, b = first[rows, columns].astype(np.int64), second[rows, columns].astype(np.int64)
        keys.append(np.minimum(a, b) * n + np.maximum(a, b))
        places.append(np.stack([columns + shift[0], rows + shift[1]], axis=1).astype(np.float32))
    pair_keys, sides_pair, lengths = np.unique(np.concatenate(keys), return_inverse=True, return_counts=True)
    return Neighbours(
        pairs=np.stack([pair_keys // n, pair_keys % n], axis=1).astype(np.int32),
        border_px=lengths.astype(np.int64),
        sides_px=np.concatenate(places),
        sides_pair=sides_pair.astype(np.int64),
    )


def inner(labels: NDArray[np.int32], margin_px: int) -> NDArray[np.bool_]:
    """Mask of the pixels with no other label within `margin_px` along rows, columns and diagonals."""
    import cv2

    # Morphology takes no int32; float32 holds all integers up to 2^24, more than there are superpixels.
    as_float = labels.astype(np.float32)
    around = np.ones((2 * margin_px + 1, 2 * margin_px + 1), dtype=np.uint8)
    return np.asarray(np.equal(cv2.dilate(as_float, around), cv2.erode(as_float, around)))


def _without_strips(labels: NDArray[np.int32], size_px: int) -> NDArray[np.int32]:
    """Divide strips among their neighbours: each pixel takes the label that reaches it first along rows and columns."""
    n = int(labels.max()) + 1
    inside = np.bincount(labels[inner(labels, max(round(_STRIP_MARGIN * size_px), 1))], minlength=n)
    kept = inside >= _STRIP_SHARE * np.bincount(labels.ravel(), minlength=n)
    if not kept.any():
        return labels
    # Counted anew, with -1 for what is to be divided and for a frame around the image.
    numbers = np.where(kept, np.cumsum(kept) - 1, -1).astype(np.int32)
    grown = np.pad(numbers[labels], 1, constant_values=-1)
    rows, columns = np.nonzero(grown[1:-1, 1:-1] < 0)
    rows, columns = rows + 1, columns + 1
    while rows.size:
        label = np.full(rows.size, -1, dtype=np.int32)
        for dy, dx in ((-1, 0), (0, -1), (0, 1), (1, 0)):
            near = grown[rows + dy, columns + dx]
            label = np.where(label < 0, near, label)
        grown[rows, columns] = label
        rows, columns = rows[label < 0], columns[label < 0]
    return np.ascontiguousarray(grown[1:-1, 1:-1])


def _finite_light(image: NDArray[Any]) -> NDArray[np.float32]:
    if image.ndim != 2 or image.dtype.kind not in "iuf":
        raise InputError(f"an image has 2 dimensions and numbers, got {image.dtype} of shape {image.shape}")
    light = image.astype(np.float32)
    finite = np.isfinite(light)
    if finite.all():
        return light
    if not finite.any():
        raise InputError("no pixel of the image is finite: check the conversion")
    low, high = float(light[finite].min()), float(light[finite].max())
    return np.nan_to_num(light, copy=False, nan=low, neginf=low, posinf=high)


def _tones(light: NDArray[np.float32], half: bool) -> tuple[NDArray[np.float32], float]:
    """Smoothed logarithm of the light, and the step in it that weighs as much as a superpixel's size."""
    import cv2

    noise, level = _noise_by_block(light)
    least = _LEAST_FLOOR * float(np.quantile(light[::4, ::4], 0.999))
    floor = max(_FLOOR_SIGMAS * float(np.quantile(noise, 0.05)), least, float(np.finfo(np.float32).tiny))
    with np.errstate(over="ignore"):
        tones = np.arcsinh(np.clip(light / np.float32(2 * floor), -_LARGEST_RATIO, _LARGEST_RATIO))
    if half:
        # The Gaussian has half of its weight on each half, to ten digits; the border of OpenCV keeps the chessboard.
        tones *= 2 * seen_half((light.shape[0], light.shape[1]))
    smooth: NDArray[np.float32] = cv2.GaussianBlur(tones, (0, 0), _SMOOTHING_PX, borderType=cv2.BORDER_REFLECT_101)
    # Derivative of the tones, and what smoothing leaves of independent noise: 1 / sqrt(4 pi s^2).
    steepness = 1 / np.hypot(level, 2 * floor)
    left = sqrt(2 if half else 1) / sqrt(4 * pi * _SMOOTHING_PX**2)
    typical = float(np.quantile(noise * steepness * left, 0.75))
    return smooth, max(_LEAST_STEP, _STEP_SIGMAS * typical)


def _noise_by_block(light: NDArray[np.float32]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Estimate noise and mean for blocks of the image, from pixels that `seen_half` marks alone.

    The noise is seen through the mask of J. Immerkaer (Fast noise variance estimation, Comput. Vis. Image Underst. 64,
    1996), which plane light does not pass, turned by 45 degrees so that it stays on one half of the pixels; and by the
    median, which few edges do not move.
    """
    import cv2

    mask = np.zeros((5, 5), dtype=np.float32)
    mask[2, 2] = 4
    mask[1::2, 1::2] = -2
    mask[::4, 2] = mask[2, ::4] = 1
    rest = np.abs(cv2.filter2D(light, -1, mask / 6))[::2, ::2]
    height, width = rest.shape
    down, across = min(height, _BLOCK_PX // 2), min(width, _BLOCK_PX // 2)
    rows, columns = height // down, width // across

    def blocks(values: NDArray[np.float32]) -> NDArray[np.float32]:
        cut = values[: rows * down, : columns * across].reshape(rows, down, columns, across)
        return cut.swapaxes(1, 2).reshape(rows * columns, down * across)

    # The median of the size of normal noise is 0.6745 standard deviations.
    noise: NDArray[np.float64] = np.median(blocks(rest), axis=1).astype(np.float64) / 0.6745
    return noise, blocks(light[::2, ::2]).mean(axis=1, dtype=np.float64)
