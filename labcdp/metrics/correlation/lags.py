"""Inflation of the variance of a mean by the correlation of near pixels, summed over lags.

A sum over lags (dy, dx) with a weight for dy times one for dx is that of the products of the image with itself, once
smoothed by the weights along y, at the lags along x. All lags are counted in rows here; for those along x the image is
transposed. So no table of all lags is needed.
"""

from __future__ import annotations

from math import log10, nan, sqrt

import numpy as np
from numpy.typing import NDArray

from ..image import window_of

#: A correlation is significant above this many times sqrt(log10(n) / pairs); the sum ends where this many consecutive
#: lags are below (Politis 2003, with the recommended constants, but pairs instead of n: a mask may leave far fewer).
_SIGNIFICANT, _LAGS_BELOW = 2.0, 5

#: Critical value, in standard deviations, for the correlation along whole rows or columns: 1 % false positives.
_LINE_SIGNIFICANT = 2.3

#: Number of rows smoothed at a time.
_ROWS = 256

_Array = NDArray[np.float64]


def inflation_of_scores(scores: _Array, mask: NDArray[np.bool_]) -> float:
    """Factor by which the correlation at near lags raises the variance of the mean of pixels.

    Parameters
    ----------
    scores : ndarray of float, shape (height, width)
        Pixels less their mean, 0 outside the mask.
    mask : ndarray of bool, shape (height, width)
        Mask of the pixels.

    Returns
    -------
    float
        1 for independent pixels, about 9 for noise averaged over 3 x 3 pixels; never below 1. nan if all scores are 0.

    Notes
    -----
    The factor is the sum of the autocorrelation over lags (dy, dx), each lag at the number of pairs of pixels the mask
    has for it. The lags used are selected from the data, separately for rows and columns: q is the last lag along the
    axis before five consecutive ones whose correlation is below 2 sqrt(log10(n) / pairs), and the weight is 1 up to q +
    1 and falls to 0 at 2 (q + 1), and only lag 0 is used if q is 0 (after D. N. Politis, Adaptive bandwidth choice, J.
    Nonparametr. Stat. 15, 2003; one lag more, as the last correlations are often below the critical value). The weight
    of a lag is the product of those, u and v, for both axes. A pattern of rows or columns correlates little at each lag
    but over all lags; if the lags beyond 2 (q + 1) together exceed 0 by 2.3 standard deviations, all lags along that
    axis are used: the weight is then that for the other axis, or u + v - u v if this holds for both. As the mean is
    itself an estimate, the sum is too small by the share of all n^2 pairs that it covers, which is corrected. Where it
    covers all pairs, as for all lags along a region of one row, the sum is 0 whatever the noise; the factor is then the
    largest for any q from 0 to the selected one.
    """
    if not mask.all():
        window = window_of(mask)
        scores, mask = scores[window], mask[window]
    image, inside = np.ascontiguousarray(scores), np.ascontiguousarray(mask, dtype=np.float64)
    scatter, n = at_lag(image, image, 0), float(inside.sum())
    if not scatter > 0:
        return nan
    down, right, *whole = chosen(image, inside, _SIGNIFICANT * sqrt(log10(n) / n), _LAGS_BELOW, _LINE_SIGNIFICANT)
    if not any((down, right, *whole)):
        return 1.0
    found = _inflation(image, inside, down, right, *whole)
    if found is not None:
        return max(found / scatter, 1.0)
    # The sum over all lags is the square of the sum of the scores, 0. Near lags never cover all pairs: the weight of a
    # region's farthest lag is less than 1.
    nearer = (_inflation(image, inside, min(down, most), min(right, most)) for most in range(max(down, right) + 1))
    return max(1.0, *(one / scatter for one in nearer if one is not None))


def _inflation(
    image: _Array,
    mask: _Array,
    down: int,
    right: int,
    all_down: bool = False,
    all_right: bool = False,
) -> float | None:
    """Sum over the selected lags, corrected for the estimated mean; None if that is not possible."""
    n = mask.sum()
    share = summed(mask, down, right, all_down, all_right) / n**2
    if not share < 1:
        return None
    return float(summed(image, down, right, all_down, all_right) * (1 - 1 / n) / (1 - share))


def chosen(image: _Array, mask: _Array, limit: float, below: int, line_limit: float) -> tuple[int, int, bool, bool]:
    """Select the significant lags from the data of a region.

    Parameters
    ----------
    image, mask : ndarray of float, shape (height, width)
        Pixels less their mean, 0 outside the mask; and the mask, 1 inside.
    limit : float
        Critical value of the correlation, for as many pairs as there are pixels.
    below : int
        Number of consecutive lags below it that ends the selection.
    line_limit : float
        Critical value, in standard deviations, of the sum of the lags beyond.

    Returns
    -------
    (int, int, bool, bool)
        Last significant lag along y and along x; and whether all lags along y and along x are used.
    """
    transposed, transposed_mask = np.ascontiguousarray(image.T), np.ascontiguousarray(mask.T)
    n = at_lag(mask, mask, 0)
    least = limit * at_lag(image, image, 0) / n
    down, products_down, pairs_down = _last(image, mask, least, below)
    right, products_right, pairs_right = _last(transposed, transposed_mask, least, below)
    # Pairs at a lag (dy, dx) are taken as those at (dy, 0) times those at (0, dx) over all pixels.
    means_down, means_right = _over(weights(down), pairs_down), _over(weights(right), pairs_right)
    all_down = _lines_count(image, mask, means_down, means_right, products_down, pairs_down, line_limit)
    all_right = _lines_count(
        transposed, transposed_mask, means_right, means_down, products_right, pairs_right, line_limit
    )
    return down, right, all_down, all_right


def summed(image: _Array, down: int, right: int, all_down: bool, all_right: bool) -> float:
    """Sum the products of all pairs of pixels, each lag times its weight.

    Parameters
    ----------
    image : ndarray of float, shape (height, width)
        The image, 0 outside the mask.
    down, right : int
        Last significant lags along y and x.
    all_down, all_right : bool
        Whether all lags along y, or x, have the weight of lag 0.

    Returns
    -------
    float
        In the squared unit of the image.
    """
    of_down, of_right = weights(down), weights(right)
    total = 0.0
    if all_down:
        columns = (np.ones(image.shape[0]) @ image).reshape(-1, 1)
        total += _weighted(columns, columns, of_right)
    if all_right:
        rows = (image @ np.ones(image.shape[1])).reshape(-1, 1)
        total += _weighted(rows, rows, of_down)
    if all_down == all_right:
        transposed = np.ascontiguousarray(image.T)
        both = _weighted(transposed, np.ascontiguousarray(_smoothed(image, of_down).T), of_right)
        # A lag selected by both axes is counted once.
        total += -both if all_down else both
    return total


def weights(reach: int) -> _Array:
    """Weights of the lags along an axis, from 0: 1 up to the one after `reach`, falling to 0 at twice that.

    Only lag 0 is used where none is significant.
    """
    if reach == 0:
        return np.ones(1)
    return np.minimum(2 - np.arange(2 * reach + 3) / (reach + 1), 1.0)


def at_lag(image: _Array, other: _Array, lag: int) -> float:
    """Sum the products of an image with another one shifted down by a number of rows; both in C order."""
    rest = max(image.size - lag * image.shape[1], 0)
    return float(image.reshape(-1)[:rest] @ other.reshape(-1)[other.size - rest :])


def _last(image: _Array, mask: _Array, least: float, below: int) -> tuple[int, _Array, _Array]:
    """Last lag before a number of consecutive ones with a small mean product, up to a quarter of the rows.

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
        # Fewer pairs have a larger scatter.
        if abs(products[lag]) > least * np.sqrt(pairs[0] * pairs[lag]):
            reach = lag
    for farther in range(lag + 1, 2 * reach + 3):
        products[farther], pairs[farther] = at_lag(image, image, farther), at_lag(mask, mask, farther)
    return reach, products[: 2 * reach + 3], pairs[: 2 * reach + 3]


def _over(weight: _Array, pairs: _Array) -> _Array:
    """Weights of lags over their numbers of pairs, 0 without pairs."""
    counted = pairs[: weight.size]
    return weight * (counted > 0) / np.maximum(counted, 1.0)


def _lines_count(
    image: _Array, mask: _Array, means: _Array, means_across: _Array, products: _Array, pairs: _Array, limit: float
) -> bool:
    """Whether the sum over the far lags along y exceeds a number of standard deviations.

    Their variance is Bartlett's formula, summed over lags along the line. The means are weights over pairs of the lags
    along y and across.
    """
    far_pairs = _far(mask, pairs)
    if far_pairs < 0.5:
        return False
    smooth, transposed = np.ascontiguousarray(_smoothed(image, means).T), np.ascontiguousarray(image.T)
    squares = 0.0
    for lag in range(means_across.size):
        square = (pairs[0] * means_across[lag] * at_lag(transposed, smooth, lag)) ** 2
        squares += square if lag == 0 else 2 * square
    return bool(_far(image, products) > limit * np.sqrt(2 * far_pairs * squares))


def _far(image: _Array, near: _Array) -> float:
    """Sum of the products at all lags along y beyond those given, of both signs."""
    columns = np.ones(image.shape[0]) @ image
    return float(columns @ columns - 2 * near.sum() + near[0])


def _smoothed(image: _Array, weight: _Array) -> _Array:
    """Sum of the rows above and below each, times the weight of their distance."""
    height, width = image.shape
    reach, rows = min(weight.size, height) - 1, min(height, _ROWS)
    n_bands = (height + rows - 1) // rows
    below = np.zeros((n_bands * rows + reach - height, width))
    padded = np.concatenate((np.zeros((reach, width)), image, below))
    band = np.zeros((rows, rows + 2 * reach))
    for column in range(2 * reach + 1):
        band.reshape(-1)[column :: band.shape[1] + 1] = weight[abs(column - reach)]
    sums = np.empty((n_bands * rows, width))
    for first in range(0, n_bands * rows, rows):
        np.dot(band, padded[first : first + band.shape[1]], sums[first : first + rows])
    return sums[:height]


def _weighted(image: _Array, other: _Array, weight: _Array) -> float:
    """Sum of the products at the lags along y of both signs, times their weight."""
    total = -weight[0] * at_lag(image, other, 0)
    for lag in range(weight.size):
        total += 2 * weight[lag] * at_lag(image, other, lag)
    return float(total)
