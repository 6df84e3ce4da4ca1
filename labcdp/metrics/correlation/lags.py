"""Inflation of the variance of a mean by the correlation of near pixels, summed over lags."""

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


def inflation_of_scores(scores: NDArray[np.float64], mask: NDArray[np.bool_]) -> float:
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
    from .lags_kernel import at_lag, chosen

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
    image: NDArray[np.float64],
    mask: NDArray[np.float64],
    down: int,
    right: int,
    all_down: bool = False,
    all_right: bool = False,
) -> float | None:
    """Sum over the selected lags, corrected for the estimated mean; None if that is not possible."""
    from .lags_kernel import summed

    n = mask.sum()
    share = summed(mask, down, right, all_down, all_right) / n**2
    if not share < 1:
        return None
    return float(summed(image, down, right, all_down, all_right) * (1 - 1 / n) / (1 - share))
