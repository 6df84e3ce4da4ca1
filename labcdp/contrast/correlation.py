"""How much noise that is correlated from pixel to pixel raises the variance of a mean."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from math import log10, nan, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from .image import image_array, mask_array
from .lags import Lags, both_signs, lags_of_mask

#: A correlation counts from so many times sqrt(log10(n) / n) on, unless so many lags in a row are below it
#: (Politis 2003, with the constants he recommends).
_SIGNIFICANT, _LAGS_BELOW = 2.0, 5

#: Lags that are looked at first: noise of cameras reaches a few pixels, which as many more below the limit show.
_FEW_LAGS = 8

#: Standard deviations from which the correlation along whole rows or columns counts: chance alone in 1 % of cases.
_LINE_SIGNIFICANT = 2.3


def variance_inflation(image: ArrayLike, mask: ArrayLike) -> float:
    """Factor by which spatial correlation raises the variance of the mean of a region's pixels.

    Parameters
    ----------
    image : array_like of int or float, shape (height, width)
        Image; only its pixels in `mask` count.
    mask : array_like of bool, shape (height, width)
        Pixels of the region, of any outline. The scene must be uniform there: a gradient counts as correlated noise.

    Returns
    -------
    float
        1 for independent pixels, about 9 for noise averaged over 3 x 3 pixels; never below 1. nan if the pixels are all
        equal. n / factor independent pixels would know the mean as well.

    Raises
    ------
    InputError
        If the image is not of two dimensions, or the mask not boolean, of another shape or empty, or holds a pixel that
        is not finite.

    Notes
    -----
    The factor is the sum of the autocorrelation over lags (dy, dx), each lag at the number of pairs of pixels the mask
    has for it. The lags that count are chosen by the region itself, separately for rows and columns: q is the last lag
    along the axis before five in a row whose correlation is below 2 sqrt(log10(n) / n), and the weight is 1 up to
    q + 1 and falls to 0 at 2 (q + 1), and only lag 0 counts if q is 0 (after D. N. Politis, Adaptive bandwidth choice,
    J. Nonparametr. Stat. 15, 2003; one lag more, as the last correlations are often below the limit). The weight of a
    lag is the product for both axes. A pattern of rows or columns correlates little at each lag but over all lags; if
    the lags beyond 2 (q + 1) together exceed 0 by 2.3 standard deviations, all lags along that axis count. As the mean
    is itself an estimate, the sum falls short by the share of all n^2 pairs that it goes over, which is put back. Where
    that share would be all of them, as for all lags along a region of one row, the sum is 0 whatever the noise; the
    factor is then the largest that follows with any q from 0 to that found.
    """
    pixels = image_array(image)
    marked = mask_array(mask, pixels.shape, "mask")
    values = pixels[marked].astype(np.float64)
    if not np.isfinite(values).all():
        raise InputError("the mask marks pixels that are not finite: leave them out")
    if values.min() == values.max():
        return nan
    scores = np.zeros(pixels.shape)
    scores[marked] = values - values.mean()
    return inflation_of_scores(scores, marked)


def inflation_of_scores(scores: NDArray[np.float64], mask: NDArray[np.bool_]) -> float:
    """Inflation as `variance_inflation` of pixels less their mean, 0 outside the mask; nan if all are 0."""
    if not mask.all():
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        window = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
        scores, mask = np.ascontiguousarray(scores[window]), mask[window]
    products, pairs = Lags(scores), lags_of_mask(mask)
    n = pairs.at_0
    if not products.at_0 > 0:
        return nan
    reaches = _reach(products, pairs, 0), _reach(products, pairs, 1)
    weights = _weights_of_lags(products, pairs, reaches)
    if weights.sum_of(pairs) < n**2:
        return max(_inflation(weights, products, pairs), 1.0)
    # The sum over all lags is the square of the sum of the scores, 0. Near ones never go over all pairs: the farthest
    # lag of a region weighs less than 1.
    nearer = (_Weights.of(*(min(reach, most) for reach in reaches)) for most in range(max(reaches) + 1))
    return max(_inflation(weights, products, pairs) for weights in nearer)


def _inflation(weights: _Weights, products: Lags, pairs: Lags) -> float:
    n = pairs.at_0
    return weights.sum_of(products) / products.at_0 * (1 - 1 / n) / (1 - weights.sum_of(pairs) / n**2)


@dataclass(frozen=True, eq=False)
class _Weights:
    """How much each lag (dy, dx) counts, 0 to 1.

    Parameters
    ----------
    down, right : ndarray of float
        By the lag along each axis, from 0; lags beyond the last count nothing. The weight of a lag is their product.
    all_down, all_right : bool
        Whether all lags along the axis count as lag 0 along it does.
    """

    down: NDArray[np.float64]
    right: NDArray[np.float64]
    all_down: bool = False
    all_right: bool = False

    @classmethod
    def of(cls, down: int, right: int) -> _Weights:
        """Return the weights for last lags that count along each axis."""
        return cls(_weights_of_line(down), _weights_of_line(right))

    @cached_property
    def both(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """By the lag along each axis, of both signs."""
        return both_signs(self.down), both_signs(self.right)

    def sum_of(self, lags: Lags) -> float:
        """Weighted sum over all lags."""
        down, right = self.both
        if not (self.all_down or self.all_right):
            return float(down @ lags.near(self.down.size, self.right.size) @ right)
        total = 0.0
        if self.all_down:
            total += float(lags.summed(0).near(1, self.right.size)[0] @ right)
        if self.all_right:
            total += float(lags.summed(1).near(self.down.size, 1)[:, 0] @ down)
        if self.all_down and self.all_right:
            # The larger one of both weights is their sum less the smaller one.
            smaller = np.minimum.outer(down, right)
            total -= float((smaller * lags.near(self.down.size, self.right.size)).sum())
        return total


def _weights_of_lags(products: Lags, pairs: Lags, reaches: tuple[int, int]) -> _Weights:
    """Choose how much each lag counts, from the last ones that do along each axis."""
    from .correlation_kernel import squared_sums

    weights = _Weights.of(*reaches)
    counts = weights.down.size, weights.right.size
    squares = squared_sums(products.table(*counts), pairs.table(*counts), *weights.both)
    whole = []
    for axis, reach in enumerate(reaches):
        far_pairs = round(_far(pairs, axis, 2 * (reach + 1)))
        # Variance of the sum of far products (Bartlett's formula, summed over lags along the line).
        spread = sqrt(2 * far_pairs * squares[axis])
        whole.append(far_pairs > 0 and _far(products, axis, 2 * (reach + 1)) > _LINE_SIGNIFICANT * spread)
    return replace(weights, all_down=whole[0], all_right=whole[1])


def _reach(products: Lags, pairs: Lags, axis: int) -> int:
    """Last lag along an axis before so many in a row that do not count, up to a quarter of its length."""
    from .correlation_kernel import last_significant

    n = pairs.at_0
    least = _SIGNIFICANT * sqrt(log10(n) / n) * products.at_0 / n
    most = products.shape[axis] // 4
    few = min(_FEW_LAGS, most) + 1
    reach, known = last_significant(products.line(axis, few), pairs.line(axis, few), least, _LAGS_BELOW)
    if known or few > most:
        return reach
    return last_significant(products.line(axis, most + 1), pairs.line(axis, most + 1), least, _LAGS_BELOW)[0]


@lru_cache(maxsize=256)
def _weights_of_line(reach: int) -> NDArray[np.float64]:
    """Weights of the lags along an axis, from 0; the last one is 0, but its lag is needed to know those beyond."""
    # Only lag 0 counts where none is significant.
    return np.clip(2 - np.arange(2 * reach + 3) / (reach + 1), 0, 1) if reach else np.ones(1)


def _far(lags: Lags, axis: int, last: int) -> float:
    """Sum over all lags along an axis beyond the `last`."""
    near = lags.line(axis, min(last + 1, lags.shape[axis]))
    return lags.summed(axis).at_0 - float(2 * near.sum() - near[0])
