"""Non-uniformity of a region: from pixel to pixel, and slowly across it."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Mean squares and mean products of two quantities a and b: (aa, ab, bb).
MeanSquares = tuple[float, float, float]


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

    def pixel_variance_dn2(self, dark_dn: float) -> float:
        """Variance of (DN - d) / V from pixel to pixel, in DN^2; noise included."""
        return _of_difference(self.within, dark_dn)

    def slow_variance_dn2(self, dark_dn: float) -> float:
        """Variance of (DN - d) / V across the region beyond that from pixel to pixel, in DN^2.

        One-way analysis of variance with random effects: (MS_between - MS_within) / n_0. 0 unless MS_between exceeds
        MS_within significantly, by three of its standard deviations sqrt(2 / dof).
        """
        within, between = _of_difference(self.within, dark_dn), _of_difference(self.between, dark_dn)
        if self.dof < 1 or between <= within * (1 + 3 * sqrt(2 / self.dof)):
            return 0.0
        return (between - within) / self.cell_pixels


def nonuniformity(
    signal_dn: NDArray[np.floating[Any]], inverse_v: NDArray[np.floating[Any]] | None, cells: NDArray[np.integer[Any]]
) -> Nonuniformity:
    """Mean squares of a region's pixels.

    Parameters
    ----------
    signal_dn, inverse_v : ndarray of float, shape (n,)
        DN / V and 1 / V of the pixels; None for V = 1.
    cells : ndarray of int, shape (n,)
        Index of each pixel's cell, from 0.
    """
    n = np.bincount(cells).astype(float)
    filled = n > 0
    dof = int(np.count_nonzero(filled)) - 1
    deviations = [values - values.mean() for values in (signal_dn, inverse_v) if values is not None]
    sums = [np.bincount(cells, weights=values)[filled] for values in deviations]
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


def cells_of(used: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Index of the cell of each used pixel of a window: 4 x 4 cells resolve a gradient and a hot spot, 2 x 2 if small.

    Parameters
    ----------
    used : ndarray of bool, shape (height, width)
        Pixels of a region; shape (n,) is returned, in the order of the image.
    """
    side = 4 if np.count_nonzero(used) >= 256 else 2
    row, column = (np.arange(size) * side // size for size in used.shape)
    cells: NDArray[np.intp] = (row[:, None] * side + column[None, :])[used]
    return cells


def _of_difference(squares: MeanSquares, dark_dn: float) -> float:
    aa, ab, bb = squares
    return max(aa - 2 * dark_dn * ab + dark_dn**2 * bb, 0.0)
