"""Variance of a share of pairs of neighbouring pixels, which share pixels, rows and columns."""

from __future__ import annotations

from math import nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..distribution import weighted_sum

#: Fewest rows and columns for an estimate of their scatter.
FEWEST_LINES = 8


def variance_of_neighbours(marks: NDArray[np.integer[Any]], share: float) -> float:
    """Variance of the share of neighbouring pairs that fulfil a condition.

    Parameters
    ----------
    marks : ndarray of int, shape (height, width)
        Number of pairs of each pixel with its right and lower neighbour that fulfil it, 0 to 2.
    share : float
        U, their share of all P pairs.

    Returns
    -------
    float
        Variance of `share`; nan for fewer than 8 rows or columns.

    Notes
    -----
    With independent noise, the deviations e of the marks of two pixels from their expectation are dependent only in the
    same or an adjacent row and column, where they have a pixel in common. A pattern of rows and columns, as sensors
    have it, makes all marks of the same or an adjacent row dependent, and likewise those of columns. The estimator is
    the two-way one of Cameron, Gelbach and Miller (J. Bus. Econ. Stat. 29, 2011), with adjacent lines joined: the sum
    of e e' over all such pairs of pixels, rows + columns - both, over P^2. As U is itself an estimate, the sum is too
    small by the share of all pairs that it covers, which is corrected. As the scatter of few lines is poorly known, the
    variance is at least that without a pattern and that of independent pairs, U (1 - U) / P.

    In simulations 95 % intervals covered the truth in 95 to 98 % of the cases without a pattern. Where rows or columns
    have a pattern as large as the noise of a pixel, it depends on the smaller number of the two: 92 to 95 % from 40 on,
    87 to 90 % at 20, 83 % at 12 and 74 to 79 % at 8. A scene that varies over the image counts as scatter, so the
    variance is then too large rather than too small.
    """
    if min(marks.shape) < FEWEST_LINES:
        return nan
    pairs = np.full(marks.shape, 2.0)
    pairs[:, -1] -= 1
    pairs[-1] -= 1
    n_pairs = float(pairs.sum())
    lines_summed, near_summed = _products(pairs)
    lines, near = _products(marks - share * pairs)
    return max(lines / (n_pairs**2 - lines_summed), near / (n_pairs**2 - near_summed), share * (1 - share) / n_pairs)


def _products(values: NDArray[np.float64]) -> tuple[float, float]:
    """Sum of products over pairs of pixels in the same or an adjacent row or column, and row and column."""

    def summed(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
        return float(np.einsum("ij,ij->", one, other))

    near = summed(values, values) + 2 * (
        summed(values[:, 1:], values[:, :-1])
        + summed(values[1:], values[:-1])
        + summed(values[1:, 1:], values[:-1, :-1])
        + summed(values[1:, :-1], values[:-1, 1:])
    )
    lines = -near
    for sums in (values.sum(axis=1), values.sum(axis=0)):
        lines += weighted_sum(sums, sums) + 2 * weighted_sum(sums[1:], sums[:-1])
    return lines, near
