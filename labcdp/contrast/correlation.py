"""How much noise that is correlated from pixel to pixel raises the variance of a mean."""

from __future__ import annotations

from dataclasses import dataclass
from math import log10, nan, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from .image import image_array, mask_array
from .lags import Lags, both_signs, lags_of_mask

#: A correlation counts from so many times sqrt(log10(n) / n) on, unless so many lags in a row are below it
#: (Politis 2003, with the constants he recommends).
_SIGNIFICANT, _LAGS_BELOW = 2.0, 5

#: Lags that are looked at first.
_FEW_LAGS = 12

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
    is itself an estimate, the sum falls short by the share of all n^2 pairs that it goes over, which is put back.
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
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    window = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    products, pairs = Lags(scores[window]), lags_of_mask(mask[window])
    n, scatter = pairs.at_0, products.at_0
    if not scatter > 0:
        return nan
    weights = _weights_of_lags(products, pairs)
    summed = weights.sum_of(pairs) / n**2
    if summed >= 1:
        return 1.0
    return max(weights.sum_of(products) / scatter * (1 - 1 / n) / (1 - summed), 1.0)


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
    all_down: bool
    all_right: bool

    def sum_of(self, lags: Lags) -> float:
        """Weighted sum over all lags."""
        down, right = both_signs(self.down), both_signs(self.right)
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


def _weights_of_lags(products: Lags, pairs: Lags) -> _Weights:
    """Choose how much each lag counts."""
    reaches = tuple(_reach(products, pairs, axis) for axis in (0, 1))
    # Only lag 0 counts where none is significant.
    down, right = (
        np.clip(2 - np.arange(2 * (reach + 1)) / (reach + 1), 0, 1) if reach else np.ones(1) for reach in reaches
    )
    counts = down.size, right.size
    known_pairs = pairs.near(*counts)
    correlation = np.where(known_pairs > 0, products.near(*counts) / np.maximum(known_pairs, 1), 0)
    correlation *= np.outer(both_signs(down), both_signs(right)) * pairs.at_0 / products.at_0
    whole = []
    for axis, reach in enumerate(reaches):
        far_pairs = round(_far(pairs, axis, 2 * (reach + 1)))
        # Variance of the sum of far products (Bartlett's formula, summed over lags along the line), in scatter^2.
        variance = 2 * far_pairs * float((correlation.sum(axis=axis) ** 2).sum())
        far = _far(products, axis, 2 * (reach + 1)) * pairs.at_0 / products.at_0
        whole.append(far_pairs > 0 and far > _LINE_SIGNIFICANT * sqrt(variance))
    return _Weights(down, right, *whole)


def _reach(products: Lags, pairs: Lags, axis: int) -> int:
    """Last lag along an axis before so many in a row that do not count, up to a quarter of its length."""
    n = pairs.at_0
    least = _SIGNIFICANT * sqrt(log10(n) / n)
    most = products.shape[axis] // 4
    reach = 0
    # Noise of cameras reaches a few pixels.
    for asked in (min(_FEW_LAGS, most), most):
        line_pairs = pairs.line(axis, asked + 1)
        correlation = np.where(line_pairs > 0, products.line(axis, asked + 1) / np.maximum(line_pairs, 1), 0)
        significant = np.abs(correlation) * n / products.at_0 > least
        reach = 0
        for lag in range(1, asked + 1):
            if significant[lag]:
                reach = lag
            elif lag - reach >= _LAGS_BELOW:
                return reach
    return reach


def _far(lags: Lags, axis: int, last: int) -> float:
    """Sum over all lags along an axis beyond the `last`."""
    near = lags.line(axis, min(last + 1, lags.shape[axis]))
    return lags.summed(axis).at_0 - float(2 * near.sum() - near[0])
