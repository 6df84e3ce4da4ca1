"""Darkness of the camera as a function of the exposure time, from dark frames."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import log, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import CalibrationError
from .dark_checks import WANDER_DN, clipping, contradictions, falling
from .observations import CameraState, DarkObservation

#: Dark frames whose temperatures differ by less than this do not tell how the dark current grows with it.
MIN_TEMPERATURE_SPAN_C = 3.0
#: Standard uncertainties 1 / T_d must be above zero to be used.
_DOUBLING_LIMIT = 3.0
#: Where the dark frames do not tell: the dark current of silicon doubles every 5 to 10 degC (EMVA 1288 Release 4.0
#: Linear, dark current; J. Janesick, Photon Transfer, 2007), and a third of that growth is its standard uncertainty.
TYPICAL_DOUBLING_C = 7.5
_DOUBLING_REL = 1 / 3
#: Warmer or colder than the dark frames by more than this the dark current is another, by a sixth or more.
_TEMPERATURE_TOLERANCE_C = 2.0
#: Growth of the darkness, in DN, that is worth a warning.
_WORTH_DN = 0.1
_MAX_ROUNDS = 50

Covariance = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]


@dataclass(frozen=True)
class DarkModel:
    """d(t, T) = `offset_dn` + `rate_dn_s` t 2^((T - T_ref) / T_d) (EMVA 1288 Release 4.0 Linear, dark current).

    Parameters
    ----------
    offset_dn, rate_dn_s : float
        DN at zero exposure, and its growth per second at T_ref (EMVA 1288: dark current, here times K).
    covariance : tuple of tuple of float
        Covariance of offset_dn, rate_dn_s and 1 / T_d, shape (3, 3).
    noise_dn : float
        Temporal noise of one pixel in darkness.
    nonuniformity_dn : float
        Standard deviation of slow changes of the darkness across the sensor.
    exposures_s : tuple of float
        Exposures of the dark frames, ascending.
    temperatures_c : tuple of float
        Temperatures of the sets of dark frames, ascending; empty if one is unknown.
    temperature_c : float or None
        T_ref, None if unknown.
    doubling_temperature_c : float or None
        T_d; None if the dark frames do not tell, `TYPICAL_DOUBLING_C` is then taken, and `covariance` is wide.
    patterns_dn : tuple of float
        Standard deviation of the darkness from pixel to pixel at each of `exposures_s` (EMVA 1288: DSNU, in DN), that
        a dark library leaves; empty for none.
    """

    offset_dn: float
    rate_dn_s: float
    covariance: Covariance
    noise_dn: float
    nonuniformity_dn: float
    exposures_s: tuple[float, ...]
    temperatures_c: tuple[float, ...] = ()
    temperature_c: float | None = None
    doubling_temperature_c: float | None = None
    patterns_dn: tuple[float, ...] = ()

    def mean_dn(self, exposure_s: float, temperature_c: float | None = None) -> float:
        """d(t, T) in DN; an unknown temperature is taken as T_ref."""
        return self.offset_dn + self.rate_dn_s * exposure_s * self._growth(temperature_c)

    def sensitivities(self, exposure_s: float, temperature_c: float | None = None) -> NDArray[np.float64]:
        """Return the derivatives of d(t, T) by the parameters in the order of `covariance`, shape (3,)."""
        by_rate = exposure_s * self._growth(temperature_c)
        by_doubling = 0.0
        if temperature_c is not None and self.temperature_c is not None:
            by_doubling = self.rate_dn_s * by_rate * log(2) * (temperature_c - self.temperature_c)
        return np.array([1.0, by_rate, by_doubling])

    def variance_dn2(self, exposure_s: float, temperature_c: float | None = None) -> float:
        """Variance of d(t, T) in DN^2 (GUM 5.2.2)."""
        sensitivity = self.sensitivities(exposure_s, temperature_c)
        return max(float(sensitivity @ np.array(self.covariance) @ sensitivity), 0.0)

    def pattern_dn(self, exposure_s: float) -> float:
        """Return the standard deviation of the darkness from pixel to pixel, by straight lines between exposures."""
        return float(np.interp(exposure_s, self.exposures_s, self.patterns_dn)) if self.patterns_dn else 0.0

    def temperature_warnings(self, frames: Iterable[tuple[float, float | None]]) -> list[str]:
        """Warn of frames outside the temperatures of the dark frames, where that changes the darkness.

        Parameters
        ----------
        frames : iterable of (float, float or None)
            Exposure in s and temperature in degC of each; the most affected is named.
        """
        if not self.temperatures_c:
            return []
        low, high = self.temperatures_c[0], self.temperatures_c[-1]
        away = [(max(low - c, c - high), t, c) for t, c in frames if c is not None]
        far = [
            (abs(self.rate_dn_s) * t * (2 ** (beyond / TYPICAL_DOUBLING_C) - 1), t, c)
            for beyond, t, c in away
            if beyond > _TEMPERATURE_TOLERANCE_C
        ]
        if not far or max(far)[0] < _WORTH_DN:
            return []
        _, exposure_s, temperature_c = max(far)
        return [
            f"the light frames at {exposure_s:g} s were taken at {temperature_c:.1f} degC, the dark frames at "
            f"{low:.1f} to {high:.1f} degC, so the darkness is less certain: take dark frames at this temperature"
        ]

    def errors(self) -> NDArray[np.float64]:
        """Independent errors of the parameters for one standard uncertainty, one a row; shape (n, 3), n at most 3."""
        covariance = np.array(self.covariance)
        # In units of the standard deviations, as DN and DN/s differ by orders of magnitude.
        unit = np.sqrt(np.maximum(np.diag(covariance), 0))
        safe = np.where(unit > 0, unit, 1)
        values, vectors = np.linalg.eigh(covariance / np.outer(safe, safe))
        kept = values > 1e-9
        rows: NDArray[np.float64] = (vectors[:, kept] * np.sqrt(values[kept]) * unit[:, None]).T
        return rows

    @property
    def offset_variance_dn2(self) -> float:
        """Variance of `offset_dn`."""
        return self.covariance[0][0]

    @property
    def rate_variance_dn2_s2(self) -> float:
        """Variance of `rate_dn_s`."""
        return self.covariance[1][1]

    def _growth(self, temperature_c: float | None) -> float:
        if temperature_c is None or self.temperature_c is None:
            return 1.0
        doubling_c = self.doubling_temperature_c or TYPICAL_DOUBLING_C
        return float(2.0 ** ((temperature_c - self.temperature_c) / doubling_c))


def fit_dark(darks: Sequence[DarkObservation]) -> tuple[DarkModel, list[str]]:
    """Fit the darkness to dark frames.

    A weighted straight line over the exposure time; with dark frames at temperatures at least
    `MIN_TEMPERATURE_SPAN_C` apart also the doubling temperature, if it is significant; else it is taken to be
    `TYPICAL_DOUBLING_C`, a third of which growth is uncertain. With more points than parameters the uncertainty is
    widened by the Birge ratio sqrt(chi^2 / degrees of freedom) if they scatter more than they should. Dark frames at
    one exposure give a constant; its growth with the exposure is then as uncertain as all that it is above the
    camera's black level, if that were dark current, or half a DN.

    Parameters
    ----------
    darks : sequence of DarkObservation
        At least one; of one camera state.

    Returns
    -------
    DarkModel
        The darkness.
    list of str
        Warnings.

    Raises
    ------
    CalibrationError
        If there is no observation, or cameras or settings differ.
    """
    if not darks:
        raise CalibrationError(
            "there are no dark frames: cover the lens and take at least 2 at each exposure, they fix the offset"
        )
    _require_one_state(darks)
    warnings = clipping(darks)
    t = np.array([d.exposure_s for d in darks])
    y = np.array([d.mean_dn for d in darks])
    # Frames without any noise still need a weight; the floor is far below what a mean can be known to.
    weights = 1 / np.maximum([d.mean_variance_dn2 for d in darks], 1e-12)
    temperatures = [d.temperature_c for d in darks if d.temperature_c is not None]
    reference = float(np.mean(temperatures)) if len(temperatures) == len(darks) else None
    curve = None
    if np.unique(t).size == 1:
        warnings.append(
            f"dark frames at one exposure only ({t[0]:g} s): the offset is taken as constant, which is right at that "
            "exposure and uncertain at others; take dark frames at the longest and shortest exposure too"
        )
        curve = _line(np.ones((t.size, 1)), y, weights)
    else:
        if reference is not None and np.ptp(temperatures) >= MIN_TEMPERATURE_SPAN_C:
            curve = _with_temperature(t, np.array(temperatures) - reference, y, weights)
        if curve is None:
            warmer_c = np.zeros_like(t) if reference is None else np.array(temperatures) - reference
            curve = _line(np.column_stack([np.ones_like(t), t * 2 ** (warmer_c / TYPICAL_DOUBLING_C)]), y, weights)
    parameters = np.zeros(3)
    covariance = np.zeros((3, 3))
    n = curve.parameters.size
    parameters[:n] = curve.parameters
    covariance[:n, :n] = curve.covariance
    falls = sqrt(covariance[1, 1])
    freedom = t.size - n
    if freedom > 0:
        chi_squared = float(np.sum(weights * (curve.y - curve.design @ curve.parameters) ** 2))
        warnings += contradictions(t, curve.y, weights, curve.design, curve.parameters)
        covariance = covariance * max(1.0, chi_squared / freedom)
    if n == 1:
        covariance += _of_unknown_rate(float(t[0]), float(parameters[0]) - darks[0].state.black_level_dn)
    if n < 3 and reference is not None:
        covariance[2, 2] = (_DOUBLING_REL / TYPICAL_DOUBLING_C) ** 2
    warnings += falling(t, float(parameters[1]), falls)
    freedoms = np.array([(d.n_pixels - 1) * (d.n_frames - 1) for d in darks])
    patterns = [sqrt(float(np.mean([d.pattern_dn**2 for d in darks if d.exposure_s == e]))) for e in np.unique(t)]
    model = DarkModel(
        offset_dn=float(parameters[0]),
        rate_dn_s=float(parameters[1]),
        covariance=_rows(covariance),
        noise_dn=sqrt(float(np.average([d.temporal_variance_dn2 for d in darks], weights=freedoms))),
        nonuniformity_dn=sqrt(float(np.mean([d.nonuniformity_dn**2 for d in darks]))),
        exposures_s=tuple(float(v) for v in np.unique(t)),
        temperatures_c=() if reference is None else tuple(sorted(temperatures)),
        temperature_c=reference,
        doubling_temperature_c=float(1 / parameters[2]) if n == 3 else None,
        patterns_dn=tuple(patterns) if any(patterns) else (),
    )
    return model, warnings


@dataclass(frozen=True, eq=False)
class _Curve:
    """Parameters, their covariance, and the design they solve for `y` (linearised at the parameters)."""

    parameters: NDArray[np.floating[Any]]
    covariance: NDArray[np.floating[Any]]
    design: NDArray[np.floating[Any]]
    y: NDArray[np.floating[Any]]


def _line(design: NDArray[np.float64], y: NDArray[np.float64], weights: NDArray[np.float64]) -> _Curve:
    covariance = np.linalg.inv(design.T @ (weights[:, None] * design))
    return _Curve(covariance @ (design.T @ (weights * y)), covariance, design, y)


def _with_temperature(
    t: NDArray[np.float64], warmer_c: NDArray[np.float64], y: NDArray[np.float64], weights: NDArray[np.float64]
) -> _Curve | None:
    """Fit offset, rate and 1 / T_d by Gauss and Newton; None if the dark frames do not tell the three apart."""
    start = _line(np.column_stack([np.ones_like(t), t]), y, weights)
    # EMVA 1288: the dark current doubles every 5 to 10 degC.
    parameters = np.array([*start.parameters, 1 / 8])
    for _ in range(_MAX_ROUNDS):
        offset, rate, inverse = parameters
        grown = t * 2.0 ** np.clip(warmer_c * inverse, -30, 30)
        design = np.column_stack([np.ones_like(t), grown, rate * grown * log(2) * warmer_c])
        if rate <= 0 or t.size < 3 or np.linalg.matrix_rank(design / np.abs(design).max(axis=0), tol=1e-6) < 3:
            return None
        linearised = y - (offset + rate * grown) + design @ parameters
        curve = _line(design, linearised, weights)
        change = np.abs(design @ (curve.parameters - parameters)).max()
        parameters = curve.parameters
        if change <= 1e-9 * np.abs(y).max():
            known = parameters[2] > _DOUBLING_LIMIT * sqrt(curve.covariance[2, 2])
            return curve if known and parameters[1] > 0 else None
    return None


def _of_unknown_rate(exposure_s: float, above_black_dn: float) -> NDArray[np.float64]:
    """Covariance by a rate that is not known, of a line through the mean at one exposure; shape (3, 3)."""
    rate_dn_s = max(abs(above_black_dn), WANDER_DN) / exposure_s
    error = np.array([-rate_dn_s * exposure_s, rate_dn_s, 0.0])
    return np.outer(error, error)


def _rows(matrix: NDArray[np.floating[Any]]) -> Covariance:
    (a, b, c), (d, e, f), (g, h, i) = matrix.tolist()
    return (a, b, c), (d, e, f), (g, h, i)


def _require_one_state(darks: Sequence[DarkObservation]) -> None:
    first: CameraState = darks[0].state
    for dark in darks[1:]:
        first.require(dark.state, "the first dark frames", f"the set of dark frames at {dark.exposure_s:g} s")
