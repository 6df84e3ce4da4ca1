"""Overall system gain and responsivity: the two slopes of EMVA 1288."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.errors import CalibrationError
from ..photon_transfer import FIT_SHARE, Slope, slope_through_origin, weighted_gain
from .series import SeriesPoint

#: Fewest points of a fit.
MIN_POINTS = 3
#: Uncertainty of variances without noise, which still need one.
_FLOOR = 1e-9


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
        False for the least squares of the standard, True for `weighted_gain`, as the noise of a calibration.

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
    if weighted:
        of_dark = np.array([point.dark.variance_dn2 for point in points])
        dof, dark_dof = (np.array(one, float) for one in zip(*((p.light.dof, p.dark.dof) for p in points), strict=True))
        fit = weighted_gain(net, excess, of_dark, dof, dark_dof)
    else:
        fit = slope_through_origin(net, excess, np.array([max(p.variance_uncertainty_dn2, _FLOOR) for p in points]))
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
