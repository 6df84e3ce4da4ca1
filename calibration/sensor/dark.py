"""Dark signal as a function of exposure time, from dark frames."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import hypot, log, sqrt

import numpy as np
from numpy.typing import NDArray

from ...core.errors import CalibrationError, require_not_negative
from ...core.quantity import Z_95
from ...core.result import Finding, warning
from ..frames.observations import DarkObservation
from ..frames.statistics import MAX_CLIPPED_SHARE
from ..uncertainty import COVERAGE
from .dark_fit import (
    DOUBLING_REL,
    TYPICAL_DOUBLING_C,
    UNKNOWN_WITHIN_K,
    DarkCurrent,
    as_rows,
    black_level_drift,
    fit_curve,
    noise_line,
)

#: Temperature difference to the dark frames at which the dark current changes by about a sixth.
_TEMPERATURE_TOLERANCE_C = 2.0
#: Change of the dark signal, in DN, that causes a warning.
_WORTH_DN = 0.1

Covariance = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]


@dataclass(frozen=True)
class DarkModel(DarkCurrent):
    """d(t, T) = `offset_dn` + `rate_dn_s` t 2^((T - T_ref) / T_d) (EMVA 1288 Release 4.0 Linear, dark current).

    Parameters
    ----------
    offset_dn, rate_dn_s : float
        DN at zero exposure, and its growth per second at T_ref (EMVA 1288: dark current, here times K).
    covariance : tuple of tuple of float
        Covariance of offset_dn, rate_dn_s and 1 / T_d, shape (3, 3).
    noise_dn : float
        Temporal noise of one pixel in the dark at zero exposure: read noise and rounding.
    nonuniformity_dn : float
        Standard deviation of slow changes of the dark signal across the sensor.
    exposures_s : tuple of float
        Exposures of the dark frames, ascending.
    temperatures_c : tuple of float
        Temperatures of the sets of dark frames, ascending; empty if one is unknown.
    temperature_c : float or None
        T_ref, None if unknown.
    doubling_temperature_c : float or None
        T_d; None if undetermined: `TYPICAL_DOUBLING_C` is then used with a large `covariance`.
    patterns_dn : tuple of float
        Standard deviation of the dark signal from pixel to pixel at each of `exposures_s` (EMVA 1288: DSNU, in DN),
        that a dark library leaves; empty for none.
    noise_rate_dn2_s : float
        Growth of the temporal variance per second at T_ref, by the shot noise of the dark current.
    drift_dn : float
        Standard deviation of the black level from frame to frame, with noise of the pixels removed.
    drift_dof : int
        Degrees of freedom of `drift_dn`; 0 if it is known.
    line_noise_dn, line_pattern_dn : (float, float)
        Standard deviation of temporal noise and of the pattern that whole columns, and whole rows, have in common.
    unknown_within_k : float
        Half width of the temperatures that frames may have around T_ref where one of the two is unknown; 0 for frames
        of the same session as the dark frames.

    Raises
    ------
    InputError
        If a variance or standard deviation is negative.

    Examples
    --------
    >>> from labcdp.calibration import DarkModel
    >>> none = ((0.0,) * 3,) * 3
    >>> dark = DarkModel(64.0, 100.0, none, noise_dn=2.0, nonuniformity_dn=0.0, exposures_s=(0.01, 0.1))
    >>> dark.offset_dn + dark.rate_dn_s * 0.1
    74.0
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
    noise_rate_dn2_s: float = 0.0
    drift_dn: float = 0.0
    drift_dof: int = 0
    line_noise_dn: tuple[float, float] = (0.0, 0.0)
    line_pattern_dn: tuple[float, float] = (0.0, 0.0)
    unknown_within_k: float = UNKNOWN_WITHIN_K

    def __post_init__(self) -> None:
        require_not_negative(
            **{"variances in covariance": (self.covariance[0][0], self.covariance[1][1], self.covariance[2][2])},
            noise_dn=self.noise_dn,
            nonuniformity_dn=self.nonuniformity_dn,
            patterns_dn=self.patterns_dn,
            noise_rate_dn2_s=self.noise_rate_dn2_s,
            drift_dn=self.drift_dn,
            drift_dof=self.drift_dof,
            line_noise_dn=self.line_noise_dn,
            line_pattern_dn=self.line_pattern_dn,
            unknown_within_k=self.unknown_within_k,
        )

    def mean_dn(self, exposure_s: float, temperature_c: float | None = None) -> float:
        """d(t, T) in DN; an unknown temperature is assumed to be T_ref."""
        return self.offset_dn + self.rate_dn_s * exposure_s * self.growth(temperature_c)

    def sensitivities(self, exposure_s: float, temperature_c: float | None = None) -> NDArray[np.float64]:
        """Return the derivatives of d(t, T) by the parameters in the order of `covariance`, shape (3,)."""
        by_rate = exposure_s * self.growth(temperature_c)
        by_doubling = 0.0
        if temperature_c is not None and self.temperature_c is not None:
            by_doubling = self.rate_dn_s * by_rate * log(2) * (temperature_c - self.temperature_c)
        return np.array([1.0, by_rate, by_doubling])

    def variance_dn2(self, exposure_s: float, temperature_c: float | None = None) -> float:
        """Variance of d(t, T) in DN^2 (GUM 5.2.2)."""
        sensitivity = self.sensitivities(exposure_s, temperature_c)
        return max(float(sensitivity @ np.array(self.covariance) @ sensitivity), 0.0)

    def unknown_growth_dn(self, exposure_s: float, temperature_c: float | None = None) -> float:
        """Return the standard uncertainty of d(t, T), in DN, by an unknown temperature; 0 if it is known.

        Temperatures within `unknown_within_k` of T_ref are equally probable. As the dark current grows by more than it
        falls, this is the half width that contains 95 % of it, over the normal quantile.
        """
        if temperature_c is not None and self.temperature_c is not None:
            return 0.0
        growth = (self._growth_by((2 * COVERAGE - 1) * self.unknown_within_k) - 1) / Z_95
        return hypot(self.rate_dn_s, sqrt(self.rate_variance_dn2_s2)) * exposure_s * growth

    def noise_variance_dn2(self, exposure_s: float, temperature_c: float | None = None) -> float:
        """Temporal variance of one pixel in the dark, in DN^2: read noise and shot noise of the dark current."""
        return self.noise_dn**2 + self.noise_rate_dn2_s * exposure_s * self.growth(temperature_c)

    def pattern_dn(self, exposure_s: float) -> float:
        """Return the standard deviation of the dark signal from pixel to pixel, by straight lines between exposures."""
        return float(np.interp(exposure_s, self.exposures_s, self.patterns_dn)) if self.patterns_dn else 0.0

    def temperature_findings(self, frames: Iterable[tuple[float, float | None]], subject: str = "") -> list[Finding]:
        """Warn of frames outside the temperatures of the dark frames, where that changes the dark signal.

        Parameters
        ----------
        frames : iterable of (float, float or None)
            Exposure in s and temperature in degC of each; the most affected is named.
        subject : str
            Subject of the finding.
        """
        if not self.temperatures_c:
            return []
        low, high = self.temperatures_c[0], self.temperatures_c[-1]
        away = [(max(low - c, c - high), t, c) for t, c in frames if c is not None]
        changes = [
            (abs(self.rate_dn_s) * t * (2 ** (beyond / TYPICAL_DOUBLING_C) - 1), t, c)
            for beyond, t, c in away
            if beyond > _TEMPERATURE_TOLERANCE_C
        ]
        largest_dn, t, c = max(changes, default=(0.0, 0.0, 0.0))
        if largest_dn < _WORTH_DN:
            return []
        return [warning("temperature-not-covered", subject, exposure_s=t, temperature_c=c, range_c=[low, high])]

    def unknown_temperature_findings(self, frames: Iterable[tuple[float, float | None]]) -> list[Finding]:
        """Warn of frames whose dark signal is less certain by an unknown temperature.

        Parameters
        ----------
        frames : iterable of (float, float or None)
            Exposure in s and temperature in degC of each.
        """
        if max((self.unknown_growth_dn(t, c) for t, c in frames), default=0.0) * Z_95 < _WORTH_DN:
            return []
        growth = self._growth_by(self.unknown_within_k)
        return [warning("temperature-not-stated", within_k=self.unknown_within_k, growth=[1 / growth, growth])]

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


def fit_dark(darks: Sequence[DarkObservation], drift_dn: float | None = None) -> tuple[DarkModel, list[Finding]]:
    """Fit the dark signal and its noise to dark frames.

    A weighted straight line over the exposure time; with dark frames at several temperatures also the doubling
    temperature, if significant; else `TYPICAL_DOUBLING_C` with a standard uncertainty of a third of that growth. The
    black level's drift from frame to frame is one number of all exposures, and part of each mean's uncertainty, which
    is widened by the Birge ratio where the means scatter more. Dark frames at one exposure give a constant, which may
    be dark current as far as it is above the nominal black level, or half a DN.

    Parameters
    ----------
    darks : sequence of DarkObservation
        At least one; of one camera state.
    drift_dn : float or None
        Standard deviation of the black level from frame to frame; None for what the frames show.

    Raises
    ------
    CalibrationError
        If there is no observation, or cameras or settings differ.
    """
    if not darks:
        raise CalibrationError(
            "there are no dark frames: cover the lens and take at least 2 at each exposure, they fix the offset"
        )
    darks[0].state.require_alike(darks, "the first dark frames")
    exposures_s = sorted({d.exposure_s for d in darks})
    temperatures = [d.temperature_c for d in darks if d.temperature_c is not None]
    reference = float(np.mean(temperatures)) if len(temperatures) == len(darks) else None
    warmer_c = np.zeros(len(darks)) if reference is None else np.array(temperatures) - reference
    drift_dn, drift_dof = black_level_drift(darks) if drift_dn is None else (drift_dn, 0)
    parameters, covariance, findings = fit_curve(darks, warmer_c, drift_dn)
    doubling_c = float(1 / parameters[2]) if covariance[2, 2] > 0 else None
    if doubling_c is None and reference is not None:
        covariance[2, 2] = (DOUBLING_REL / TYPICAL_DOUBLING_C) ** 2
    noise = noise_line(darks, 2 ** (warmer_c * parameters[2]))
    patterns = [_rms(d.pattern_dn for d in darks if d.exposure_s == t) for t in exposures_s]
    model = DarkModel(
        offset_dn=float(parameters[0]),
        rate_dn_s=float(parameters[1]),
        covariance=as_rows(covariance),
        noise_dn=sqrt(max(noise.intercept, 0.0)),
        nonuniformity_dn=_rms(d.nonuniformity_dn for d in darks),
        exposures_s=tuple(exposures_s),
        temperatures_c=() if reference is None else tuple(sorted(temperatures)),
        temperature_c=reference,
        doubling_temperature_c=doubling_c,
        patterns_dn=tuple(patterns) if any(patterns) else (),
        noise_rate_dn2_s=noise.slope,
        drift_dn=drift_dn,
        drift_dof=drift_dof,
        line_noise_dn=_rms_of_lines(d.line_noise_dn for d in darks),
        line_pattern_dn=_rms_of_lines(d.line_pattern_dn for d in darks),
    )
    clipped = [d for d in darks if d.black_share > MAX_CLIPPED_SHARE]
    of_clipping = [warning("dark-clipped", exposure_s=d.exposure_s, share=float(d.black_share)) for d in clipped]
    return model, [*of_clipping, *findings]


def _rms(values: Iterable[float]) -> float:
    return sqrt(float(np.mean(np.square(list(values)))))


def _rms_of_lines(values: Iterable[tuple[float, float]]) -> tuple[float, float]:
    columns, rows = zip(*values, strict=True)
    return _rms(columns), _rms(rows)
