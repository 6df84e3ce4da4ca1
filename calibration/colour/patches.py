"""Patches of a fit of colour planes: luminances by meter and planes, and the residual table."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from math import hypot

import numpy as np

from ...core.errors import CalibrationError
from ...core.frame import PLANES
from ...core.reading import Reading
from ...core.result import Finding, info, warning
from ..convert.patch import PatchLuminance, patch_luminance
from ..fit_records import LeftOut
from ..fitting.intake import MIN_PATCHES, gain_settings
from ..frames.observations import DarkObservation, PatchObservation
from ..model import Calibration, PatchResidual
from ..readings import PatchReading, combine_readings
from ..signal import left_out_text, net_signals, usable
from .conversion import ByPlane, colourfulness, colours_of_planes, own_rel
from .weights import ColourData

#: Relative difference of the planes' signal ratios within one spectrum; linearity is not known yet.
_SAME_RATIO = 0.1


@dataclass(frozen=True, eq=False)
class ColourPatch:
    """A patch that the combination is fitted to.

    Parameters
    ----------
    reading : PatchReading
        By the meter.
    seen : tuple of PatchLuminance
        By each single plane.
    centre_px : (float, float)
        Middle (x, y) of its region in the Bayer frame.
    shared_rel : float
        Relative standard uncertainty common to all planes.
    """

    reading: PatchReading
    seen: tuple[PatchLuminance, ...]
    centre_px: tuple[float, float]
    shared_rel: float

    @property
    def name(self) -> str:
        """Its name."""
        return self.reading.patch

    def residual(self, deviation: float, stated_rel: float, without: float) -> PatchResidual:
        """Return its row, with the deviation of the combination from the reading, and that of one without the patch."""
        exposures_s = tuple(sorted({t for plane in self.seen for t in plane.exposures_s}))
        seen = self.reading.luminance_cd_m2 * (1 + deviation), exposures_s
        return PatchResidual.compared(self.reading, seen, stated_rel, self.centre_px, without)


def by_patch(
    observations: ByPlane[PatchObservation], planes: Sequence[str | None] = PLANES
) -> dict[str, ByPlane[PatchObservation]]:
    """Sort observations by patch, then by plane."""
    groups: dict[str, dict[str | None, list[PatchObservation]]] = {}
    for plane in planes:
        for o in observations.get(plane, ()):
            groups.setdefault(o.patch, {}).setdefault(plane, []).append(o)
    return {**groups}


def colour_patches(
    planes: Sequence[Calibration],
    groups: Mapping[str, ByPlane[PatchObservation]],
    readings: Mapping[str, Sequence[Reading]],
) -> tuple[list[ColourPatch], list[LeftOut], list[Finding]]:
    """Put readings and planes of each patch together.

    Parameters
    ----------
    planes : sequence of Calibration
        Fitted planes.
    groups : mapping
        Observations by patch, then by plane.
    readings : mapping of str to sequence of Reading
        The meter's readings by patch.

    Returns
    -------
    list of ColourPatch
        The patches.
    list of LeftOut
        Patches that cannot be used.
    list of Finding
        Findings for the user.

    Raises
    ------
    CalibrationError
        If no patch is usable in all planes.
    """
    kept: list[ColourPatch] = []
    of_field = max(plane.field_rel for plane in planes)
    left_out: list[LeftOut] = []
    findings: list[Finding] = []
    for name, group in groups.items():
        reading, of_reading = combine_readings(name, readings[name])
        findings += of_reading
        if reading.luminance_cd_m2 == 0:
            left_out.append(LeftOut(name, None, None, "below the meter's range"))
            findings.append(warning("patch-reads-zero", name))
            continue
        try:
            seen = tuple(patch_luminance(plane, group.get(plane.state.plane, ())) for plane in planes)
        except CalibrationError as error:
            left_out.append(LeftOut(name, None, None, "not usable in all planes"))
            findings.append(warning("patch-not-in-all-planes", name, reason=str(error)))
            continue
        shared_rel = hypot(reading.random_cd_m2 / reading.luminance_cd_m2, nonuniformity_rel(planes, group), of_field)
        kept.append(ColourPatch(reading, seen, centre_px(group), shared_rel))
    if not kept:
        raise CalibrationError(f"no patch is usable in all planes ({left_out_text(left_out)}): acquire other exposures")
    return kept, left_out, findings


def colour_data(planes: Sequence[Calibration], patches: Sequence[ColourPatch]) -> ColourData:
    """Return what patches say by each colour, as numbers."""
    to_colour = colours_of_planes(planes)
    luminance = np.array([[seen.luminance_cd_m2 for seen in patch.seen] for patch in patches])
    noise_rel = np.array(
        [[own_rel(plane, seen) for plane, seen in zip(planes, patch.seen, strict=True)] for patch in patches]
    )
    reading = np.array([patch.reading.luminance_cd_m2 for patch in patches])
    by_colour = luminance @ to_colour
    error = np.sqrt((luminance * noise_rel) ** 2 @ to_colour**2)
    shared_rel = np.array([patch.shared_rel for patch in patches])
    return ColourData(by_colour / reading[:, None], error / np.abs(by_colour), shared_rel, colourfulness(by_colour))


def nonuniformity_rel(planes: Sequence[Calibration], group: ByPlane[PatchObservation]) -> float:
    """Relative non-uniformity of a patch, which meter and camera view at slightly different positions.

    By the plane that sees the most light, and the exposures that it can use.
    """
    plane = max(planes, key=lambda plane: plane.responsivity.responsivity_dn_s_cd_m2)
    kept, _, _ = usable(group[plane.state.plane], plane.settings)
    return float(np.mean(net_signals(kept, plane.settings).slow_rel)) if kept else 0.0


def centre_px(group: ByPlane[PatchObservation]) -> tuple[float, float]:
    """Middle (x, y) of a patch in the Bayer frame; a plane has half its pixels along each side."""
    x, y = next(iter(group.values()))[0].centre_px
    return 2 * x, 2 * y


def one_spectrum(
    observations: ByPlane[PatchObservation],
    darks: ByPlane[DarkObservation],
    names: Collection[str],
) -> tuple[list[str], list[Finding]]:
    """Find the largest group of patches of one spectrum, by the ratios of the planes' signals.

    Parameters
    ----------
    observations, darks : mapping of str to sequence
        By plane.
    names : collection of str
        Candidate patches.

    Returns
    -------
    list of str
        Names of the patches.
    list of Finding
        Finding that names the others.

    Raises
    ------
    CalibrationError
        If fewer than `MIN_PATCHES` patches have the same spectrum.
    """
    rates = [_rates(observations[plane], darks[plane], names) for plane in PLANES]
    seen = [name for name in names if all(name in of_plane for of_plane in rates)]
    level, noise = np.array([[of_plane[name] for of_plane in rates] for name in seen]).reshape(-1, len(PLANES), 2).T
    apart = np.log(level)[:, :, None] - np.log(level)[:, None, :]
    same = np.abs(apart - apart.mean(axis=0)) < _SAME_RATIO + 3 * (noise[:, :, None] + noise[:, None, :])
    groups = [[seen[i] for i in np.flatnonzero(row)] for row in same.all(axis=0)]
    best = max(groups, key=len, default=[])
    if len(best) < MIN_PATCHES:
        raise CalibrationError(
            f"{len(best)} of {len(names)} patches have the same colour and are usable in all planes: at least "
            f"{MIN_PATCHES} grey ones are needed, since of another colour a plane sees less or more than the meter; "
            "add grey patches, or other exposures"
        )
    others = [name for name in names if name not in best]
    if not others:
        return best, []
    return best, [info("patches-of-another-colour", patches=others)]


def _rates(
    observations: Sequence[PatchObservation], darks: Sequence[DarkObservation], names: Collection[str]
) -> dict[str, tuple[float, float]]:
    """Signal above dark per second, with its relative standard uncertainty; patches that are not usable are missing."""
    if not darks:
        return {}
    settings, _ = gain_settings(observations, darks)
    result = {}
    for name in names:
        kept, _, _ = usable([o for o in observations if o.patch == name], settings[:1])
        signals = net_signals(kept, settings)
        weight = 1 / (signals.scale_per_s**2 * signals.variance_dn2)
        if weight.size:
            rate = float(np.average(signals.net_dn * signals.scale_per_s, weights=weight))
            result[name] = rate, float(1 / (np.sqrt(weight.sum()) * rate))
    return result
