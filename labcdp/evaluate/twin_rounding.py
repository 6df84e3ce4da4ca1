"""Noise of darkness before the converter rounded it, for cameras whose noise is less than a DN.

Noise of more than half a DN dithers the rounding, which then adds 1/12 DN^2 of variance and shifts no mean (B. Widrow
and I. Kollar, Quantization Noise, 2008). With less noise, mean and variance of the rounded values depend on where
between two DN the darkness lies.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from ..calibration.rounding import DITHERED_DN2, ROUNDING_DN2, mean_before_rounding, rounded_moments

__all__ = [
    "DITHERED_DN2",
    "ROUNDING_DN2",
    "DarkSpread",
    "largest_unseen_spread",
    "mean_before_rounding",
    "unrounded",
]

#: Values of a third DN that tell the spread.
_ENOUGH = 30
#: Places of a normal distribution at which pixels are looked at, in standard deviations.
_PLACES = np.linspace(-5, 5, 401)


@dataclass(frozen=True)
class DarkSpread:
    """Spread of darkness over pixels and time, in DN^2.

    Parameters
    ----------
    temporal_dn2 : float
        Variance of a pixel over time.
    spatial_dn2 : float
        Variance from pixel to pixel.
    """

    temporal_dn2: float
    spatial_dn2: float

    @property
    def total_dn2(self) -> float:
        """Of all values."""
        return self.temporal_dn2 + self.spatial_dn2


def unrounded(mean_dn: float, rounded: DarkSpread) -> DarkSpread:
    """Spread of darkness before rounding, from that of the rounded values.

    Parameters
    ----------
    mean_dn : float
        Mean of the rounded values.
    rounded : DarkSpread
        Their spread.
    """
    from scipy.optimize import brentq

    if rounded.total_dn2 >= DITHERED_DN2:
        return DarkSpread(max(rounded.temporal_dn2 - ROUNDING_DN2, 0.0), rounded.spatial_dn2)

    def excess(total: float) -> float:
        middle = np.array([mean_before_rounding(mean_dn, total)])
        return float(rounded_moments(middle, total)[1][0]) - rounded.total_dn2

    low, high = 1e-6, 2 * DITHERED_DN2
    total = low if excess(low) >= 0 else float(brentq(excess, low, high, xtol=1e-9))
    middle = mean_before_rounding(mean_dn, total)

    def temporal_excess(temporal: float) -> float:
        return _temporal(middle, DarkSpread(temporal, total - temporal)) - rounded.temporal_dn2

    if temporal_excess(total) <= 0:
        return DarkSpread(total, 0.0)
    temporal = float(brentq(temporal_excess, 0.0, total, xtol=1e-9))
    return DarkSpread(temporal, total - temporal)


def largest_unseen_spread(mean_dn: float, variance_dn2: float, n_values: int) -> float | None:
    """Largest standard deviation of darkness whose rounded values are two neighbouring DN only.

    Parameters
    ----------
    mean_dn, variance_dn2 : float
        Of the rounded values.
    n_values : int
        How many values they rest on.

    Returns
    -------
    float or None
        In DN; None if a third DN was seen often enough to tell the spread.

    Notes
    -----
    Of two DN with the shares p and 1 - p the variance is p (1 - p), whatever the spread: p tells only by how many
    standard deviations z the mean lies off the step between them. Fewer than 30 values beyond the next step, one DN
    further, say that the spread is below 1 / (z + q), with q the quantile of 30 in `n_values`.
    """
    from scipy.special import ndtri

    least = min(_ENOUGH / n_values, 0.5)
    share = mean_dn - float(np.floor(mean_dn))
    # Each value of a third DN adds 2 to the sum of squares.
    if variance_dn2 - share * (1 - share) > 2 * least:
        return None
    return float(1 / (abs(ndtri(min(max(share, least), 1 - least))) - ndtri(min(least, 0.1))))


def _temporal(mean_dn: float, spread: DarkSpread) -> float:
    """Mean over the pixels of the variance of their rounded values."""
    weight = np.exp(-(_PLACES**2) / 2)
    _, variance = rounded_moments(mean_dn + sqrt(max(spread.spatial_dn2, 0.0)) * _PLACES, spread.temporal_dn2)
    return float(np.average(variance, weights=weight))
