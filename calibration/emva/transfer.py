"""Overall system gain and responsivity: the two slopes of EMVA 1288."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from ...core.errors import CalibrationError
from ...core.quantity import Quantity
from ..sensor.noise import FIT_SHARE, slope_through_origin, weighted_gain
from .result import SaturationLimit, SeriesPoint, columns

#: Fewest points of a fit.
MIN_POINTS = 3
#: Saturation of a dense series.
_AT_PEAK = (
    "saturation capacity of EMVA 1288, at the peak of the temporal variance: the pixel's full well lies several times "
    "its noise higher"
)
#: Uncertainty of variances without noise, which still need one.
_FLOOR = 1e-9
#: Share of saturation between which linearity is judged (EMVA 1288 Release 4.0 Linear).
LINEARITY_SHARES = (0.05, 0.95)
#: Drop of the variance after its peak, in standard uncertainties, required of a peak.
_SIGNIFICANT = 4.0
#: Largest drop of the variance by clipping, over the share of clipped values: 2 to 2.6 for normal noise clipped at one
#: end, less where pixels differ.
_CLIPPED = 3.0
#: Points below the peak by less than this many standard uncertainties may be the peak.
_MAYBE_PEAK = 2.0
#: Points up to the peak whose scatter counts.
_NEIGHBOURS = 12


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


def system_gain(points: Sequence[SeriesPoint], weighted: bool = False) -> Quantity:
    """Overall system gain K in DN/e-: var - var_dark = K (mean - mean_dark), through the origin.

    Parameters
    ----------
    points : sequence of SeriesPoint
        Of `points_to_fit`.
    weighted : bool
        False for the least squares of the standard, True for `weighted_gain`, as the noise of a calibration.

    Returns
    -------
    Quantity
        Its uncertainty is based on the variance of the variances, 2 s^4 / dof for each point.

    Raises
    ------
    CalibrationError
        If K is not above 0: the noise does not grow with the signal.
    """
    net, excess, u = columns(points, "net_dn", "net_variance_dn2", "variance_uncertainty_dn2")
    if weighted:
        fit = weighted_gain(net, excess, *columns(points, "dark.temporal_variance_dn2", "light.dof", "dark.dof"))
    else:
        fit = slope_through_origin(net, excess, np.maximum(u, _FLOOR))
    if not fit.value > 0:
        raise _no_noise(f"K is {fit.value:.3g} DN/e-")
    note = f"photon transfer over {len(points)} points up to 70 % of saturation"
    return Quantity(fit.value, fit.u, "DN/e-", note)


def _no_noise(reason: str) -> CalibrationError:
    return CalibrationError(
        f"the temporal noise does not grow with the signal ({reason}): check that the images are different ones, not "
        "denoised, and light and dark not mixed up"
    )


def departure_rel(points: Sequence[SeriesPoint], k_dn_per_e: float) -> float:
    """Root mean square of the variances' relative deviations from the line, in excess of their uncertainty.

    Points below a tenth of the brightest one are left out: their noise is mostly that of dark signal.
    """
    values = columns(points, "net_dn", "net_variance_dn2", "variance_uncertainty_dn2")
    net, excess, u = values[:, values[0] >= 0.1 * values[0].max()]
    expected = k_dn_per_e * net
    return float(np.sqrt(max(np.mean((excess / expected - 1) ** 2) - np.mean((u / expected) ** 2), 0.0)))


def responsivity(points: Sequence[SeriesPoint]) -> Quantity | None:
    """Responsivity R in DN per photon: mean - mean_dark = R photons, through the origin.

    Returns
    -------
    Quantity or None
        None if the photons are not known. The uncertainty includes noise and scatter of the points, but not that of the
        photon numbers, which a data set does not state.
    """
    if any(point.photons is None for point in points):
        return None
    return slope_through_origin(*columns(points, "photons", "net_dn", "net_uncertainty_dn"))


@dataclass(frozen=True, eq=False)
class Deviations:
    """Relative deviations of signals from the line that they should be on.

    Parameters
    ----------
    net_dn : ndarray of float, shape (n,)
        The points judged, as signal above dark signal.
    deviation_rel : ndarray of float, shape (n,)
        Signal over line, minus 1.
    uncertainty_rel : ndarray of float, shape (n,)
        Standard uncertainty of the deviations by noise, black level and lamp.
    note : str
        On all of them; empty if each is stated at its signal.
    """

    net_dn: NDArray[np.float64]
    deviation_rel: NDArray[np.float64]
    uncertainty_rel: NDArray[np.float64]
    note: str = ""

    def errors(self) -> dict[str, Quantity]:
        """Lowest and highest deviation (LE_min and LE_max of Release 3.1), and LE, the mean of the absolute ones."""

        def extreme(i: int) -> Quantity:
            note = self.note or f"at {self.net_dn[i]:.4g} DN above the dark signal; u by noise, black level and lamp"
            return Quantity(float(self.deviation_rel[i]), float(self.uncertainty_rel[i]), "1", note)

        mean = float(np.abs(self.deviation_rel).mean())
        u_mean = float(np.linalg.norm(self.uncertainty_rel)) / self.uncertainty_rel.size
        return {
            "linearity_error_min_rel": extreme(int(np.argmin(self.deviation_rel))),
            "linearity_error_max_rel": extreme(int(np.argmax(self.deviation_rel))),
            "linearity_error_rel": Quantity(mean, u_mean, "1", self.note or "mean of the absolute deviations"),
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class Linearity(Deviations):
    """Deviations from a line over the stimulus.

    Parameters
    ----------
    intercept_dn, slope_dn : float
        The line: intercept, and slope over photons or seconds.
    stimulus : ndarray of float, shape (n,)
        Photons or seconds of the points.
    """

    intercept_dn: float
    slope_dn: float
    stimulus: NDArray[np.float64]


def in_range(points: Sequence[SeriesPoint], saturation_net_dn: float) -> list[SeriesPoint]:
    """Points from 5 to 95 % of saturation."""
    low, high = (share * saturation_net_dn for share in LINEARITY_SHARES)
    return [point for point in points if low <= point.net_dn <= high]


def linearity(points: Sequence[SeriesPoint], saturation_net_dn: float) -> Linearity | None:
    """Judge the linearity of a series (EMVA 1288 Release 4.0 Linear).

    The line y = a + b x over the photons, or over the exposure where they are not known, minimises the relative
    deviations, sum(((y - a - b x) / y)^2), from 5 to 95 % of saturation. The deviations are (y - line) / line.

    Parameters
    ----------
    points : sequence of SeriesPoint
        In rising order.
    saturation_net_dn : float
        Signal above dark signal at saturation.

    Returns
    -------
    Linearity or None
        None with fewer than three points.
    """
    x, y, u = columns(in_range(points, saturation_net_dn), "stimulus", "net_dn", "net_uncertainty_dn")
    if x.size < 3 or np.unique(x).size < 2:
        return None
    scale = x.max()
    design = np.column_stack([1 / y, x / scale / y])
    intercept, slope = np.linalg.lstsq(design, np.ones_like(y))[0]
    fitted = intercept + slope * x / scale
    # The fit follows each point by its leverage h: the noise of the deviation is reduced accordingly.
    projection = design @ np.linalg.pinv(design)
    left = np.eye(y.size) - projection
    uncertainty = np.sqrt((left**2) @ (u / y) ** 2)
    slope = float(slope / scale)
    return Linearity(y, y / fitted - 1, uncertainty, intercept_dn=float(intercept), slope_dn=slope, stimulus=x)


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
    net_dn, net_uncertainty_dn : float
        Its signal above dark with its standard uncertainty.
    definition : str
        Definition of saturation used.
    """

    index: int
    limit: SaturationLimit
    net_dn: float
    net_uncertainty_dn: float
    definition: str


def find_saturation(points: Sequence[SeriesPoint]) -> Saturation:
    """Find the point of saturation: the largest temporal variance above dark (EMVA 1288 Release 4.0 Linear).

    Beyond it pixels reach the end of the converter, or are full, and their noise vanishes. The error is rectangular: it
    reaches half a step beyond the points whose variance is that of the peak but for noise and scatter.

    Parameters
    ----------
    points : sequence of SeriesPoint
        At least one, in rising order of signal.

    Raises
    ------
    CalibrationError
        If none has more temporal noise than its dark signal.
    """
    x, excess, u = columns(points, "stimulus", "net_variance_dn2", "variance_uncertainty_dn2")
    index = int(np.argmax(excess))
    if excess[index] <= 0:
        raise _no_noise("no image has more than the dark images")
    falls = excess[index] - excess[index + 1 :] > _SIGNIFICANT * np.hypot(u[index], u[index + 1 :])
    limit: SaturationLimit = "not reached"
    if falls.any():
        drop_rel = 1 - points[-1].light.temporal_variance_dn2 / points[index].light.temporal_variance_dn2
        limit = "converter" if drop_rel <= _CLIPPED * points[-1].light.saturated_share else "full well"
    level = excess[index] - _MAYBE_PEAK * sqrt(2) * max(float(u[index]), _scatter_dn2(excess[: index + 1]))
    first, last = np.flatnonzero(excess >= level)[[0, -1]]
    low, high = x[first] + x[max(first - 1, 0)], x[last] + x[min(last + 1, x.size - 1)]
    net, u_rel = points[index].net_dn, float((high - low) / 4 / sqrt(3) / x[index])
    return Saturation(index, limit, net, u_rel * net, _AT_PEAK)


def _scatter_dn2(excess: NDArray[np.float64]) -> float:
    """Return the standard deviation of the variances around a smooth curve, by their second differences."""
    curved = np.diff(excess[-_NEIGHBOURS:], n=2)
    return float(np.sqrt(np.mean(curved**2) / 6)) if curved.size else 0.0
