"""Overall system gain and responsivity: the two slopes EMVA 1288 rests on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...errors import CalibrationError
from .fits import Slope, slope_through_origin
from .result import SeriesPoint

#: Share of saturation up to which both slopes are fitted (EMVA 1288 Release 3.1, sections 6.6 and 6.7).
FIT_SHARE = 0.7
#: Fewest points of a fit.
MIN_POINTS = 3


def points_to_fit(points: Sequence[SeriesPoint], saturation_net_dn: float) -> list[SeriesPoint]:
    """Points from darkness to 70 % of saturation.

    Raises
    ------
    CalibrationError
        If there are fewer than three.
    """
    chosen = [point for point in points if 0 < point.net_dn <= FIT_SHARE * saturation_net_dn]
    if len(chosen) < MIN_POINTS:
        raise CalibrationError(
            f"{len(chosen)} of {len(points)} points lie between darkness and {FIT_SHARE:.0%} of saturation: record at "
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
        Its uncertainty rests on the variance of the variances, 2 s^4 / freedom for each point.

    Raises
    ------
    CalibrationError
        If K is not above 0: the noise does not grow with the signal.
    """
    net = np.array([point.net_dn for point in points])
    excess = np.array([point.net_variance_dn2 for point in points])
    fit = slope_through_origin(net, excess, np.array([_uncertainty(point, 0.0) for point in points]))
    if weighted and fit.value > 0:
        # Weights from the fitted line: weights from the points themselves would favour those that came out low.
        for _ in range(3):
            smooth = np.array([_expected_uncertainty(point, fit.value) for point in points])
            fit = slope_through_origin(net, excess, smooth, weighted=True)
    if not fit.value > 0:
        raise _no_noise(f"K is {fit.value:.3g} DN/e-")
    return fit


def require_noise(points: Sequence[SeriesPoint]) -> None:
    """Raise CalibrationError if no point has more temporal noise than darkness."""
    if not any(point.net_variance_dn2 > 0 for point in points):
        raise _no_noise("no image has more than those in darkness")


def _no_noise(found: str) -> CalibrationError:
    return CalibrationError(
        f"the temporal noise does not grow with the signal ({found}): check that the images are different ones, not "
        "denoised, and light and dark not mixed up"
    )


def departure_rel(points: Sequence[SeriesPoint], k_dn_per_e: float) -> float:
    """Root mean square of the variances' relative departures from the line, beyond what chance explains.

    Points below a tenth of the brightest one are left out: their noise is mostly that of darkness.
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
        None if the photons are not known. The uncertainty holds noise and scatter of the points, not that of the
        photon numbers, which a data set does not tell.
    """
    known = [(point.photons, point) for point in points if point.photons is not None]
    if len(known) < len(points):
        return None
    photons = np.array([photons for photons, _ in known])
    net = np.array([point.net_dn for point in points])
    return slope_through_origin(photons, net, np.array([point.net_uncertainty_dn for point in points]))


def _uncertainty(point: SeriesPoint, k: float) -> float:
    floor = 1e-9  # images without any noise still need a weight
    return max(float(np.hypot(point.variance_uncertainty_dn2, k * point.net_uncertainty_dn)), floor)


def _expected_uncertainty(point: SeriesPoint, k: float) -> float:
    light = k * point.net_dn + point.dark_variance_dn2
    freedom = max((point.n_pixels - 1) * (point.n_frames - 1), 1)
    dark_freedom = max((point.dark_n_pixels - 1) * (point.dark_n_frames - 1), 1)
    return float(np.sqrt(2 * light**2 / freedom + 2 * point.dark_variance_dn2**2 / dark_freedom))
