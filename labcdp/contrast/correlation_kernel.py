"""Sums over pairs of pixels by their lag, without a table of all lags.

A sum over lags (dy, dx) with a weight for dy times one for dx is that of the products of the image with itself, once
smoothed by the weights along y, at the lags along x. All lags are counted in rows here; for those along x the image is
turned over.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..compiled import compiled
from ..sum_kernel import pairwise_sum

_Array = NDArray[np.float64]


@compiled
def chosen(image: _Array, mask: _Array, limit: float, below: int, line_limit: float) -> tuple[int, int, bool, bool]:
    """Choose the lags whose correlation counts, by a region itself.

    Parameters
    ----------
    image, mask : ndarray of float, shape (height, width)
        The pixels less their mean, 0 outside the mask; and the mask, 1 inside.
    limit : float
        Correlation that counts, of as many pairs as there are pixels.
    below : int
        Lags in a row below it after which no other is looked at.
    line_limit : float
        Standard deviations from which the lags beyond together count.

    Returns
    -------
    (int, int, bool, bool)
        Last lag along y and along x that counts; and whether all along y and along x do.
    """
    turned, turned_mask = np.ascontiguousarray(image.T), np.ascontiguousarray(mask.T)
    n, scatter = at_lag(mask, mask, 0), at_lag(image, image, 0)
    least = limit * scatter / n
    down, products_down, pairs_down = _last(image, mask, least, below)
    right, products_right, pairs_right = _last(turned, turned_mask, least, below)
    # Pairs at a lag (dy, dx) are taken as those at (dy, 0) times those at (0, dx) over all pixels.
    means_down, means_right = _over(weights(down), pairs_down), _over(weights(right), pairs_right)
    all_down = _lines_count(turned, image, mask, means_down, means_right, products_down, pairs_down, n, line_limit)
    all_right = _lines_count(
        image, turned, turned_mask, means_right, means_down, products_right, pairs_right, n, line_limit
    )
    return down, right, all_down, all_right


@compiled
def summed(image: _Array, down: int, right: int, all_down: bool, all_right: bool) -> float:
    """Sum the products of all pairs of pixels, each lag times its weight.

    Parameters
    ----------
    image : ndarray of float, shape (height, width)
        The image, 0 where it does not count.
    down, right : int
        Last lags along y and x that count.
    all_down, all_right : bool
        Whether all lags along y, or x, count as lag 0 along it does.

    Returns
    -------
    float
        In the square of the unit of the image.
    """
    of_down, of_right = weights(down), weights(right)
    total = 0.0
    if all_down:
        total += _weighted(_as_column(image.sum(axis=0)), of_right)
    if all_right:
        total += _weighted(_as_column(image.sum(axis=1)), of_down)
    if all_down == all_right:
        turned = np.ascontiguousarray(image.T)
        smooth = np.ascontiguousarray(_smoothed(image, of_down).T)
        both = 0.0
        for lag in range(of_right.size):
            both += (1 if lag == 0 else 2) * of_right[lag] * at_lag(turned, smooth, lag)
        # A lag counts by either or by both, not twice.
        total += -both if all_down else both
    return total


@compiled
def weights(reach: int) -> _Array:
    """Weights of the lags along an axis, from 0: 1 up to the one after `reach`, falling to 0 at twice that.

    Only lag 0 counts where none is significant.
    """
    if reach == 0:
        return np.ones(1)
    return np.minimum(2 - np.arange(2 * reach + 3) / (reach + 1), 1.0)


@compiled
def at_lag(image: _Array, other: _Array, lag: int) -> float:
    """Sum the products of the pixels of an image with those of another one so many rows below."""
    columns = np.zeros(image.shape[1])
    for y in range(image.shape[0] - lag):
        upper, lower = image[y], other[y + lag]
        for x in range(columns.size):
            columns[x] += upper[x] * lower[x]
    return pairwise_sum(columns)


@compiled
def _last(image: _Array, mask: _Array, least: float, below: int) -> tuple[int, _Array, _Array]:
    """Last lag before so many in a row whose mean product is small, up to a quarter of the rows.

    `least` is for as many pairs as there are pixels.

    Also returns the sums of products and the numbers of pairs at all lags that have a weight.
    """
    most = image.shape[0] // 4
    products, pairs = np.zeros(2 * most + 3), np.zeros(2 * most + 3)
    products[0], pairs[0] = at_lag(image, image, 0), at_lag(mask, mask, 0)
    reach = lag = 0
    while lag < most and lag - reach < below:
        lag += 1
        products[lag], pairs[lag] = at_lag(image, image, lag), at_lag(mask, mask, lag)
        # Fewer pairs scatter more.
        if abs(products[lag]) > least * np.sqrt(pairs[0] * pairs[lag]):
            reach = lag
    for farther in range(lag + 1, 2 * reach + 3):
        products[farther], pairs[farther] = at_lag(image, image, farther), at_lag(mask, mask, farther)
    return reach, products[: 2 * reach + 3], pairs[: 2 * reach + 3]


@compiled
def _over(weight: _Array, pairs: _Array) -> _Array:
    """Weights of lags over their pairs, 0 without any."""
    found = np.zeros(weight.size)
    for lag in range(weight.size):
        if pairs[lag] > 0:
            found[lag] = weight[lag] / pairs[lag]
    return found


@compiled
def _lines_count(
    turned: _Array,
    image: _Array,
    mask: _Array,
    means: _Array,
    means_across: _Array,
    products: _Array,
    pairs: _Array,
    n: float,
    limit: float,
) -> bool:
    """Whether the far lags along y are correlated together, beyond so many standard deviations.

    Their variance is Bartlett's formula, summed over lags along the line.
    """
    far_pairs = _far(mask, pairs)
    if far_pairs < 0.5:
        return False
    smooth = np.ascontiguousarray(_smoothed(image, means).T)
    squares = 0.0
    for lag in range(means_across.size):
        squares += (1 if lag == 0 else 2) * (n * means_across[lag] * at_lag(turned, smooth, lag)) ** 2
    return bool(_far(image, products) > limit * np.sqrt(2 * far_pairs * squares))


@compiled
def _far(image: _Array, near: _Array) -> float:
    """Sum of the products at all lags along y beyond those known, of both signs."""
    columns = image.sum(axis=0)
    return float((columns * columns).sum() - 2 * near.sum() + near[0])


@compiled
def _smoothed(image: _Array, weight: _Array) -> _Array:
    """Sum of the rows above and below each one, times the weight of their distance."""
    height = image.shape[0]
    sums = np.zeros(image.shape)
    for y in range(height):
        line = sums[y]
        for other in range(max(y - weight.size + 1, 0), min(y + weight.size, height)):
            factor, row = weight[abs(y - other)], image[other]
            for x in range(row.size):
                line[x] += factor * row[x]
    return sums


@compiled
def _weighted(image: _Array, weight: _Array) -> float:
    """Sum of the products at the lags along y of both signs, times their weight."""
    total = 0.0
    for lag in range(weight.size):
        total += (1 if lag == 0 else 2) * float(weight[lag]) * at_lag(image, image, lag)
    return total


@compiled
def _as_column(line: _Array) -> _Array:
    return np.ascontiguousarray(line).reshape(-1, 1)
