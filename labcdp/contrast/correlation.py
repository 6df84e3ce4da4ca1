"""How much noise that is correlated from pixel to pixel raises the variance of a mean."""

from __future__ import annotations

from math import log10, nan, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from .image import image_array, mask_array

#: A correlation counts from so many times sqrt(log10(n) / n) on, unless so many lags in a row are below it
#: (Politis 2003, with the constants he recommends).
_SIGNIFICANT, _LAGS_BELOW = 2.0, 5

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
    products, pairs = _over_lags(scores[window]), np.rint(_over_lags(mask[window].astype(np.float64)))
    n, scatter = float(pairs[0, 0]), float(products[0, 0])
    if not scatter > 0:
        return nan
    weights = _weights_of_lags(products, pairs, mask[window].shape)
    summed = float((weights * pairs).sum()) / n**2
    if summed >= 1:
        return 1.0
    correlated = float((weights * products).sum()) / scatter
    return max(correlated * (1 - 1 / n) / (1 - summed), 1.0)


def _weights_of_lags(
    products: NDArray[np.float64], pairs: NDArray[np.float64], shape: tuple[int, ...]
) -> NDArray[np.float64]:
    """Choose how much each lag (dy, dx) counts, 0 to 1, for a region of `shape`; arrays as from `_over_lags`."""
    n = pairs[0, 0]
    correlation = np.where(pairs > 0, products / np.maximum(pairs, 1), 0) / (products[0, 0] / n)
    down = _axis(correlation[:, 0], shape[0], n)
    right = _axis(correlation[0], shape[1], n)
    near: NDArray[np.float64] = np.outer(down.weights, right.weights)
    weights = near
    for axis, line, line_pairs, across, number in (
        (down, products[:, 0], pairs[:, 0], right.weights[None, :], 0),
        (right, products[0], pairs[0], down.weights[:, None], 1),
    ):
        far = axis.lags > 2 * (axis.reach + 1)
        # Variance of the sum of far products (Bartlett's formula, summed over lags along the line), in scatter^2.
        variance = 2 * line_pairs[far].sum() * float(((near * correlation).sum(axis=number) ** 2).sum())
        if line[far].sum() * n / products[0, 0] > _LINE_SIGNIFICANT * sqrt(variance):
            weights = np.maximum(weights, across)
    return weights


class _Axis(NamedTuple):
    lags: NDArray[np.intp]
    reach: int
    weights: NDArray[np.float64]


def _axis(correlation: NDArray[np.float64], length: int, n: float) -> _Axis:
    """Choose the lags along an axis that count, up to a quarter of its `length`."""
    lags = np.abs(np.fft.fftfreq(correlation.size, 1 / correlation.size).round().astype(np.intp))
    least = _SIGNIFICANT * sqrt(log10(n) / n)
    reach = 0
    for lag in range(1, length // 4 + 1):
        if abs(correlation[lag]) > least:
            reach = lag
        elif lag - reach >= _LAGS_BELOW:
            break
    weights = np.clip(2 - lags / (reach + 1), 0, 1) if reach else (lags == 0).astype(np.float64)
    return _Axis(lags, reach, weights)


def _over_lags(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sum of the products of all pairs of pixels at each lag (dy, dx), negative lags at the ends as in an FFT."""
    from scipy import fft

    # Padded so far that no lag wraps around.
    shape = [fft.next_fast_len(2 * length, real=True) for length in values.shape]
    spectrum = fft.rfft2(values, shape)
    products: NDArray[np.float64] = fft.irfft2(np.abs(spectrum) ** 2, shape)
    return products
