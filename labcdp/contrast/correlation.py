"""How much noise that is correlated from pixel to pixel raises the variance of a mean."""

from __future__ import annotations

from math import log10, nan, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from .image import image_array, mask_array

#: A correlation counts from so many times sqrt(log10(n) / pairs) on, unless so many lags in a row are below it
#: (Politis 2003, with the constants he recommends; he has n for the pairs, of which an outline may leave far fewer).
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
    along the axis before five in a row whose correlation is below 2 sqrt(log10(n) / pairs), and the weight is 1 up to
    q + 1 and falls to 0 at 2 (q + 1), and only lag 0 counts if q is 0 (after D. N. Politis, Adaptive bandwidth choice,
    J. Nonparametr. Stat. 15, 2003; one lag more, as the last correlations are often below the limit). The weight of a
    lag is the product of those, u and v, for both axes. A pattern of rows or columns correlates little at each lag but
    over all lags; if the lags beyond 2 (q + 1) together exceed 0 by 2.3 standard deviations, all lags along that axis
    count: the weight is then that for the other axis, or u + v - u v if this is so along both. As the mean
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
    from .correlation_kernel import at_lag, chosen

    if not mask.all():
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        window = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
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
    # The sum over all lags is the square of the sum of the scores, 0. Near ones never go over all pairs: the farthest
    # lag of a region weighs less than 1.
    nearer = (_inflation(image, inside, min(down, most), min(right, most)) for most in range(max(down, right) + 1))
    return max(1.0, *(one / scatter for one in nearer if one is not None))


def _inflation(
    image: NDArray[np.float64],
    mask: NDArray[np.float64],
    down: int,
    right: int,
    all_down: bool = False,
    all_right: bool = False,
) -> float | None:
    """Sum over the lags that count, less what the mean took; None if that is all."""
    from .correlation_kernel import summed

    n = mask.sum()
    share = summed(mask, down, right, all_down, all_right) / n**2
    if not share < 1:
        return None
    return float(summed(image, down, right, all_down, all_right) * (1 - 1 / n) / (1 - share))
