"""Dark current, read noise and black level from darkness over the exposure time, and over temperature."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import log, sqrt

import numpy as np

from ..rounding import DITHERED_DN2, ROUNDING_DN2, mean_before_rounding, variance_before_rounding
from .fits import FloatArray, Line, line
from .result import DarkPoint, Quantity

#: A variance of darkness below this, in DN^2, is mostly rounding (EMVA 1288 Release 3.1, section 6.5: sigma < 0.5 DN).
LEAST_VARIANCE_DN2 = 0.24
#: Shares of the range of spreads before rounding for which the means are worked out.
_SHARES = (0.1, 0.3, 0.5, 0.7, 0.9)
#: Temperatures closer than this, in kelvin, do not tell a doubling temperature.
LEAST_SPREAD_K = 5.0


@dataclass(frozen=True)
class Darkness:
    """What darkness says.

    Parameters
    ----------
    mean, variance : Line
        Mean in DN and variance in DN^2 over the exposure in seconds; slope 0 with unknown uncertainty (nan) where there
        is one exposure only.
    n_exposures : int
        How many different ones.
    """

    mean: Line
    variance: Line
    n_exposures: int

    def black_level_dn(self) -> Quantity:
        """Mean at zero exposure."""
        note = "at zero exposure" if self.n_exposures > 1 else "at the only exposure of darkness"
        return Quantity(self.mean.intercept, self.mean.intercept_uncertainty, "DN", note)

    def noise_dn(self) -> Quantity:
        """sigma_y.dark at zero exposure, at least that of rounding."""
        variance = max(self.variance.intercept, LEAST_VARIANCE_DN2)
        sigma = sqrt(variance)
        note = "at zero exposure" if self.n_exposures > 1 else "at the only exposure of darkness"
        if self.variance.intercept < LEAST_VARIANCE_DN2:
            note = "an upper limit: below 0.49 DN rounding hides the noise, this is the least value the standard allows"
        return Quantity(sigma, self.variance.intercept_uncertainty / (2 * sigma), "DN", note)

    def noise_e(self, k: Quantity) -> Quantity:
        """sigma_d: noise without rounding over K, sqrt(sigma_y.dark^2 - 1/12) / K (Release 3.1, section 2.4).

        Its uncertainty holds what rounding hides: all noise that can have left this variance is equally likely.
        """
        dark = self.noise_dn()
        own = sqrt(dark.value**2 - ROUNDING_DN2)
        by_noise = dark.value * dark.standard_uncertainty / own
        by_rounding = variance_before_rounding(self.variance.intercept).root().error_of(own)
        value = own / k.value
        relative = max(by_noise, by_rounding) / own
        uncertainty = value * sqrt(relative**2 + (k.standard_uncertainty / k.value) ** 2)
        return Quantity(value, uncertainty, "e-", f"{dark.note}, without rounding")

    def current_e_s(self, k: Quantity) -> Quantity | None:
        """Dark current by the mean, slope / K (Release 3.1, section 7.1); None with one exposure."""
        return self._current(self.mean, k, 1, "slope of the mean over the exposure")

    def current_by_variance_e_s(self, k: Quantity) -> Quantity | None:
        """Dark current by the variance, slope / K^2 (Release 3.1, section 7.1); None with one exposure."""
        return self._current(self.variance, k, 2, "slope of the variance over the exposure")

    def _current(self, fit: Line, k: Quantity, power: int, note: str) -> Quantity | None:
        if self.n_exposures < 2:
            return None
        value = fit.slope / k.value**power
        by_slope = fit.slope_uncertainty / k.value**power
        by_gain = power * value * k.standard_uncertainty / k.value
        return Quantity(value, float(np.hypot(by_slope, by_gain)), "e-/s", note)


def fit_darkness(points: Sequence[DarkPoint]) -> Darkness:
    """Fit mean and variance of darkness over the exposure.

    Parameters
    ----------
    points : sequence of DarkPoint
        At least one.

    Returns
    -------
    Darkness
        Uncertainties are those of the lines' fits: temporal noise, widened where the black level wanders, and where
        the noise is so small that rounding changes means and variances.
    """
    t = np.array([point.exposure_s for point in points])
    mean = np.array([point.mean_dn for point in points])
    u_mean = np.array([point.mean_uncertainty_dn for point in points])
    variance = np.array([point.variance_dn2 for point in points])
    u_variance = np.array([point.variance_uncertainty_dn2 for point in points])
    n_exposures = int(np.unique(t).size)
    if n_exposures < 2:
        line_of_mean = _constant(mean, u_mean)
        others = [_constant(other, u_mean) for other in _means_before_rounding(points)]
        return Darkness(_widened(line_of_mean, others), _constant(variance, u_variance), n_exposures)
    line_of_mean = line(t, mean, u_mean)
    others = [line(t, other, u_mean) for other in _means_before_rounding(points)]
    return Darkness(_widened(line_of_mean, others), line(t, variance, u_variance), n_exposures)


def _means_before_rounding(points: Sequence[DarkPoint]) -> list[FloatArray]:
    """Means as they may have been before rounding, for several spreads that can have left the variances."""
    rounded = [point.variance_dn2 + point.spatial_variance_dn2 for point in points]
    if min(rounded) >= DITHERED_DN2:
        return []
    ranges = [variance_before_rounding(value).root() for value in rounded]
    return [
        np.array(
            [
                mean_before_rounding(point.mean_dn, (own.least + share * (own.largest - own.least)) ** 2)
                for point, own in zip(points, ranges, strict=True)
            ]
        )
        for share in _SHARES
    ]


def _widened(stated: Line, others: Sequence[Line]) -> Line:
    """Add the mean square by which other lines, equally likely, are off a line."""
    if not others:
        return stated
    off = np.array([(other.intercept - stated.intercept, other.slope - stated.slope) for other in others])
    return Line(stated.intercept, stated.slope, stated.covariance + off.T @ off / len(others))


def _constant(y: FloatArray, u: FloatArray) -> Line:
    weight = 1 / u**2
    covariance = np.array([[1 / weight.sum(), 0.0], [0.0, np.nan]])
    return Line(float(np.average(y, weights=weight)), 0.0, covariance)


def doubling_temperature(points: Sequence[DarkPoint]) -> Quantity | None:
    """Doubling temperature from darkness at several temperatures: mu(T) = mu_ref 2^((T - T_ref) / T_d).

    The means over exposure and temperature are fitted by d + r t 2^((T - T_ref) / T_d) with three parameters (EMVA
    1288 Release 3.1, section 7.2), weighted by temporal noise. The uncertainties come from the fit's Jacobian, widened
    where the points scatter more.

    Parameters
    ----------
    points : sequence of DarkPoint
        Of at least two exposures; those without a temperature are left out.

    Returns
    -------
    Quantity or None
        T_d in kelvin; None if the temperatures lie within 5 K, or the dark current is too small to tell.
    """
    from scipy.optimize import least_squares

    known = [(point.temperature_c, point) for point in points if point.temperature_c is not None]
    temperature = np.array([value for value, _ in known])
    t = np.array([point.exposure_s for _, point in known])
    if len(known) < 4 or np.ptp(temperature) < LEAST_SPREAD_K or np.unique(t).size < 2:
        return None
    y = np.array([point.mean_dn for _, point in known])
    u = np.array([point.mean_uncertainty_dn for _, point in known])
    above = temperature - temperature.mean()
    start = line(t, y, u)
    if start.slope <= 0:
        return None

    def residuals(parameters: FloatArray) -> FloatArray:
        offset, log_rate, doublings_per_k = parameters
        model: FloatArray = (offset + np.exp(log_rate) * t * 2 ** (doublings_per_k * above) - y) / u
        return model

    fit = least_squares(residuals, (start.intercept, log(start.slope), 1 / 8), x_scale="jac")
    jacobian = np.asarray(fit.jac, dtype=np.float64)
    try:
        covariance = np.linalg.inv(jacobian.T @ jacobian) * max(1.0, 2 * fit.cost / max(t.size - 3, 1))
    except np.linalg.LinAlgError:
        return None
    per_k, u_per_k = float(fit.x[2]), sqrt(max(float(covariance[2, 2]), 0.0))
    # Three standard uncertainties from no growth at all, or the reciprocal means nothing.
    if not per_k > 3 * u_per_k:
        return None
    span = f"{temperature.min():.1f} to {temperature.max():.1f} degC"
    return Quantity(1 / per_k, u_per_k / per_k**2, "K", f"from darkness at {span}")
