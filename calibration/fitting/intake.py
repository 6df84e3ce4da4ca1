"""Input of a fit: observations, dark signals and readings, checked and sorted by patch and gain."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from ...core.clock import exposure_text
from ...core.dn import Response
from ...core.errors import CalibrationError
from ...core.result import Finding, warning
from ..fit_records import LeftOut
from ..frames.observations import DarkObservation, Groups, PatchObservation
from ..readings import PatchReading, combine_patches
from ..sensor.dark import DarkModel, fit_dark
from ..sensor.noise import GainSetting, fit_noise
from ..setup import Readings
from ..signal import left_out_text, usable, with_prnu
from .design import Design, build_design
from .full_well import full_well

#: Fewest patches: one parameter, one more for the test of the intercept, and one to judge the fit by.
MIN_PATCHES = 3
#: Fewest patches without a warning.
ADVISED_PATCHES = 6


@dataclass(frozen=True, eq=False)
class Intake:
    """Observations by patch with dark signal and noise of the gains.

    Parameters
    ----------
    settings : tuple of GainSetting
        One for each gain, the first observation's first; factors are 1.
    findings : list of Finding
        Findings for the user.
    groups : dict of str to list of PatchObservation
        By patch, in the order of the observations.
    held_out : collection of str
        Patches that the fit is not shown.
    """

    settings: tuple[GainSetting, ...]
    findings: list[Finding]
    groups: Groups
    held_out: Collection[str]

    @property
    def fitted(self) -> dict[str, Sequence[PatchObservation]]:
        """Those that are not held out."""
        return {name: group for name, group in self.groups.items() if name not in self.held_out}


def take_in(
    observations: Sequence[PatchObservation],
    darks: Sequence[DarkObservation],
    readings: Readings,
    held_out: Collection[str],
    tone: Response | None = None,
    drift_dn: float | None = None,
) -> Intake:
    """Check and sort the input of a fit; observations of pixels that are full below saturation count as saturated.

    Raises
    ------
    CalibrationError
        As `require_one_camera`, `gain_settings` and `group_by_patch`.
    """
    require_one_camera(observations, darks)

    def taken(seen: Sequence[PatchObservation]) -> Intake:
        settings = gain_settings(seen, darks, tone, drift_dn)
        return Intake(*settings, group_by_patch(seen, readings, held_out), held_out)

    intake = taken(observations)
    full = full_well(intake.fitted, readings, intake.settings)
    if full is None:
        return intake
    intake = taken([o.saturating_at(full[0]) for o in observations])
    return replace(intake, findings=[full[1], *intake.findings])


def require_one_camera(observations: Sequence[PatchObservation], darks: Sequence[DarkObservation]) -> None:
    """Refuse observations and dark frames that differ in more than gain, or dark frames of other gains.

    Raises
    ------
    CalibrationError
        The message names the difference, or the gain without dark frames.
    """
    if not observations:
        raise CalibrationError("there is no observation of a patch: take light frames with at least 3 patches")
    first = observations[0]
    gains_db = [o.state.gain_db for o in observations]
    first.state.require_alike(darks, "the light frames", list(dict.fromkeys(gains_db))[1:])
    for other in observations[1:]:
        name = f"patch {other.patch!r} at {exposure_text(other.exposure_s)}"
        first.state.require(other.state, "the first observation", name, gains_db)
        if other.vignetting != first.vignetting:
            raise CalibrationError(
                f"{name} was observed with vignetting {other.vignetting}, the first observation with "
                f"{first.vignetting}: observe all patches with the same"
            )


def gain_settings(
    observations: Sequence[PatchObservation],
    darks: Sequence[DarkObservation],
    tone: Response | None = None,
    drift_dn: float | None = None,
) -> tuple[tuple[GainSetting, ...], list[Finding]]:
    """Dark signal and noise of each gain, the first observation's first; factors are 1.

    Parameters
    ----------
    observations, darks : sequence of PatchObservation, of DarkObservation
        Of one camera.
    tone : Response or None
        As of `fit_noise`.
    drift_dn : float or None
        As of `fit_dark`.

    Returns
    -------
    tuple of GainSetting
        One for each gain.
    list of Finding
        Findings for the user.

    Raises
    ------
    CalibrationError
        If a gain has no dark frames.
    """
    gains_db: list[float] = []
    for o in observations:
        if not o.state.has_gain(*gains_db):
            gains_db.append(o.state.gain_db)
    settings: list[GainSetting] = []
    findings: list[Finding] = []
    for gain_db in gains_db:
        own_darks = [d for d in darks if d.state.has_gain(gain_db)]
        if darks and not own_darks:
            raise CalibrationError(
                f"there are no dark frames at a gain of {gain_db:g} dB: take some at each exposure, or leave this gain "
                "out"
            )
        seen = [o for o in observations if o.state.has_gain(gain_db)]
        dark, dark_findings = fit_dark(own_darks, drift_dn)
        noise, noise_findings = fit_noise(seen, dark, tone)
        gain_findings = [*dark_findings, *noise_findings, *_temperature_findings(seen, dark)]
        findings += (
            gain_findings
            if len(gains_db) == 1
            else [finding.within(f"gain {gain_db:g} dB") for finding in gain_findings]
        )
        settings.append(with_prnu(GainSetting(gain_db, 1.0, 0.0, dark, noise), seen))
    return tuple(settings), findings


def group_by_patch(
    observations: Sequence[PatchObservation], readings: Readings, held_out: Collection[str]
) -> dict[str, list[PatchObservation]]:
    """Observations by patch; raises CalibrationError if a patch has no reading, a reading or a name no patch."""
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
    for patch in held_out:
        if patch not in groups:
            raise CalibrationError(f"there is no patch {patch!r} to hold out: choose from {', '.join(groups)}")
    return groups


def take_usable(
    intake: Intake, readings: Readings, exposure_jitter_s: float
) -> tuple[Design, tuple[LeftOut, ...], list[Finding]]:
    """Combine readings, and exclude clipped and black exposures and zero readings.

    Returns
    -------
    Design
        Usable observations and readings.
    tuple of LeftOut
        Excluded exposures, readings and patches.
    list of Finding
        Findings for the user.

    Raises
    ------
    CalibrationError
        If fewer than `MIN_PATCHES` patches are left.
    """
    groups: dict[str, Sequence[PatchObservation]] = {}
    kept_readings: dict[str, PatchReading] = {}
    left_out: list[LeftOut] = []
    # A noisy meter shows in all patches: what they scatter is that of each, and nothing is left out for it.
    combined, findings = combine_patches({patch: readings[patch] for patch in intake.fitted})
    for patch, group in intake.fitted.items():
        reading = combined[patch]
        kept, exposures_left_out, of_exposures = usable(group, intake.settings)
        findings += of_exposures
        left_out += [*reading.left_out, *exposures_left_out]
        if reading.luminance_cd_m2 == 0:
            left_out.append(LeftOut(patch, None, None, "below the meter's range"))
            findings.append(warning("patch-reads-zero", patch))
        elif not kept:
            left_out.append(LeftOut(patch, None, None, "not usable at any exposure"))
            findings.append(warning("patch-not-usable", patch))
        else:
            groups[patch], kept_readings[patch] = kept, reading
    if len(groups) < MIN_PATCHES:
        reasons = left_out_text(left_out)
        raise CalibrationError(
            f"{len(groups)} of {len(intake.fitted)} patches are usable, a calibration needs at least {MIN_PATCHES} "
            "(one for the slope, one to test the intercept, one to judge the fit) and is good from "
            f"{ADVISED_PATCHES} on: add patches or exposures" + (f" ({reasons})" if reasons else "")
        )
    design = build_design(groups, kept_readings, intake.settings, exposure_jitter_s)
    return design, tuple(left_out), findings


def _temperature_findings(observations: Sequence[PatchObservation], dark: DarkModel) -> list[Finding]:
    """Return findings on frames at other temperatures than the dark frames."""
    unknown = sorted({o.exposure_s for o in observations if o.temperature_c is None})
    if unknown and dark.doubling_temperature_c is not None:
        return [warning("temperature-unknown", exposure_s=unknown[0], temperature_c=dark.temperature_c)]
    return dark.temperature_findings((o.exposure_s, o.temperature_c) for o in observations)
