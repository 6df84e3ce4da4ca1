"""Calibration of a camera against a luminance meter."""

from __future__ import annotations

import logging
import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from ..errors import CalibrationError
from ..reading import Reading
from .dark import DarkModel, fit_dark
from .line_fit import Line, fit_line
from .model import Calibration, PatchResidual, Provenance, ResponsivityFit, Setup
from .noise import TemporalNoise, fit_noise
from .observations import DarkObservation, PatchObservation
from .readings import PatchReading, combine_readings, meter_scale
from .signal import PatchSignal, combine, usable

_log = logging.getLogger(__name__)

#: Fewest patches: one parameter, one more for the test of the intercept, and one to judge the fit by.
MIN_PATCHES = 3
#: Fewest patches without a warning.
ADVISED_PATCHES = 6
#: Fewest exposures without a warning.
ADVISED_EXPOSURES = 3
#: Ratio of the highest to the lowest patch below which an intercept cannot be told from the slope.
_MIN_SPAN = 2.0
#: Significance of the intercept, in standard uncertainties, that is reported.
_INTERCEPT_LIMIT = 3.0
#: Probability of a chi^2 below which the stated errors are taken to be too small.
_CHANCE = 0.01


def fit(
    observations: Sequence[PatchObservation],
    darks: Sequence[DarkObservation],
    readings: Mapping[str, Sequence[Reading]],
    setup: Setup,
) -> Calibration:
    """Calibrate a camera.

    Dark frames fix d(t). The signal of each patch, (DN - d) / (t V), is combined over the exposures, and its slope R
    over the meter's luminance is fitted through zero with errors in both variables. The error of the dark, shared
    by all patches, is in the covariance. A free intercept is fitted as a test: if significant, it points to glare
    or to a wrong dark. The meter's scale error is shared by all patches; it stays out of the fit and is kept
    apart.

    Parameters
    ----------
    observations : sequence of PatchObservation
        All patches at all exposures, from `observe_patches`.
    darks : sequence of DarkObservation
        From `observe_dark`, at best at the shortest and the longest exposure too.
    readings : mapping of str to sequence of Reading
        The meter's readings by the name of the patch.
    setup : Setup
        Lens, spectrum, and hash of the input.

    Raises
    ------
    CalibrationError
        If patches and readings do not match, cameras, settings or meters differ, fewer than `MIN_PATCHES` patches
        can be used, or there is no light.
    InputError
        If a reading is a ratio in %.
    """
    dark, warnings = fit_dark(darks)
    _require_one_state(observations, darks)
    groups = _group_by_patch(observations, readings)
    noise, noise_warnings = fit_noise(observations, dark)
    scale = meter_scale(readings)
    signals, patch_readings, patch_warnings = _match(groups, readings, dark, noise)
    exposures_s = tuple(sorted({t for signal in signals for t in signal.exposures_s}))
    warnings += noise_warnings + patch_warnings + _design_warnings(signals, patch_readings, exposures_s, dark)
    responsivity, line, fit_warnings = _fit_responsivity(signals, patch_readings, dark)
    warnings += fit_warnings
    residuals = _residuals(signals, patch_readings, line)
    luminances = [value for row in residuals for value in (row.reading_cd_m2, row.luminance_cd_m2)]
    for warning in warnings:
        _log.warning("%s", warning)
    return Calibration(
        state=observations[0].state,
        lens=setup.lens,
        source_spectrum=setup.source_spectrum,
        meter_scale=scale,
        responsivity=responsivity,
        dark=dark,
        noise=noise,
        vignetting=observations[0].vignetting,
        range_cd_m2=(min(luminances), max(luminances)),
        exposures_s=exposures_s,
        residuals=residuals,
        warnings=tuple(warnings),
        provenance=Provenance(
            measured=max(reading.timestamp for group in readings.values() for reading in group),
            input_sha256=setup.input_sha256,
            versions={"python": platform.python_version()}
            | {name: version(name) for name in ("labcdp", "numpy", "scipy")},
        ),
    )


def _require_one_state(observations: Sequence[PatchObservation], darks: Sequence[DarkObservation]) -> None:
    if not observations:
        raise CalibrationError("there is no observation of a patch: take light frames with at least 3 patches")
    first = observations[0]
    for dark in darks:
        first.state.require(dark.state, "the light frames", f"the set of dark frames at {dark.exposure_s:g} s")
    for other in observations[1:]:
        name = f"patch {other.patch!r} at {other.exposure_s:g} s"
        first.state.require(other.state, "the first observation", name)
        if other.vignetting != first.vignetting:
            raise CalibrationError(
                f"{name} was observed with vignetting {other.vignetting}, the first observation with "
                f"{first.vignetting}: observe all patches with the same"
            )


def _group_by_patch(
    observations: Sequence[PatchObservation], readings: Mapping[str, Sequence[Reading]]
) -> dict[str, list[PatchObservation]]:
    groups: dict[str, list[PatchObservation]] = {}
    for observation in observations:
        groups.setdefault(observation.patch, []).append(observation)
    for patch in groups:
        if patch not in readings:
            raise CalibrationError(f"patch {patch!r} has no meter reading: measure it, or leave the patch out")
    for patch in readings:
        if patch not in groups:
            raise CalibrationError(
                f"there are readings of patch {patch!r}, but no frames show it: define its region, or leave them out"
            )
    return groups


def _match(
    groups: Mapping[str, Sequence[PatchObservation]],
    readings: Mapping[str, Sequence[Reading]],
    dark: DarkModel,
    noise: TemporalNoise,
) -> tuple[list[PatchSignal], list[PatchReading], list[str]]:
    """Return signal and reading of each usable patch, and warnings about the others."""
    signals: list[PatchSignal] = []
    patch_readings: list[PatchReading] = []
    warnings: list[str] = []
    for patch, group in groups.items():
        reading, reading_warnings = combine_readings(patch, readings[patch])
        kept, left_out = usable(group, dark, noise)
        warnings += reading_warnings + left_out
        if reading.luminance_cd_m2 == 0:
            warnings.append(f"patch {patch!r} reads 0 cd/m^2, below the meter's range: left out of the fit")
        elif not kept:
            warnings.append(f"patch {patch!r} is usable at no exposure: left out of the fit")
        else:
            signals.append(combine(kept, dark, noise))
            patch_readings.append(reading)
    if len(signals) < MIN_PATCHES:
        reasons = "; ".join(w for w in warnings if "left out" in w)
        raise CalibrationError(
            f"{len(signals)} of {len(groups)} patches are usable, a calibration needs at least {MIN_PATCHES} (one for "
            "the slope, one to test the intercept, one to judge the fit) and is good from "
            f"{ADVISED_PATCHES} on: add patches or exposures" + (f" ({reasons})" if reasons else "")
        )
    return signals, patch_readings, warnings


def _design_warnings(
    signals: Sequence[PatchSignal],
    readings: Sequence[PatchReading],
    exposures_s: tuple[float, ...],
    dark: DarkModel,
) -> list[str]:
    warnings = []
    if len(signals) < ADVISED_PATCHES:
        warnings.append(
            f"the fit rests on {len(signals)} patches: use at least {ADVISED_PATCHES}, better 8 to 12, log spaced"
        )
    low, high = min(r.luminance_cd_m2 for r in readings), max(r.luminance_cd_m2 for r in readings)
    if high < _MIN_SPAN * low:
        warnings.append(
            f"the patches span {low:g} to {high:g} cd/m^2 only: the valid range is as narrow, and glare and linearity "
            "are not tested; add patches, log spaced"
        )
    if len(exposures_s) < ADVISED_EXPOSURES:
        warnings.append(
            f"patches were usable at {len(exposures_s)} exposures: use at least {ADVISED_EXPOSURES}, so that the "
            "exposure time is tested"
        )
    if len(dark.exposures_s) > 1 and not (
        dark.exposures_s[0] * 0.999 <= exposures_s[0] and exposures_s[-1] <= dark.exposures_s[-1] * 1.001
    ):
        warnings.append(
            f"dark frames at {dark.exposures_s[0]:g} to {dark.exposures_s[-1]:g} s do not enclose the exposures "
            f"{exposures_s[0]:g} to {exposures_s[-1]:g} s: the darkness is extrapolated"
        )
    freedom = sum(signal.degrees_of_freedom for signal in signals)
    chi_squared = sum(signal.chi_squared for signal in signals)
    if freedom and _chance(chi_squared, freedom) < _CHANCE:
        warnings.append(
            f"the exposures of a patch disagree more than their noise (chi^2 {chi_squared:.3g} for {freedom}): check "
            "the exposure times, the linearity, the dark frames and the light"
        )
    return warnings


def _fit_responsivity(
    signals: Sequence[PatchSignal], readings: Sequence[PatchReading], dark: DarkModel
) -> tuple[ResponsivityFit, Line, list[str]]:
    x = np.array([r.luminance_cd_m2 for r in readings])
    y = np.array([s.rate_dn_s for s in signals])
    # Meter and camera see an uneven patch at slightly different places, and each pixel has its own sensitivity.
    of_patch = np.array([s.nonuniformity_rel**2 + s.fixed_pattern_rel**2 for s in signals])
    x_variance = np.array([r.random_cd_m2**2 for r in readings]) + of_patch * x**2
    y_covariance = _signal_covariance(signals, dark)
    line = fit_line(x, y, x_variance, y_covariance, free_intercept=False)
    warnings = []
    widening = 1.0
    if _chance(line.chi_squared, line.degrees_of_freedom) < _CHANCE:
        widening = sqrt(line.chi_squared / line.degrees_of_freedom)
        worst = int(np.argmax(np.abs(line.standardised_residuals)))
        warnings.append(
            f"the patches scatter {widening:.1f} times more than the stated errors explain, most of all patch "
            f"{signals[worst].patch!r} ({y[worst] / (line.slope * x[worst]) - 1:+.1%}): check regions, readings, glare "
            "and the light; the uncertainty was widened by this factor"
        )
    intercept = uncertainty = None
    if x.max() >= _MIN_SPAN * x.min():
        free = fit_line(x, y, x_variance, y_covariance, free_intercept=True)
        intercept = free.intercept
        uncertainty = sqrt(free.intercept_variance) * sqrt(max(1.0, free.chi_squared / free.degrees_of_freedom))
        if abs(intercept) > _INTERCEPT_LIMIT * uncertainty:
            warnings.append(
                f"a free intercept is {intercept:.4g} +- {uncertainty:.2g} DN/s ({intercept / free.slope:.3g} cd/m^2, "
                f"{abs(intercept) / uncertainty:.1f} standard uncertainties from zero): glare or a wrong dark; shade "
                "the lens, or take the dark frames again"
            )
    responsivity = ResponsivityFit(
        responsivity_dn_s_cd_m2=line.slope,
        random_rel=sqrt(line.slope_variance) / line.slope * widening,
        chi_squared=line.chi_squared,
        degrees_of_freedom=line.degrees_of_freedom,
        intercept_dn_s=intercept,
        intercept_standard_uncertainty_dn_s=uncertainty,
    )
    return responsivity, line, warnings


def _signal_covariance(signals: Sequence[PatchSignal], dark: DarkModel) -> NDArray[np.float64]:
    by_dark = np.array([s.dark_sensitivity for s in signals])
    dark_covariance = np.array(
        [
            [dark.offset_variance_dn2, dark.covariance_dn2_s],
            [dark.covariance_dn2_s, dark.rate_variance_dn2_s2],
        ]
    )
    own = np.diag([s.variance_dn2_s2 for s in signals])
    covariance: NDArray[np.float64] = own + by_dark @ dark_covariance @ by_dark.T
    return covariance


def _residuals(
    signals: Sequence[PatchSignal], readings: Sequence[PatchReading], line: Line
) -> tuple[PatchResidual, ...]:
    rows = []
    for signal, reading, standardised in zip(signals, readings, line.standardised_residuals, strict=True):
        luminance_cd_m2 = signal.rate_dn_s / line.slope
        rows.append(
            PatchResidual(
                patch=signal.patch,
                reading_cd_m2=reading.luminance_cd_m2,
                reading_random_cd_m2=reading.random_cd_m2,
                n_readings=reading.n_readings,
                luminance_cd_m2=luminance_cd_m2,
                residual_rel=luminance_cd_m2 / reading.luminance_cd_m2 - 1,
                standardised_residual=float(standardised),
                exposures_s=signal.exposures_s,
            )
        )
    return tuple(rows)


def _chance(chi_squared: float, freedom: int) -> float:
    """Probability of a chi^2 at least this large."""
    from scipy.special import chdtrc

    return float(chdtrc(freedom, chi_squared))
