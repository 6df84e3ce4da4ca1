"""Fit of the dark signal over exposure and temperature."""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from ...core.finding import Finding, warning
from .checks import DRIFT_DN, contradictions, falling
from .lines import line

#: Smallest temperature difference of dark frames for fitting the temperature dependence of the dark current.
MIN_TEMPERATURE_SPAN_C = 3.0
#: Standard uncertainties 1 / T_d must be above zero to be used.
_DOUBLING_LIMIT = 3.0
#: Assumed without such dark frames: the dark current of silicon doubles every 5 to 10 degC (EMVA 1288 Release 4.0
#: Linear, dark current; J. Janesick, Photon Transfer, 2007), and a third of that growth is its standard uncertainty.
TYPICAL_DOUBLING_C = 7.5
DOUBLING_REL = 1 / 3


def fit_curve(
    t: NDArray[np.float64], warmer_c: NDArray[np.float64], y: NDArray[np.float64], u: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], list[Finding]]:
    """Offset, rate and 1 / T_d with their covariance; that of 1 / T_d is 0 where it is not determined."""
    typical = 1 / TYPICAL_DOUBLING_C
    if np.unique(t).size == 1:
        constant = line(np.zeros_like(t), y, u)
        found = [warning("dark-one-exposure", exposure_s=float(t[0]))]
        return np.array([constant.intercept, 0.0, typical]), np.diag([constant.covariance[0, 0], 0.0, 0.0]), found
    fitted = _with_temperature(t, warmer_c, y, u) if np.ptp(warmer_c) >= MIN_TEMPERATURE_SPAN_C else None
    if fitted is None:
        straight = line(t * 2 ** (warmer_c * typical), y, u)
        covariance = np.zeros((3, 3))
        covariance[:2, :2] = straight.covariance
        fitted = np.array([straight.intercept, straight.slope, typical]), covariance
    parameters, covariance = fitted
    residuals = y - parameters[0] - parameters[1] * t * 2 ** (warmer_c * parameters[2])
    grown = t * 2 ** (warmer_c * parameters[2])
    n_parameters = 3 if covariance[2, 2] > 0 else 2
    findings = contradictions(t, grown, y, u, residuals, n_parameters)
    return parameters, covariance, findings + falling(t, float(parameters[1]), sqrt(covariance[1, 1]))


def _with_temperature(
    t: NDArray[np.float64], warmer_c: NDArray[np.float64], y: NDArray[np.float64], u: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Least squares of all three parameters; None if the dark frames do not determine them."""
    from scipy.optimize import least_squares

    start = line(t, y, u)
    if start.slope <= 0 or t.size < 3:
        return None
    scale = np.array([1.0, start.slope, 1.0])

    def residuals(p: NDArray[np.float64]) -> NDArray[np.float64]:
        offset, rate, inverse = p * scale
        model: NDArray[np.float64] = (offset + rate * t * 2 ** np.clip(warmer_c * inverse, -30, 30) - y) / u
        return model

    # EMVA 1288: the dark current doubles every 5 to 10 degC.
    fit = least_squares(residuals, (start.intercept, 1.0, 1 / 8), x_scale="jac")
    jacobian = np.asarray(fit.jac, dtype=np.float64)
    if np.linalg.matrix_rank(jacobian / np.abs(jacobian).max(axis=0), tol=1e-6 * sqrt(t.size)) < 3:
        return None
    birge2 = max(1.0, 2 * fit.cost / (t.size - 3)) if t.size > 3 else 1.0
    covariance = np.asarray(np.linalg.inv(jacobian.T @ jacobian), np.float64) * birge2 * np.outer(scale, scale)
    parameters: NDArray[np.float64] = np.asarray(fit.x, dtype=np.float64) * scale
    known = parameters[2] > _DOUBLING_LIMIT * sqrt(covariance[2, 2]) and parameters[1] > 0
    return (parameters, covariance) if known else None


def of_unknown_rate(exposure_s: float, above_black_dn: float) -> NDArray[np.float64]:
    """Covariance of a line of unknown rate through the mean at one exposure; shape (3, 3)."""
    rate_dn_s = max(abs(above_black_dn), DRIFT_DN) / exposure_s
    error = np.array([-rate_dn_s * exposure_s, rate_dn_s, 0.0])
    return np.outer(error, error)


def of_rounding(rounding_dn2: float, span_s: float) -> NDArray[np.float64]:
    """Covariance by rounding, whose errors at neighbouring signals are alike and so tilt the line; shape (3, 3)."""
    error = sqrt(rounding_dn2) * np.array([1.0, -2 / span_s, 0.0])
    return np.outer(error, error)
