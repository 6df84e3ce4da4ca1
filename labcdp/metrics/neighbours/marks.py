"""Marks of detected pairs of neighbours: their sums, and what follows from these."""

from __future__ import annotations

from collections.abc import Iterable
from math import nan, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..contrast import TargetContrast
from ..distribution import weighted_sum
from ..result import NeighbourCdp
from ..uncertainty import confidence_interval

#: Fewest rows and columns for an estimate of their scatter.
FEWEST_LINES = 8


class MarkSums(NamedTuple):
    """Sums of the marks of a contrast: the detected pairs, 0 to 2, of each pixel with its right and lower neighbour.

    Parameters
    ----------
    near : float
        Sum of the products of each mark with itself and its eight neighbours.
    rows, columns : ndarray, shape (height,) and (width,)
        Sums of marks.
    sides : ndarray, shape (height, 3)
        Marks of the first, the last but one and the last column.
    """

    near: float
    rows: NDArray[Any]
    columns: NDArray[Any]
    sides: NDArray[Any]

    @classmethod
    def of(cls, marks: NDArray[np.integer[Any]]) -> MarkSums:
        """Sum the marks of an image, shape (height, width)."""
        one = marks.astype(np.float64)
        padded = np.pad(one, 1)
        down = padded[:-2] + padded[1:-1] + padded[2:]
        near = float(np.einsum("ij,ij->", one, down[:, :-2] + down[:, 1:-1] + down[:, 2:]))
        return cls(near, one.sum(axis=1), one.sum(axis=0), one[:, [0, -2 % one.shape[1], -1]])

    def variance(self, share: float) -> float:
        """Variance of the share U of all P pairs that is detected; nan for fewer than 8 rows or columns.

        Notes
        -----
        With independent noise, the deviations e of the marks of two pixels from their expectation are dependent only in
        the same or an adjacent row and column, where they have a pixel in common; a pattern of rows and columns makes
        all marks of the same or an adjacent row dependent, and likewise those of columns. The estimator is the two-way
        one of Cameron, Gelbach and Miller (J. Bus. Econ. Stat. 29, 2011), with adjacent lines joined: the sum of e e'
        over all such pairs of pixels, rows + columns - both, over P^2. As U is itself an estimate, the sum is too small
        by the share of all pairs that it covers, which is corrected. As the scatter of few lines is poorly known, the
        variance is at least that without a pattern and that of independent pairs, U (1 - U) / P.

        In simulations 95 % intervals covered the truth in 95 to 98 % of the cases without a pattern. With one as large
        as the noise of a pixel it depends on the smaller number of rows or columns: 92 to 95 % from 40 on, 87 to 90 %
        at 20, 83 % at 12 and 74 to 79 % at 8. A scene that varies counts as scatter: the variance is then too large.

        With e = a - U p, a the marks and p the pairs of each pixel, products are opened: those of a and a are sums of
        integers, and those with p follow from sums over rows and columns and from the border.
        """
        height, width = self.rows.size, self.columns.size
        if min(height, width) < FEWEST_LINES:
            return nan
        rows, columns = np.full(height, 2.0 * width - 1), np.full(width, 2.0 * height - 1)
        rows[-1], columns[-1] = width - 1, height - 1
        sides = np.full((height, 3), 2.0)
        sides[:, -1] -= 1
        sides[-1] -= 1
        n_pairs, near_of_all = float(rows.sum()), _near_pairs(rows, sides)
        lines_of_all = _lines(rows, columns) - near_of_all
        near = self.near - 2 * share * _near_pairs(self.rows, self.sides) + share**2 * near_of_all
        lines = _lines(self.rows - share * rows, self.columns - share * columns) - near
        return max(
            lines / (n_pairs**2 - lines_of_all), near / (n_pairs**2 - near_of_all), share * (1 - share) / n_pairs
        )


def _near_pairs(rows: NDArray[Any], sides: NDArray[Any]) -> float:
    """Sum of the products of each pixel's marks with its own and its neighbours' pairs.

    A pixel has nine neighbours, with itself, but at the border; each has two pairs, but one less at the right and at
    the lower end.
    """
    first, last_but_one, last = sides.T.astype(np.float64)
    across = 3 * rows - first - last
    down = np.full(rows.size, 3.0)
    down[[0, -1]] = 2
    return weighted_sum(down, 2 * across - last_but_one - last) - float(across[-2:].sum())


def _lines(rows: NDArray[np.float64], columns: NDArray[np.float64]) -> float:
    """Sum of products over pairs of pixels in the same or an adjacent row, and in the same or an adjacent column."""
    return sum(weighted_sum(one, one) + 2 * weighted_sum(one[1:], one[:-1]) for one in (rows, columns))


def result_of_counts(asked: TargetContrast, pairs: int, counts: Iterable[int], marks: MarkSums) -> NeighbourCdp:
    """Make the result of a contrast from the pairs that are undefined, below, and up to the upper end."""
    undefined, below, up_to = counts
    cdp = (up_to - below) / pairs
    variance = marks.variance(cdp)
    return NeighbourCdp(
        cdp=cdp,
        standard_error=sqrt(variance),
        # A pixel is part of up to four pairs.
        confidence_interval=confidence_interval(cdp, variance, pairs / 4),
        contrast=asked.contrast,
        epsilon=asked.epsilon,
        definition=asked.definition,
        interval=asked.interval,
        below=below / pairs,
        above=(pairs - up_to) / pairs,
        undefined=undefined / pairs,
        pairs=pairs,
    )
