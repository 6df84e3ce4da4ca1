"""How uneven a region is: from pixel to pixel, and slowly across it."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Mean squares and mean products of two quantities a and b: (aa, ab, bb).
MeanSquares = tuple[float, float, float]


@dataclass(frozen=True)
class Unevenness:
    """Mean squares of DN / V and 1 / V within and between the cells of a region.

    The unevenness of light is that of (DN - d) / V. With both mean squares at hand it follows for any darkness d,
    which may be measured later.

    Parameters
    ----------
    within, between : (float, float, float)
        Mean squares within and between cells of DN / V, mean products of DN / V and 1 / V, mean squares of 1 / V.
    freedom : int
        Degrees of freedom between the cells, their number less one.
    cell_pixels : float
        Effective number of pixels of a cell, n_0.
    """

    within: MeanSquares
    between: MeanSquares
    freedom: int
    cell_pixels: float

    def pixel_variance_dn2(self, dark_dn: float) -> float:
        """Variance of (DN - d) / V from pixel to pixel, in DN^2; noise is part of it."""
        return _of_difference(self.within, dark_dn)

    def slow_variance_dn2(self, dark_dn: float) -> float:
        """Variance of (DN - d) / V across the region beyond that from pixel to pixel, in DN^2.

        One-way analysis of variance with random effects: (MS_between - MS_within) / n_0. It counts only if MS_between
        exceeds MS_within by three of its standard deviations sqrt(2 / freedom), else noise alone would pass
        for an uneven patch; 0 if it does not.
        """
        within, between = _of_difference(self.within, dark_dn), _of_difference(self.between, dark_dn)
        if self.freedom < 1 or between <= within * (1 + 3 * sqrt(2 / self.freedom)):
            return 0.0
        return (between - within) / self.cell_pixels


def unevenness(
    signal_dn: NDArray[np.floating[Any]], inverse_v: NDArray[np.floating[Any]], cells: NDArray[np.integer[Any]]
) -> Unevenness:
    """Mean squares of a region's pixels.

    Parameters
    ----------
    signal_dn, inverse_v : ndarray of float, shape (n,)
        DN / V and 1 / V of the pixels.
    cells : ndarray of int, shape (n,)
        Which cell of the region a pixel belongs to, 0 and up.
    """
    n = np.bincount(cells).astype(float)
    filled = n > 0
    freedom = int(np.count_nonzero(filled)) - 1
    deviations = [values - values.mean() for values in (signal_dn, inverse_v)]
    sums = [np.bincount(cells, weights=values)[filled] for values in deviations]
    n = n[filled]

    def products(i: int, j: int) -> tuple[float, float]:
        between = float(np.sum(sums[i] * sums[j] / n))
        total = float(deviations[i] @ deviations[j])
        return (total - between) / max(signal_dn.size - n.size, 1), between / max(freedom, 1)

    within, between = zip(products(0, 0), products(0, 1), products(1, 1), strict=True)
    cell_pixels = (signal_dn.size - float(np.sum(n**2)) / signal_dn.size) / max(freedom, 1)
    return Unevenness(within, between, freedom, cell_pixels)


def _of_difference(squares: MeanSquares, dark_dn: float) -> float:
    aa, ab, bb = squares
    return max(aa - 2 * dark_dn * ab + dark_dn**2 * bb, 0.0)
