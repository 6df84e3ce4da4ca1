"""Non-uniformity of a region: from pixel to pixel, and slowly across it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.quantity import Quantity
from ...core.vignetting import AnyVignetting, Cos4Vignetting, FlatField, RadialVignetting
from .statistics import LineVariances

#: Mean squares and mean products of two quantities a and b: (aa, ab, bb).
MeanSquares = tuple[float, float, float]
Array = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Nonuniformity:
    """Mean squares of DN / V and 1 / V within and between the cells of a region.

    The non-uniformity of the light is that of (DN - d) / V. From both mean squares it follows for any dark signal d,
    which may be measured later.

    Parameters
    ----------
    within, between : (float, float, float)
        Mean squares within and between cells of DN / V, mean products of DN / V and 1 / V, mean squares of 1 / V.
    dof : int
        Degrees of freedom between the cells, their number minus 1.
    cell_pixels : float
        Effective number of pixels of a cell, n_0.
    """

    within: MeanSquares
    between: MeanSquares
    dof: int
    cell_pixels: float

    def scaled(self, factor: float) -> Nonuniformity:
        """Return that of values that are larger by a factor."""

        def of(squares: MeanSquares) -> MeanSquares:
            aa, ab, bb = squares
            return factor**2 * aa, factor**2 * ab, factor**2 * bb

        return replace(self, within=of(self.within), between=of(self.between))

    def pixel_variance_dn2(self, dark_dn: float) -> float:
        """Variance of (DN - d) / V from pixel to pixel, in DN^2; noise included."""
        return _mean_square_difference(self.within, dark_dn)

    def slow_variance_dn2(self, dark_dn: float) -> float:
        """Variance of (DN - d) / V across the region beyond that from pixel to pixel, in DN^2.

        One-way analysis of variance with random effects: (MS_between - MS_within) / n_0. 0 unless MS_between exceeds
        MS_within significantly, by three of its standard deviations sqrt(2 / dof).
        """
        within, between = _mean_square_difference(self.within, dark_dn), _mean_square_difference(self.between, dark_dn)
        if self.dof < 1 or between <= within * (1 + 3 * sqrt(2 / self.dof)):
            return 0.0
        return (between - within) / self.cell_pixels


def nonuniformity(signal_dn: Array, inverse_v: Array | None, used: NDArray[np.bool_]) -> Nonuniformity:
    """Mean squares of a region's pixels, in 4 x 4 cells, which resolve a gradient and a hot spot, or 2 x 2 if small.

    Parameters
    ----------
    signal_dn, inverse_v : ndarray of float, shape (n,)
        DN / V and 1 / V of the pixels in the order of the image; None for V = 1.
    used : ndarray of bool, shape (height, width)
        Which pixels of a window they are, n of them.
    """
    side = 4 if signal_dn.size >= 256 else 2
    n = _cell_sums(None, used, side)
    filled = n > 0
    dof = int(np.count_nonzero(filled)) - 1
    deviations = [values - values.mean() for values in (signal_dn, inverse_v) if values is not None]
    sums = [_cell_sums(values, used, side)[filled] for values in deviations]
    n = n[filled]

    def products(i: int, j: int) -> tuple[float, float]:
        if inverse_v is None and j == 1:
            return 0.0, 0.0
        between = float(np.sum(sums[i] * sums[j] / n))
        total = float(deviations[i] @ deviations[j])
        return (total - between) / max(signal_dn.size - n.size, 1), between / max(dof, 1)

    within, between = zip(products(0, 0), products(0, 1), products(1, 1), strict=True)
    cell_pixels = (signal_dn.size - float(np.sum(n**2)) / signal_dn.size) / max(dof, 1)
    return Nonuniformity(within, between, dof, cell_pixels)


def _cell_sums(values: Array | None, used: NDArray[np.bool_], side: int) -> NDArray[np.float64]:
    """Add up the used pixels in `side` x `side` cells of a window; None to count them."""
    window = used if values is None else in_window(values, used)
    # The first row and column of each cell; a window of fewer has fewer cells.
    firsts = [np.unique(-(-np.arange(side) * size // side)) for size in used.shape]
    starts = [first[first < size] for first, size in zip(firsts, used.shape, strict=True)]
    rows = np.add.reduceat(window, starts[0], axis=0, dtype=np.float64)
    sums: NDArray[np.float64] = np.add.reduceat(rows, starts[1], axis=1).ravel()
    return sums


def in_window(values: Array, used: NDArray[np.bool_], rest: float = 0.0) -> Array:
    """Return values of the used pixels of a window, shape (n,), at their positions, and a value at the rest."""
    if values.size == used.size:
        return values.reshape(used.shape)
    window: Array = np.full(used.shape, rest)
    window[used] = values
    return window


def _mean_square_difference(squares: MeanSquares, dark_dn: float) -> float:
    aa, ab, bb = squares
    return max(aa - 2 * dark_dn * ab + dark_dn**2 * bb, 0.0)


def significant_root(variance: Quantity) -> float:
    """Return the square root of a variance that may be below 0 by chance; 0 where it is not significantly above 0."""
    return sqrt(variance.value) if variance.value > 2 * variance.u else 0.0


@dataclass(frozen=True)
class SpatialVariance:
    """Spatial variances of a mean image in DN^2, temporal noise subtracted.

    Parameters
    ----------
    total, pixel, column, row : Quantity
        Of all pixels, and its parts (EMVA 1288 Release 4.0 Linear, section 4.2).
    """

    total: Quantity
    pixel: Quantity
    column: Quantity
    row: Quantity


def spatial_variance(mean_image: NDArray[np.floating[Any]], noise: LineVariances) -> SpatialVariance:
    """Spatial variance of a mean image, and its parts.

    Parameters
    ----------
    mean_image : ndarray of float, shape (height, width)
        Mean of the frames.
    noise : LineVariances
        Contribution of temporal noise to pixels and to the means of columns and rows.

    Returns
    -------
    SpatialVariance
        The uncertainty of the total is sqrt((m4 - s^4) / n) with the fourth central moment m4, so that single hot
        pixels count; that of column and row means is the one of normal values.
    """
    image = np.asarray(mean_image, dtype=np.float64)
    height, width = image.shape
    deviation = image - image.mean()
    squares = np.square(deviation)
    measured = float(squares.sum()) / (image.size - 1)
    columns, rows = (float(deviation.mean(axis=axis).var(ddof=1)) for axis in (0, 1))
    parts = LineVariances(measured - noise.pixel, columns - noise.column, rows - noise.row).parts(height, width)
    u_pixels = sqrt(max(float(np.mean(np.square(squares))) - measured**2, 0.0) / image.size)
    # A pattern of columns or rows has only as many values as there are columns or rows. By chance a variance may come
    # out below that of noise and single pixels alone.
    u_columns = max(columns, noise.column + max(parts.pixel, 0.0) / height) * sqrt(2 / (width - 1))
    u_rows = max(rows, noise.row + max(parts.pixel, 0.0) / width) * sqrt(2 / (height - 1))
    return SpatialVariance(
        Quantity(measured - noise.pixel, hypot(u_pixels, u_columns, u_rows)),
        Quantity(parts.pixel, u_pixels),
        Quantity(parts.column, u_columns),
        Quantity(parts.row, u_rows),
    )


def smooth_patterns(shape: tuple[int, int], centres_px: Sequence[tuple[float, float]]) -> Array:
    """Dominant patterns of slow changes over an image, r^2, x and y, at P positions.

    Each has the mean 0 and the root mean square 1 over the image.

    Parameters
    ----------
    shape : (int, int)
        Height and width in pixels.
    centres_px : sequence of (float, float)
        The places (x, y), P of them.

    Returns
    -------
    ndarray of float, shape (P, 3)
    """
    size = np.array([shape[1], shape[0]], dtype=float)
    # From -1 to 1 over width and height, where x^2 has the mean 1/3 and the variance 4/45.
    xy = 2 * np.array(centres_px, dtype=float).reshape(-1, 2) / size - 1
    part = size**2 / (size @ size)
    r2 = (xy**2 @ part - 1 / 3) / sqrt(4 / 45 * (part @ part))
    return np.column_stack([r2, sqrt(3) * xy])


def slow_rel(vignetting: AnyVignetting | None) -> float:
    """Relative standard uncertainty of slow residuals of a measured vignetting."""
    return vignetting.slow_rel if isinstance(vignetting, FlatField | RadialVignetting) else 0.0


def vignetting_errors(
    vignetting: AnyVignetting | None, shape: tuple[int, int], centres_px: Sequence[tuple[float, float]]
) -> Array:
    """Signed relative errors of luminances at P places by the patterns of a vignetting, shape (k, P); k may be 0.

    Parameters
    ----------
    vignetting : AnyVignetting or None
        The vignetting; that of a flat field has no such errors.
    shape : (int, int)
        Height and width in pixels.
    centres_px : sequence of (float, float)
        The places (x, y), P of them.
    """
    if not isinstance(vignetting, Cos4Vignetting | RadialVignetting):
        return np.zeros((0, len(centres_px)))
    return -np.array([vignetting.common_errors_at(shape, at_px) for at_px in centres_px]).T.reshape(-1, len(centres_px))
