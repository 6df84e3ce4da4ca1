"""Fit of the dark signal over exposure and temperature."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.result import Finding, warning
from ..frames.observations import DarkObservation
from ..frames.rounding import ROUNDING_DN2, variance_before_rounding
from ..uncertainty import SMALL_P_VALUE, p_value_of_chi_squared

#: Smallest temperature difference of dark frames for fitting the temperature dependence of the dark current.
MIN_TEMPERATURE_SPAN_C = 3.0
#: Standard uncertainties 1 / T_d must be above zero to be used.
_DOUBLING_LIMIT = 3.0
#: Assumed without such dark frames: the dark current of silicon doubles every 5 to 10 degC (EMVA 1288 Release 4.0
#: Linear, dark current; J. Janesick, Photon Transfer, 2007), and a third of that growth is its standard uncertainty.
TYPICAL_DOUBLING_C = 7.5
DOUBLING_REL = 1 / 3
#: Temperatures that a camera may have where one is not stated: that of the dark frames, and this much more or less. A
#: judgement: that range of a room, or what a camera warms by after it is switched on.
UNKNOWN_WITHIN_K = 10.0
#: Largest difference of mean dark signal by normal drift of the black level.
DRIFT_DN = 0.5
Array = NDArray[np.float64]


class DarkCurrent:
    """Dark current that doubles with the temperature (EMVA 1288 Release 4.0 Linear, equation for mu_I(T))."""

    temperature_c: float | None
    doubling_temperature_c: float | None

    def growth(self, temperature_c: float | None) -> float:
        """Return the dark current over that at T_ref; 1 if either temperature is unknown."""
        if temperature_c is None or self.temperature_c is None:
            return 1.0
        return self._growth_by(temperature_c - self.temperature_c)

    def _growth_by(self, warmer_k: float) -> float:
        return growth_by(warmer_k, self.doubling_temperature_c)


def growth_by(warmer_k: float, doubling_temperature_c: float | None) -> float:
    """Return the dark current over that at a temperature lower by so much; None for a typical doubling."""
    return float(2.0 ** (warmer_k / (doubling_temperature_c or TYPICAL_DOUBLING_C)))


def fit_curve(darks: Sequence[DarkObservation], warmer_c: Array, drift_dn: float) -> tuple[Array, Array, list[Finding]]:
    """Offset, rate and 1 / T_d with their covariance; that of 1 / T_d is 0 where it is not determined."""
    t, y = np.array([d.exposure_s for d in darks]), np.array([d.mean_dn for d in darks])
    u, typical = mean_uncertainties_dn(darks, drift_dn), 1 / TYPICAL_DOUBLING_C
    if np.unique(t).size == 1:
        constant = line(np.zeros_like(t), y, u)
        # What is above the nominal black level may be dark current.
        rate_dn_s = max(abs(constant.intercept - darks[0].state.nominal_black_dn), DRIFT_DN) / t[0]
        error = rate_dn_s * np.array([-t[0], 1.0, 0.0])
        covariance = np.diag([constant.covariance[0, 0], 0.0, 0.0]) + np.outer(error, error)
        findings = [warning("dark-one-exposure", exposure_s=float(t[0]))]
        return np.array([constant.intercept, 0.0, typical]), covariance, findings
    fitted = _with_temperature(t, warmer_c, y, u) if np.ptp(warmer_c) >= MIN_TEMPERATURE_SPAN_C else None
    if fitted is None:
        straight = line(t * 2 ** (warmer_c * typical), y, u)
        covariance = np.zeros((3, 3))
        covariance[:2, :2] = straight.covariance
        fitted = np.array([straight.intercept, straight.slope, typical]), covariance
    parameters, covariance = fitted
    grown = t * 2 ** (warmer_c * parameters[2])
    residuals = y - parameters[0] - parameters[1] * grown
    dof = t.size - (3 if covariance[2, 2] > 0 else 2)
    findings = _contradictions(t, residuals, dof, (grown, y, u))
    if parameters[1] * np.ptp(t) < -DRIFT_DN and parameters[1] < -3 * sqrt(covariance[1, 1]):
        findings.append(warning("dark-falls", rate_dn_s=-float(parameters[1])))
    # Errors by rounding at neighbouring signals are alike and so tilt the line.
    error = sqrt(max(d.rounding_dn2 for d in darks)) * np.array([1.0, -2 / float(np.ptp(t)), 0.0])
    return parameters, covariance + np.outer(error, error), findings


def _with_temperature(t: Array, warmer_c: Array, y: Array, u: Array) -> tuple[Array, Array] | None:
    """Least squares of all three parameters; None if the dark frames do not determine them."""
    from scipy.optimize import least_squares

    start = line(t, y, u)
    if start.slope <= 0 or t.size < 3:
        return None
    scale = np.array([1.0, start.slope, 1.0])

    def residuals(p: Array) -> Array:
        offset, rate, inverse = p * scale
        model: Array = (offset + rate * t * 2 ** np.clip(warmer_c * inverse, -30, 30) - y) / u
        return model

    # EMVA 1288: the dark current doubles every 5 to 10 degC.
    fit = least_squares(residuals, (start.intercept, 1.0, 1 / 8), x_scale="jac")
    jacobian = np.asarray(fit.jac, dtype=np.float64)
    if np.linalg.matrix_rank(jacobian / np.abs(jacobian).max(axis=0), tol=1e-6 * sqrt(t.size)) < 3:
        return None
    birge2 = max(1.0, 2 * fit.cost / (t.size - 3)) if t.size > 3 else 1.0
    covariance = np.asarray(np.linalg.inv(jacobian.T @ jacobian), np.float64) * birge2 * np.outer(scale, scale)
    parameters: Array = np.asarray(fit.x, dtype=np.float64) * scale
    known = parameters[2] > _DOUBLING_LIMIT * sqrt(covariance[2, 2]) and parameters[1] > 0
    return (parameters, covariance) if known else None


def _contradictions(t: Array, residuals: Array, dof: int, points: tuple[Array, Array, Array]) -> list[Finding]:
    """Warn of dark frames that scatter around the line more than noise and drift explain.

    Parameters
    ----------
    t, residuals : ndarray of float, shape (n,)
        Exposures, and deviations from the fit.
    dof : int
        Degrees of freedom of these.
    points : tuple of ndarray of float, shape (n,)
        Exposures times the growth of the dark current with the temperature, means, and their standard uncertainties.
    """
    largest_dn = float(np.abs(residuals).max())
    p_value = p_value_of_chi_squared(float(np.sum((residuals / points[2]) ** 2)), dof)
    if p_value >= SMALL_P_VALUE or largest_dn <= DRIFT_DN:
        return []
    # Exposure without which a line fits best; residuals are misleading at the ends of the range.
    left = [line(*(np.delete(column, i) for column in points)).chi_squared for i in range(t.size)]
    return [warning("dark-contradicts", exposure_s=float(t[int(np.argmin(left))]), deviation_dn=largest_dn)]


@dataclass(frozen=True)
class Line:
    """y = `intercept` + `slope` x.

    Parameters
    ----------
    intercept, slope : float
        The line.
    covariance : ndarray of float, shape (2, 2)
        Of intercept and slope.
    chi_squared : float
        Sum of squared deviations over the variances of the points.
    """

    intercept: float
    slope: float
    covariance: Array
    chi_squared: float


def line(x: Array, y: Array, u: Array) -> Line:
    """Fit a line, points weighted with 1 / u^2; a constant if all x are equal.

    Parameters
    ----------
    x, y, u : ndarray of float, shape (n,)
        Points, and the standard uncertainties of y, above 0.

    Returns
    -------
    Line
        Its covariance is widened by the Birge ratio squared if the points scatter more than u says. The slope of a
        constant is 0 with unknown uncertainty (nan).
    """
    n = 2 if np.ptp(x) > 0 else 1
    parameters, covariance = np.polyfit(x, y, n - 1, w=1 / u, cov="unscaled")
    chi_squared = float(np.sum(((y - np.polyval(parameters, x)) / u) ** 2))
    covariance = covariance[::-1, ::-1] * birge(chi_squared, x.size - n) ** 2
    if n == 1:
        return Line(float(parameters[0]), 0.0, np.diag([covariance[0, 0], np.nan]), chi_squared)
    return Line(float(parameters[1]), float(parameters[0]), covariance, chi_squared)


def as_rows(matrix: NDArray[np.floating[Any]]) -> Any:
    """Return a matrix as tuples."""
    return tuple(map(tuple, matrix.tolist()))


def birge(chi_squared: float, dof: int) -> float:
    """Birge ratio sqrt(chi^2 / dof), at least 1."""
    return max(1.0, sqrt(chi_squared / dof)) if dof > 0 else 1.0


def black_level_drift(darks: Sequence[DarkObservation]) -> tuple[float, int]:
    """Return the standard deviation of the black level from frame to frame, and its degrees of freedom."""
    freedoms = [d.n_frames - 1 for d in darks]
    if sum(freedoms) == 0:
        return 0.0, 0
    excess = [d.frame_means_variance_dn2 - d.mean_noise_dn2 for d in darks]
    return sqrt(max(float(np.average(excess, weights=freedoms)), 0.0)), sum(freedoms)


def mean_uncertainties_dn(darks: Sequence[DarkObservation], drift_dn: float) -> Array:
    """Return the standard uncertainties of means by noise, drift of the black level and rounding."""
    variances = [(d.mean_noise_dn2 + drift_dn**2) / d.n_frames + d.rounding_dn2 for d in darks]
    # Frames without noise still need a weight; the floor is far below any real uncertainty.
    return np.sqrt(np.maximum(variances, 1e-12))


def noise_line(darks: Sequence[DarkObservation], growth: Array) -> Line:
    """Fit the temporal variance over the exposure, times the growth of the dark current; constant unless it rises."""
    t, variance = np.array([d.exposure_s for d in darks]) * growth, np.array([d.temporal_variance_dn2 for d in darks])
    u = variance_uncertainties_dn2(darks)
    if np.ptp(t) > 0:
        rising = line(t, variance, u)
        if rising.slope > 0 and rising.intercept > 0:
            return rising
    return line(np.zeros_like(t), variance, u)


def variance_uncertainties_dn2(darks: Sequence[DarkObservation]) -> Array:
    """Return the uncertainties of normal variances, of rounding at least, with what rounding may have changed."""
    steps_dn2 = np.array([d.step_dn**2 for d in darks])
    by_frames = [max(d.temporal_variance_dn2, d.rounding_dn2_of_pixel) * sqrt(2 / d.dof) for d in darks]
    in_steps = [d.temporal_variance_dn2 / d.step_dn**2 for d in darks]
    by_rounding = [variance_before_rounding(v).error_of(v - ROUNDING_DN2) for v in in_steps]
    return np.hypot(by_frames, steps_dn2 * by_rounding)
