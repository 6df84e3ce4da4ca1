"""Spatial non-uniformity: DSNU and PRNU, and their parts by row, column and pixel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import copysign, hypot, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..frames.nonuniformity import Estimate, SpatialVariance, spatial_variance
from ..frames.rounding import Range, variance_before_rounding
from ..frames.statistics import FrameStatistics, LineVariances
from .result import Quantity

#: Parts of a spatial variance.
PARTS = ("pixel", "column", "row")


def dsnu_e(variance: Estimate, k: Quantity, note: str = "") -> Quantity:
    """DSNU in electrons: sqrt(s_dark^2) / K (EMVA 1288 Release 4.0 Linear)."""
    root, uncertainty = _root(variance)
    value = root / k.value
    relative = (k.standard_uncertainty / k.value) * value
    return Quantity(value, float(np.hypot(uncertainty / k.value, relative)), "e-", _note(variance, note))


def dsnu_parts(
    variance: SpatialVariance, k: Quantity, temporal_dn2: float, spatial_dn2: float, note: str
) -> dict[str, Any]:
    """DSNU_1288 and its parts, their uncertainties widened by rounding, where the dark noise is below about a DN.

    Parameters
    ----------
    variance : SpatialVariance
        Of the dark image.
    k : Quantity
        Overall system gain.
    temporal_dn2, spatial_dn2 : float
        Temporal variance of dark signal, and variance of its mean image, as rounded.
    note : str
        Of the total.
    """
    by_rounding = rounding_of_spread_dn(temporal_dn2, spatial_dn2) / k.value
    whole = dsnu_e(variance.total, k, note)
    found = {"dsnu_e": replace(whole, standard_uncertainty=hypot(whole.standard_uncertainty, by_rounding))}
    for name in PARTS:
        one = dsnu_e(getattr(variance, name), k)
        share = abs(one.value / whole.value) if whole.value else 1.0
        u = hypot(one.standard_uncertainty, by_rounding * share)
        found[f"dsnu_{name}_e"] = replace(one, standard_uncertainty=u)
    return found


def rounding_of_spread_dn(temporal_dn2: float, spatial_dn2: float) -> float:
    """Return the standard uncertainty by rounding of the pattern's standard deviation."""
    together, alone = variance_before_rounding(temporal_dn2 + spatial_dn2), variance_before_rounding(temporal_dn2)
    left = Range(max(together.least - alone.largest, 0.0), max(together.largest - alone.least, 0.0)).root()
    return left.error_of(sqrt(spatial_dn2))


def prnu_rel(bright: Estimate, dark: Estimate, net_dn: float, note: str = "") -> Quantity:
    """PRNU_1288 as a fraction: sqrt(s_y^2 - s_y.dark^2) / (mu_y - mu_y.dark) (Release 4.0 Linear)."""
    difference = bright - dark
    root, uncertainty = _root(difference)
    return Quantity(root / net_dn, uncertainty / net_dn, "1", _note(difference, note))


def _root(variance: Estimate) -> tuple[float, float]:
    """Square root with its sign and uncertainty; where the variance is not significant, the root of its uncertainty."""
    root = copysign(sqrt(abs(variance.value)), variance.value)
    if abs(variance.value) <= variance.uncertainty:
        return root, sqrt(variance.uncertainty)
    return root, variance.uncertainty / (2 * abs(root))


def _note(variance: Estimate, note: str) -> str:
    if variance.value > variance.uncertainty:
        return note
    found = "not more than temporal noise leaves"
    if variance.value < 0:
        found = "less than temporal noise leaves: minus the root of a variance below 0"
    return f"{note}, {found}" if note else found


def dark_pattern_variances(
    frames: Sequence[FrameStatistics], exposures_s: Sequence[float]
) -> tuple[SpatialVariance, SpatialVariance]:
    """Spatial variances of the dark signal at zero exposure, in DN^2, and of its growth, in (DN/s)^2.

    Each pixel's dark signal is fitted by a line over the exposure, all exposures alike.

    Parameters
    ----------
    frames : sequence of FrameStatistics
        Dark frames for each exposure, of two exposures at least.
    exposures_s : sequence of float
        Exposure times.
    """
    t = np.array(exposures_s)
    found = []
    for weights in np.linalg.pinv(np.column_stack([np.ones_like(t), t])):
        image, noise = np.zeros(frames[0].shape), np.zeros(3)
        for weight, one in zip(weights, frames, strict=True):
            image += weight * one.image_dn
            noise += weight**2 / one.n_frames * np.array([one.temporal.pixel, one.temporal.column, one.temporal.row])
        found.append(spatial_variance(image, LineVariances(*noise.tolist())))
    return found[0], found[1]


def flat_variance(
    values: NDArray[np.floating[Any]],
    rows: NDArray[np.integer[Any]],
    columns: NDArray[np.integer[Any]],
    noise_dn2: float,
) -> Estimate:
    """Variance from pixel to pixel of a patch, its slow gradients subtracted.

    A surface of second order in row and column is fitted and removed; it removes vignetting and non-uniform light, but
    only 6 degrees of freedom.

    Parameters
    ----------
    values : ndarray of float, shape (n,)
        Mean of the patch's pixels, n above 6.
    rows, columns : ndarray of int, shape (n,)
        Their places.
    noise_dn2 : float
        Contribution of temporal noise to a value.

    Returns
    -------
    Estimate
        May be below 0.
    """
    y, x = (2 * (place - place.min()) / max(np.ptp(place), 1) - 1 for place in (rows, columns))
    surface = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    fitted, *_ = np.linalg.lstsq(surface, values)
    dof = values.size - surface.shape[1]
    measured = float(np.sum((values - surface @ fitted) ** 2)) / dof
    return Estimate(measured - noise_dn2, measured * sqrt(2 / dof))


def combined(estimates: Sequence[Estimate]) -> Estimate:
    """Mean of independent estimates, weighted with the inverse squares of their uncertainties."""
    weights = [1 / estimate.uncertainty**2 for estimate in estimates]
    value = sum(weight * estimate.value for weight, estimate in zip(weights, estimates, strict=True))
    return Estimate(value / sum(weights), 1 / sqrt(sum(weights)))
