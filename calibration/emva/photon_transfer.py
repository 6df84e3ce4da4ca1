"""Overall system gain and responsivity: the two slopes of EMVA 1288."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from ...core.errors import CalibrationError
from ..dark.lines import birge
from .series import SeriesPoint

#: Share of saturation up to which both slopes are fitted (EMVA 1288 Release 4.0 Linear).
FIT_SHARE = 0.7
#: Fewest points of a fit.
MIN_POINTS = 3


@dataclass(frozen=True)
class Slope:
    """y = `value` x, with its standard uncertainty."""

    value: float
    standard_uncertainty: float


def slope_through_origin(
    x: NDArray[np.float64], y: NDArray[np.float64], u: NDArray[np.float64], weighted: bool = False
) -> Slope:
    """Fit a line through the origin.

    Parameters
    ----------
    x, y, u : ndarray of float, shape (n,)
        Points, and the standard uncertainties of y, above 0.
    weighted : bool
        False for the least squares of EMVA 1288, all points alike; True weights with 1 / u^2, for points whose
        uncertainties differ by orders.

    Returns
    -------
    Slope
        b = sum(w x y) / sum(w x^2). The uncertainty is propagated from u, sqrt(sum((w x u)^2)) / sum(w x^2), and
        widened by the Birge ratio if the points scatter more than u says.
    """
    weight = 1 / u**2 if weighted else np.ones_like(x)
    normal = float(np.sum(weight * x**2))
    slope = float(np.sum(weight * x * y)) / normal
    propagated = sqrt(float(np.sum((weight * x * u) ** 2))) / normal
    return Slope(slope, propagated * birge(float(np.sum(((y - slope * x) / u) ** 2)), x.size - 1))


def points_to_fit(points: Sequence[SeriesPoint], saturation_net_dn: float) -> list[SeriesPoint]:
    """Points from dark signal to 70 % of saturation.

    Raises
    ------
    CalibrationError
        If there are fewer than three.
    """
    chosen = [point for point in points if 0 < point.net_dn <= FIT_SHARE * saturation_net_dn]
    if len(chosen) < MIN_POINTS:
        raise CalibrationError(
            f"{len(chosen)} of {len(points)} points lie between dark and {FIT_SHARE:.0%} of saturation: record at "
            f"least {MIN_POINTS} exposures there, better 10"
        )
    return chosen


def system_gain(points: Sequence[SeriesPoint], weighted: bool = False) -> Slope:
    """Overall system gain K in DN/e-: var - var_dark = K (mean - mean_dark), through the origin.

    Parameters
    ----------
    points : sequence of SeriesPoint
        Of `points_to_fit`.
    weighted : bool
        As `slope_through_origin`.

    Returns
    -------
    Slope
        Its uncertainty is based on the variance of the variances, 2 s^4 / dof for each point.

    Raises
    ------
    CalibrationError
        If K is not above 0: the noise does not grow with the signal.
    """
    net = np.array([point.net_dn for point in points])
    excess = np.array([point.net_variance_dn2 for point in points])
    fit = slope_through_origin(net, excess, np.array([_uncertainty(point, 0.0) for point in points]))
    if weighted and fit.value > 0:
        # Weights from the fitted line: weights from the points would be biased towards low values.
        for _ in range(3):
            smooth = np.array([_expected_uncertainty(point, fit.value) for point in points])
            fit = slope_through_origin(net, excess, smooth, weighted=True)
    if not fit.value > 0:
        raise _no_noise(f"K is {fit.value:.3g} DN/e-")
    return fit


def require_noise(points: Sequence[SeriesPoint]) -> None:
    """Raise CalibrationError if no point has more temporal noise than dark signal."""
    if not any(point.net_variance_dn2 > 0 for point in points):
        raise _no_noise("no image has more than the dark images")


def _no_noise(found: str) -> CalibrationError:
    return CalibrationError(
        f"the temporal noise does not grow with the signal ({found}): check that the images are different ones, not "
        "denoised, and light and dark not mixed up"
    )


def departure_rel(points: Sequence[SeriesPoint], k_dn_per_e: float) -> float:
    """Root mean square of the variances' relative deviations from the line, in excess of their uncertainty.

    Points below a tenth of the brightest one are left out: their noise is mostly that of dark signal.
    """
    bright = [point for point in points if point.net_dn >= 0.1 * max(other.net_dn for other in points)]
    expected = np.array([k_dn_per_e * point.net_dn for point in bright])
    departure = np.array([point.net_variance_dn2 for point in bright]) / expected - 1
    chance = np.array([point.variance_uncertainty_dn2 for point in bright]) / expected
    return float(np.sqrt(max(np.mean(departure**2) - np.mean(chance**2), 0.0)))


def responsivity(points: Sequence[SeriesPoint]) -> Slope | None:
    """Responsivity R in DN per photon: mean - mean_dark = R photons, through the origin.

    Returns
    -------
    Slope or None
        None if the photons are not known. The uncertainty includes noise and scatter of the points, but not that of the
        photon numbers, which a data set does not state.
    """
    known = [(point.photons, point) for point in points if point.photons is not None]
    if len(known) < len(points):
        return None
    photons = np.array([photons for photons, _ in known])
    net = np.array([point.net_dn for point in points])
    return slope_through_origin(photons, net, np.array([point.net_uncertainty_dn for point in points]))


def _uncertainty(point: SeriesPoint, k: float) -> float:
    floor = 1e-9  # images without noise still need a weight
    return max(float(np.hypot(point.variance_uncertainty_dn2, k * point.net_uncertainty_dn)), floor)


def _expected_uncertainty(point: SeriesPoint, k: float) -> float:
    dark = point.dark.variance_dn2
    return sqrt(2 * (k * point.net_dn + dark) ** 2 / point.light.dof + 2 * dark**2 / point.dark.dof)
