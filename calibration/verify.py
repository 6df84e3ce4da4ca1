"""Whether a calibration still holds: patches and darkness measured again, against what the calibration says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ..errors import CalibrationError
from ..reading import Reading
from .comparison import (
    Comparison,
    chance_of,
    compare,
    dark_row,
    drift_of,
    half_width,
    join_readings,
    unevenness_rel,
)
from .dark import DarkModel, fit_dark
from .model import Calibration
from .observations import DarkObservation, PatchObservation
from .patch import PatchLuminance, patch_luminance
from .store import AnyCalibration
from .uncertainty import expanded_half_width
from .verification import (
    ColourBalance,
    Verdict,
    Verification,
    VerifiedDark,
    VerifiedPatch,
    VerifiedPlane,
    chance_limits,
    z_limits,
)
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
        If there is no patch, a patch has no reading or reads 0, all are clipped or black at every exposure, or camera,
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
    seen, unusable = _measured(calibration, groups)
    groups = {name: group for name, group in groups.items() if name in seen}
    comparison = compare(
        list(seen.values()),
        join_readings(groups, {name: readings[name] for name in groups if name in readings}, calibration.meter_scale),
        [unevenness_rel(group, calibration) for group in groups.values()],
    )
    result = judged(
        calibration,
        comparison,
        comparison.rows([_with_dark(calibration, dark, group) for group in groups.values()]),
        [dark_row(d, calibration, calibration.range_cd_m2[0]) for d in sorted(darks, key=lambda d: d.exposure_s)],
        [VerifiedPlane(calibration.state.plane, dark, drift_of(calibration, *comparison.mean(), comparison.readings))],
        None,
        calibration.responsivity.random_rel,
    )
    if not unusable:
        return result
    verdict: Verdict = "doubtful" if result.verdict == "valid" else result.verdict
    return replace(result, verdict=verdict, findings=(*result.findings, *unusable))


def _measured(
    calibration: Calibration, groups: Mapping[str, Sequence[PatchObservation]]
) -> tuple[dict[str, PatchLuminance], list[str]]:
    """Luminances of the patches that can be measured, and findings about the others; raises if there is none."""
    seen: dict[str, PatchLuminance] = {}
    unusable: list[CalibrationError] = []
    for name, group in groups.items():
        try:
            seen[name] = patch_luminance(calibration, group)
        except CalibrationError as error:
            unusable.append(error)
    if not seen:
        raise unusable[0]
    return seen, [f"left out: {error}" for error in unusable]


def judged(
    calibration: AnyCalibration,
    comparison: Comparison,
    patches: tuple[VerifiedPatch, ...],
    darks: Sequence[VerifiedDark],
    planes: Sequence[VerifiedPlane],
    balance: ColourBalance | None,
    fit_rel: float,
) -> Verification:
    """Put a verification together, with its verdict.

    Parameters
    ----------
    calibration : Calibration or ColourCalibration
        That was verified.
    comparison : Comparison
        Patches by camera and meter.
    patches, darks, planes, balance
        As in `Verification`.
    fit_rel : float
        Relative standard uncertainty of the calibration without the meter's scale.
    """
    readings = comparison.readings
    drift, variance = comparison.mean()
    result = Verification(
        verdict="valid",
        findings=(),
        state=calibration.state,
        lens=calibration.lens,
        measured=readings.measured,
        calibration_measured=calibration.provenance.measured,
        calibration_sha256=calibration.provenance.input_sha256,
        meter=readings.scale.meter,
        same_meter=not readings.scales,
        patches=patches,
        darks=tuple(darks),
        planes=tuple(planes),
        balance=balance,
        chi_squared=comparison.chi_squared,
        chance=chance_of(comparison.chi_squared, len(patches)),
        drift_rel=drift,
        drift_half_width_95_rel=half_width(variance, readings.scales),
    )
    stated_rel = expanded_half_width(calibration.meter_scale.half_width_rel, fit_rel)
    result = replace(result, verdict=_verdict(result, stated_rel))
    warnings = dict.fromkeys([*readings.warnings, *(w for s in comparison.seen for w in s.warnings)])
    return replace(result, findings=(*findings_of(result), *warnings))


def _verdict(result: Verification, stated_rel: float) -> Verdict:
    """Judge patches, darkness and colours together; `stated_rel` is the calibration's 95 % half width."""
    warn, fail = z_limits(len(result.patches))
    doubt, failure = chance_limits()
    largest = max(abs(row.z) for row in result.patches)
    dark_warn, dark_fail = z_limits(len(result.darks))
    # What the planes' darkness makes of one exposure adds up.
    effects = {row.exposure_s: 0.0 for row in result.darks}
    for row in result.darks:
        effects[row.exposure_s] += row.effect_rel if abs(row.z) > dark_fail else 0.0
    of_dark = any(abs(effect) > stated_rel for effect in effects.values())
    balance = result.balance
    of_colour = balance is not None and balance.chance < failure and balance.effect_rel > stated_rel
    if largest > fail or result.chance < failure or of_dark or of_colour:
        return "not valid"
    colours_differ = balance is not None and balance.chance < doubt
    in_doubt = largest > warn or result.chance < doubt or colours_differ
    return "doubtful" if in_doubt or any(abs(row.z) > dark_warn for row in result.darks) else "valid"


def _with_dark(calibration: Calibration, dark: DarkModel, group: Sequence[PatchObservation]) -> float | None:
    try:
        return patch_luminance(replace(calibration, dark=dark), group).luminance_cd_m2
    except CalibrationError:
        return None
