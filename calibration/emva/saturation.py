"""End of the linear range."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from .result import SaturationLimit
from .series import SeriesPoint

#: Drop of the variance after its peak, in standard uncertainties, required of a peak.
_SIGNIFICANT = 4.0
#: Largest drop of the variance by clipping, over the share of clipped values: 2 to 2.6 for normal noise clipped at one
#: end, less where pixels differ.
_CLIPPED = 3.0
#: Points below the peak by less than this many standard uncertainties may be the peak.
_MAYBE_PEAK = 2.0
#: Points up to the peak whose scatter counts.
_NEIGHBOURS = 12


@dataclass(frozen=True)
class Saturation:
    """The end of the linear range.

    Parameters
    ----------
    index : int
        Point of the series with the largest temporal variance above that of the dark signal; the last unsaturated one
        where no peak was seen.
    limit : {'converter', 'full well', 'not reached'}
        Cause of saturation.
    uncertainty_rel : float
        Relative standard uncertainty of its stimulus.
    """

    index: int
    limit: SaturationLimit
    uncertainty_rel: float = 0.0


def find_saturation(points: Sequence[SeriesPoint]) -> Saturation:
    """Find the point of saturation: the largest temporal variance above dark (EMVA 1288 Release 4.0 Linear).

    Beyond it pixels reach the end of the converter, or are full, and their noise vanishes. The error is rectangular: it
    reaches half a step beyond the points whose variance is that of the peak but for noise and scatter.

    Parameters
    ----------
    points : sequence of SeriesPoint
        At least one, in rising order of signal.
    """
    excess = np.array([point.net_variance_dn2 for point in points])
    u = np.array([point.variance_uncertainty_dn2 for point in points])
    index = int(np.argmax(excess))
    falls = excess[index] - excess[index + 1 :] > _SIGNIFICANT * np.hypot(u[index], u[index + 1 :])
    limit: SaturationLimit = "not reached"
    if falls.any():
        drop_rel = 1 - points[-1].light.variance_dn2 / points[index].light.variance_dn2
        limit = "converter" if drop_rel <= _CLIPPED * points[-1].light.saturated_share else "full well"
    level = excess[index] - _MAYBE_PEAK * sqrt(2) * max(float(u[index]), _scatter_dn2(excess[: index + 1]))
    first, last = np.flatnonzero(excess >= level)[[0, -1]]
    x = np.array([point.stimulus for point in points])
    low, high = x[first] + x[max(first - 1, 0)], x[last] + x[min(last + 1, x.size - 1)]
    return Saturation(index, limit, float((high - low) / 4 / sqrt(3) / x[index]))


def _scatter_dn2(excess: NDArray[np.float64]) -> float:
    """Return the standard deviation of the variances around a smooth curve, by their second differences."""
    curved = np.diff(excess[-_NEIGHBOURS:], n=2)
    return float(np.sqrt(np.mean(curved**2) / 6)) if curved.size else 0.0
