"""Whether a calibration still holds: patches and darkness measured again, against what the calibration says."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from math import hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from ..errors import CalibrationError
from ..reading import Reading
from .dark import DarkModel, fit_dark
from .model import Calibration
from .observations import DarkObservation, PatchObservation
from .patch import PatchLuminance, patch_luminance
from .readings import PatchReading, combine_readings, meter_scale
from .signal import net_signal, usable
from .uncertainty import expanded_half_width
from .verification import WANDER_DN, Verdict, Verification, VerifiedDark, VerifiedPatch, chance_limits, z_limits
from .verify_wording import findings_of


def verify(
    calibration: Calibration,
    observations: Sequence[PatchObservation],
    darks: Sequence[DarkObservation],
    readings: Mapping[str, Sequence[Reading]],
) -> Verification:
    """Compare patches measured again by the calibrated camera with the meter.

    Each difference is judged by z, its ratio to its combined standard uncertainty, all together by chi^2. The fit
    of the calibration is shared by all patches. The scale error of the meter cancels if it is the calibration's
    meter with the same date of adjustment; otherwise the scales of both count. The limits are two and three standard
    uncertainties for a warning and a failure, raised for several patches by the rule of Bonferroni so that the
    probability of a false alarm stays that of one.

    Parameters
    ----------
    calibration : Calibration
        To verify.
    observations : sequence of PatchObservation
        One patch or more, at one exposure or more, observed with the calibration's vignetting.
    darks : sequence of DarkObservation
        New dark frames.
    readings : mapping of str to sequence of Reading
        New readings by the name of the patch.

    Raises
    ------
    CalibrationError
        If there is no patch, a patch has no reading or reads 0, is clipped or black at every exposure, or camera,
        settings or vignetting are not the calibration's.
    """
    groups: dict[str, list[PatchObservation]] = {}
    for observation in observations:
        groups.setdefault(observation.patch, []).append(observation)
    if not groups:
        raise CalibrationError("there is no patch to verify the calibration with: give frames and readings of one")
    dark, _ = fit_dark(darks)
    for d in darks:
        calibration.require(d.state, f"the set of dark frames at {d.exposure_s:g} s")
    scale = meter_scale({patch: readings.get(patch, ()) for patch in groups})
    same_meter = scale.meter == calibration.meter_scale.meter
    seen = [patch_luminance(calibration, group) for group in groups.values()]
    read, reading_warnings = _readings(groups, readings)
    uneven_rel = [_unevenness_rel(group, calibration) for group in groups.values()]
    scales = () if same_meter else (scale.half_width_rel, calibration.meter_scale.half_width_rel)
    covariance = _covariance(seen, read, uneven_rel, scales)
    difference = np.array([s.luminance_cd_m2 / r.luminance_cd_m2 - 1 for s, r in zip(seen, read, strict=True)])
    new_dark = [_with_dark(calibration, dark, group) for group in groups.values()]
    patches = tuple(
        _row(s, r, float(d), float(u), n)
        for s, r, d, u, n in zip(seen, read, difference, np.sqrt(np.diag(covariance)), new_dark, strict=True)
    )
    drift_rel, drift_variance = _common_mean(difference, covariance)
    chi_squared, chance = _chi_squared(difference, covariance)
    result = Verification(
        verdict="valid",
        findings=(),
        state=calibration.state,
        lens=calibration.lens,
        measured=max(r.timestamp for patch in groups for r in readings[patch]),
        calibration_measured=calibration.provenance.measured,
        calibration_sha256=calibration.provenance.input_sha256,
        meter=scale.meter,
        same_meter=same_meter,
        patches=patches,
        darks=tuple(_dark_row(d, calibration) for d in sorted(darks, key=lambda d: d.exposure_s)),
        dark=dark,
        chi_squared=chi_squared,
        chance=chance,
        drift_rel=drift_rel,
        drift_half_width_95_rel=_half_width(drift_variance, scales),
        responsivity_dn_s_cd_m2=calibration.responsivity.responsivity_dn_s_cd_m2 * (1 + drift_rel),
        responsivity_half_width_95_rel=expanded_half_width(
            scale.half_width_rel, sqrt(max(drift_variance - sum(h**2 / 3 for h in scales), 0.0))
        ),
    )
    verdict = _verdict(result, calibration)
    warnings = dict.fromkeys([*reading_warnings, *(w for s in seen for w in s.warnings)])
    return replace(result, verdict=verdict, findings=(*findings_of(replace(result, verdict=verdict)), *warnings))


def _readings(
    patches: Iterable[str], readings: Mapping[str, Sequence[Reading]]
) -> tuple[list[PatchReading], list[str]]:
    joined, warnings = [], []
    for patch in patches:
        reading, of_patch = combine_readings(patch, readings.get(patch, ()))
        if reading.luminance_cd_m2 == 0:
            raise CalibrationError(
                f"patch {patch!r} reads 0 cd/m^2, below the meter's range: verify with a brighter patch"
            )
        joined.append(reading)
        warnings += of_patch
    return joined, warnings


def _unevenness_rel(group: Sequence[PatchObservation], calibration: Calibration) -> float:
    """Unevenness of the patch itself: meter and camera see it at slightly different places, as in the fit."""
    kept, _, _ = usable(group, calibration.settings)
    return float(np.median([net_signal(o, calibration.settings).slow_rel for o in kept]))


def _covariance(
    seen: Sequence[PatchLuminance],
    read: Sequence[PatchReading],
    uneven_rel: Sequence[float],
    scales: tuple[float, ...],
) -> NDArray[np.float64]:
    """Covariance of the differences: what each patch has alone, and what the patches share."""
    own_rel = [
        hypot(s.random_rel, r.random_cd_m2 / r.luminance_cd_m2, u)
        for s, r, u in zip(seen, read, uneven_rel, strict=True)
    ]
    covariance: NDArray[np.float64] = np.diag(np.square(own_rel))
    shared: dict[tuple[str, int], NDArray[np.float64]] = {}
    for place, patch in enumerate(seen):
        counted: Counter[str] = Counter()
        # The scale of the calibration's meter is in `scales`, if it counts.
        for error in (e for e in patch.common if e.source != "meter scale"):
            counted[error.source] += 1
            pattern = shared.setdefault((error.source, counted[error.source]), np.zeros(len(seen)))
            pattern[place] = float(error.relative)
    for pattern in (*shared.values(), *(np.full(len(seen), half_width / sqrt(3)) for half_width in scales)):
        covariance = covariance + np.outer(pattern, pattern)
    return covariance


def _with_dark(calibration: Calibration, dark: DarkModel, group: Sequence[PatchObservation]) -> float | None:
    try:
        return patch_luminance(replace(calibration, dark=dark), group).luminance_cd_m2
    except CalibrationError:
        return None


def _row(
    seen: PatchLuminance, read: PatchReading, difference_rel: float, uncertainty_rel: float, new_dark: float | None
) -> VerifiedPatch:
    return VerifiedPatch(
        patch=seen.patch,
        reading_cd_m2=read.luminance_cd_m2,
        reading_random_cd_m2=read.random_cd_m2,
        n_readings=read.n_readings,
        luminance_cd_m2=seen.luminance_cd_m2,
        difference_rel=difference_rel,
        standard_uncertainty_rel=uncertainty_rel,
        with_new_dark_rel=None if new_dark is None else new_dark / read.luminance_cd_m2 - 1,
        exposures_s=seen.exposures_s,
    )


def _dark_row(dark: DarkObservation, calibration: Calibration) -> VerifiedDark:
    model = calibration.setting(dark.state.gain_db).dark
    expected_dn = model.mean_dn(dark.exposure_s, dark.temperature_c)
    own = dark.mean_variance_dn2 + model.variance_dn2(dark.exposure_s, dark.temperature_c)
    light_dn_s = calibration.responsivity.responsivity_dn_s_cd_m2 * calibration.range_cd_m2[0]
    # The lowest luminance is measured with the longest exposures.
    effect_rel = (dark.mean_dn - expected_dn) / (light_dn_s * calibration.exposures_s[-1])
    return VerifiedDark(dark.exposure_s, dark.mean_dn, expected_dn, hypot(sqrt(own), WANDER_DN / sqrt(3)), effect_rel)


def _common_mean(difference: NDArray[np.float64], covariance: NDArray[np.float64]) -> tuple[float, float]:
    """Mean by generalised least squares, and its variance."""
    weight = np.linalg.solve(covariance, np.ones_like(difference))
    return float(weight @ difference / weight.sum()), float(1 / weight.sum())


def _chi_squared(difference: NDArray[np.float64], covariance: NDArray[np.float64]) -> tuple[float, float]:
    from scipy.special import chdtrc

    chi_squared = float(difference @ np.linalg.solve(covariance, difference))
    return chi_squared, float(chdtrc(difference.size, chi_squared))


def _half_width(variance: float, scales: tuple[float, ...]) -> float:
    """95 % half width; the largest of the rectangular parts is taken as such, the others as normal."""
    largest = max(scales, default=0.0)
    return expanded_half_width(largest, sqrt(max(variance - largest**2 / 3, 0.0)))


def _verdict(result: Verification, calibration: Calibration) -> Verdict:
    warn, fail = z_limits(len(result.patches))
    doubt, failure = chance_limits()
    largest = max(abs(row.z) for row in result.patches)
    dark_warn, dark_fail = z_limits(len(result.darks))
    moved = [row for row in result.darks if abs(row.z) > dark_fail]
    stated = expanded_half_width(calibration.meter_scale.half_width_rel, calibration.responsivity.random_rel)
    if largest > fail or result.chance < failure or any(abs(row.effect_rel) > stated for row in moved):
        return "not valid"
    if largest > warn or result.chance < doubt or any(abs(row.z) > dark_warn for row in result.darks):
        return "doubtful"
    return "valid"
