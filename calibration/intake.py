"""What goes into a fit: observations, darks and readings checked against each other, and sorted by patch and gain."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from ..errors import CalibrationError
from ..reading import Reading
from ..response import Response
from .dark import DarkModel, fit_dark
from .findings import LeftOut
from .gains import GainSetting
from .noise import fit_noise
from .observations import GAIN_TOLERANCE_DB, DarkObservation, PatchObservation
from .plateau import require_no_plateau
from .readings import PatchReading, combine_readings
from .signal import usable

#: Fewest patches: one parameter, one more for the test of the intercept, and one to judge the fit by.
MIN_PATCHES = 3
#: Fewest patches without a warning.
ADVISED_PATCHES = 6


@dataclass(frozen=True, eq=False)
class Usable:
    """Usable observations and readings by patch, and what was left out.

    Parameters
    ----------
    groups : dict of str to list of PatchObservation
        By patch, in the order of the observations.
    readings : dict of str to PatchReading
        Of the same patches.
    left_out : list of LeftOut
        Exposures, readings and patches that were not used.
    warnings : list of str
        What the user should know.
    """

    groups: Mapping[str, Sequence[PatchObservation]]
    readings: Mapping[str, PatchReading]
    left_out: Sequence[LeftOut]
    warnings: Sequence[str]


def require_one_camera(observations: Sequence[PatchObservation], darks: Sequence[DarkObservation]) -> None:
    """Refuse observations and darks that differ in more than gain; darks need a gain of the light frames.

    Raises
    ------
    CalibrationError
        The message names the difference, or the gain without dark frames.
    """
    if not observations:
        raise CalibrationError("there is no observation of a patch: take light frames with at least 3 patches")
    first = observations[0]
    gains_db = [o.state.gain_db for o in observations]
    for dark in darks:
        name = f"the set of dark frames at {dark.exposure_s:g} s"
        first.state.require(dark.state, "the light frames", name, list(dict.fromkeys(gains_db))[1:])
    for other in observations[1:]:
        name = f"patch {other.patch!r} at {other.exposure_s:g} s"
        first.state.require(other.state, "the first observation", name, gains_db)
        if other.vignetting != first.vignetting:
            raise CalibrationError(
                f"{name} was observed with vignetting {other.vignetting}, the first observation with "
                f"{first.vignetting}: observe all patches with the same"
            )


def gain_settings(
    observations: Sequence[PatchObservation], darks: Sequence[DarkObservation], tone: Response | None = None
) -> tuple[tuple[GainSetting, ...], list[str], list[str]]:
    """Darkness and noise of each gain, the first observation's first; factors are 1.

    Parameters
    ----------
    observations, darks : sequence of PatchObservation, of DarkObservation
        Of one camera.
    tone : Response or None
        As of `fit_noise`.

    Returns
    -------
    tuple of GainSetting
        One for each gain.
    list of str
        Warnings.
    list of str
        Those of the warnings that are about the darkness at the first gain.

    Raises
    ------
    CalibrationError
        If a gain has no dark frames.
    """
    gains_db: list[float] = []
    for o in observations:
        if not any(abs(o.state.gain_db - known) <= GAIN_TOLERANCE_DB for known in gains_db):
            gains_db.append(o.state.gain_db)
    settings: list[GainSetting] = []
    warnings: list[str] = []
    of_dark: list[str] = []
    for gain_db in gains_db:
        own_darks = [d for d in darks if abs(d.state.gain_db - gain_db) <= GAIN_TOLERANCE_DB]
        if darks and not own_darks:
            raise CalibrationError(
                f"there are no dark frames at a gain of {gain_db:g} dB: take some at each exposure, or leave this gain "
                "out"
            )
        own = [o for o in observations if abs(o.state.gain_db - gain_db) <= GAIN_TOLERANCE_DB]
        dark, dark_warnings = fit_dark(own_darks)
        noise, noise_warnings = fit_noise(own, dark, tone)
        if not settings:
            of_dark = dark_warnings
        prefix = f"at {gain_db:g} dB: " if len(gains_db) > 1 else ""
        found = [*dark_warnings, *noise_warnings, *_temperature_warnings(own, dark)]
        warnings += [prefix + warning for warning in found]
        settings.append(GainSetting(gain_db, 1.0, 0.0, dark, noise))
    return tuple(settings), warnings, of_dark


def group_by_patch(
    observations: Sequence[PatchObservation], readings: Mapping[str, Sequence[Reading]], held_out: Collection[str]
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
    groups: Mapping[str, Sequence[PatchObservation]],
    readings: Mapping[str, Sequence[Reading]],
    settings: Sequence[GainSetting],
) -> Usable:
    """Join readings, and leave out what is clipped, black, or reads zero.

    Raises
    ------
    CalibrationError
        If fewer than `MIN_PATCHES` patches are left, or as `require_no_plateau`.
    """
    kept_groups: dict[str, Sequence[PatchObservation]] = {}
    kept_readings: dict[str, PatchReading] = {}
    left_out: list[LeftOut] = []
    warnings: list[str] = []
    for patch, group in groups.items():
        reading, reading_warnings = combine_readings(patch, readings[patch])
        kept, exposures_left_out, exposure_warnings = usable(group, settings)
        warnings += reading_warnings + exposure_warnings
        left_out += [*reading.left_out, *exposures_left_out]
        if reading.luminance_cd_m2 == 0:
            left_out.append(LeftOut(patch, None, None, "reads 0 cd/m^2, below the meter's range"))
            warnings.append(f"patch {patch!r} reads 0 cd/m^2, below the meter's range: left out of the fit")
        elif not kept:
            left_out.append(LeftOut(patch, None, None, "is usable at no exposure"))
            warnings.append(f"patch {patch!r} is usable at no exposure: left out of the fit")
        else:
            kept_groups[patch], kept_readings[patch] = kept, reading
    if len(kept_groups) < MIN_PATCHES:
        reasons = "; ".join(w for w in warnings if "left out" in w)
        raise CalibrationError(
            f"{len(kept_groups)} of {len(groups)} patches are usable, a calibration needs at least {MIN_PATCHES} (one "
            "for the slope, one to test the intercept, one to judge the fit) and is good from "
            f"{ADVISED_PATCHES} on: add patches or exposures" + (f" ({reasons})" if reasons else "")
        )
    require_no_plateau(kept_groups, kept_readings, settings)
    return Usable(kept_groups, kept_readings, left_out, warnings)


def _temperature_warnings(observations: Sequence[PatchObservation], dark: DarkModel) -> list[str]:
    """Warnings about frames taken at another temperature than the dark ones."""
    unknown = sorted({o.exposure_s for o in observations if o.temperature_c is None})
    if unknown and dark.doubling_temperature_c is not None:
        return [
            f"the light frames at {unknown[0]:g} s have no temperature: their darkness is taken at "
            f"{dark.temperature_c:.1f} degC"
        ]
    return dark.temperature_warnings((o.exposure_s, o.temperature_c) for o in observations)
