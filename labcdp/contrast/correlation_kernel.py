"""How far correlation reaches, and how much it is, from sums over pairs of pixels by their lag, compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..compiled import compiled


@compiled
def last_significant(
    products: NDArray[np.float64], pairs: NDArray[np.float64], least: float, most_below: int
) -> tuple[int, bool]:
    """Last lag along a line before some in a row whose mean product is small.

    Parameters
    ----------
    products, pairs : ndarray of float, shape (n,)
        Sums of products, and numbers of pairs, at the lags from 0 on.
    least : float
        Size that a mean product has to exceed, in the unit of the products.
    most_below : int
        Lags in a row below it after which no other is looked at.

    Returns
    -------
    (int, bool)
        The lag, 0 for none; and whether the line went on so far that it is known.
    """
    reach = 0
    for lag in range(1, products.size):
        if pairs[lag] > 0 and abs(products[lag]) > least * pairs[lag]:
            reach = lag
        elif lag - reach >= most_below:
            return reach, True
    return reach, False


@compiled
def squared_sums(
    products: NDArray[np.float64], pairs: NDArray[np.float64], down: NDArray[np.float64], right: NDArray[np.float64]
) -> tuple[float, float]:
    """Sum the squares of the weighted mean products, summed first over the lags along y, and over those along x.

    Parameters
    ----------
    products, pairs : ndarray of float, shape (k, l)
        Sums of products, and numbers of pairs, at lags of both signs, lag 0 in the middle; not of one shape.
    down, right : ndarray of float, shape (m,) and (n,)
        Weights of the lags along y and x, lag 0 in the middle; no more than either array has.

    Returns
    -------
    (float, float)
        In the square of the unit of the products.
    """
    height, width = down.size, right.size
    columns = np.zeros(width)
    by_rows = 0.0
    for y in range(height):
        left, left_pairs = (products.shape[1] - width) // 2, (pairs.shape[1] - width) // 2
        line = products[y + (products.shape[0] - height) // 2, left : left + width]
        of_line = pairs[y + (pairs.shape[0] - height) // 2, left_pairs : left_pairs + width]
        row = 0.0
        for x in range(width):
            mean = line[x] / of_line[x] * down[y] * right[x] if of_line[x] > 0 else 0.0
            row += mean
            columns[x] += mean
        by_rows += row * row
    by_columns = 0.0
    for x in range(width):
        by_columns += columns[x] * columns[x]
    return by_columns, by_rows
