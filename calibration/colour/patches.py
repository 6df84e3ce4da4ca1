"""Patches of a fit of colour planes: luminances by meter and planes, and the residual table."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from math import hypot

import numpy as np
from numpy.typing import NDArray

from ...core.errors import CalibrationError
from ...core.frame import PLANES
from ...core.reading import Reading
from ...core.result import Finding, info, warning
from ..convert.patch import PatchLuminance, patch_luminance
from ..findings import LeftOut
from ..fit.intake import MIN_PATCHES, gain_settings
from ..frames.observations import DarkObservation, PatchObservation
from ..model import Calibration
from ..readings import PatchReading, combine_readings
from ..signal import left_out_text, net_signals, usable
from .conversion import colourfulness, colours_of_planes, own_rel
from .weights import ColourData

#: Relative difference of the planes' signal ratios within one spectrum; linearity is not known yet.
_SAME_RATIO = 0.1


@dataclass(frozen=True, eq=False)
class ColourPatches:
    """Patches the combination is fitted to.

    Parameters
    ----------
    names : tuple of str
        The patches.
    readings : tuple of PatchReading
        By the meter.
    seen : tuple of tuple of PatchLuminance
        By each single plane.
    centres_px : tuple of (float, float)
        Middle (x, y) of each region in the Bayer frame.
    data : ColourData
        The same as numbers, by colour.
    left_out : tuple of LeftOut
        Patches that cannot be used.
    findings : tuple of Finding
        Findings for the user.
    """

    names: tuple[str, ...]
    readings: tuple[PatchReading, ...]
    seen: tuple[tuple[PatchLuminance, ...], ...]
    centres_px: tuple[tuple[float, float], ...]
    data: ColourData
    left_out: tuple[LeftOut, ...]
    findings: tuple[Finding, ...]


def by_patch(
    observations: Mapping[str, Sequence[PatchObservation]], planes: Sequence[str] = PLANES
) -> dict[str, dict[str, list[PatchObservation]]]:
    """Sort observations by patch, then by plane."""
    groups: dict[str, dict[str, list[PatchObservation]]] = {}
    for plane in planes:
        for o in observations.get(plane, ()):
            groups.setdefault(o.patch, {}).setdefault(plane, []).append(o)
    return groups


def colour_patches(
    planes: Sequence[Calibration],
    groups: Mapping[str, Mapping[str, Sequence[PatchObservation]]],
    readings: Mapping[str, Sequence[Reading]],
) -> ColourPatches:
    """Put readings and planes of each patch together.

    Parameters
    ----------
    planes : sequence of Calibration
        Fitted planes.
    groups : mapping
        Observations by patch, then by plane.
    readings : mapping of str to sequence of Reading
        The meter's readings by patch.

    Raises
    ------
    CalibrationError
        If no patch is usable in all planes.
    """
    kept: list[tuple[str, PatchReading, tuple[PatchLuminance, ...]]] = []
    shared_rel: list[float] = []
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
            seen = [patch_luminance(plane, group.get(f"{plane.state.plane}", ())) for plane in planes]
        except CalibrationError as error:
            left_out.append(LeftOut(name, None, None, "not usable in all planes"))
            findings.append(warning("patch-not-in-all-planes", name, reason=str(error)))
            continue
        kept.append((name, reading, tuple(seen)))
        shared_rel.append(hypot(reading.random_cd_m2 / reading.luminance_cd_m2, uneven_rel(planes, group), of_field))
    if not kept:
        raise CalibrationError(f"no patch is usable in all planes ({left_out_text(left_out)}): acquire other exposures")
    names, joined, all_seen = zip(*kept, strict=True)
    return ColourPatches(
        names,
        joined,
        all_seen,
        tuple(centre_px(groups[name]) for name in names),
        _data(planes, joined, all_seen, shared_rel),
        tuple(left_out),
        tuple(findings),
    )


def uneven_rel(planes: Sequence[Calibration], group: Mapping[str, Sequence[PatchObservation]]) -> float:
    """Relative non-uniformity of a patch, which meter and camera view at slightly different positions.

    By the plane that sees the most light, and the exposures that it can use; observations are by the name of the plane,
    empty for a monochrome sensor.
    """
    plane = max(planes, key=lambda one: one.responsivity.responsivity_dn_s_cd_m2)
    kept, _, _ = usable(group[plane.state.plane or ""], plane.settings)
    return float(np.mean(net_signals(kept, plane.settings).slow_rel)) if kept else 0.0


def _data(
    planes: Sequence[Calibration],
    readings: Sequence[PatchReading],
    seen: Sequence[Sequence[PatchLuminance]],
    shared_rel: Sequence[float],
) -> ColourData:
    to_colour = colours_of_planes(planes)
    luminance = np.array([[one.luminance_cd_m2 for one in row] for row in seen])
    own = np.array([[own_rel(plane, one) for plane, one in zip(planes, row, strict=True)] for row in seen])
    reading = np.array([r.luminance_cd_m2 for r in readings])
    by_colour = luminance @ to_colour
    error = np.sqrt((luminance * own) ** 2 @ to_colour**2)
    return ColourData(
        by_colour / reading[:, None], error / np.abs(by_colour), np.array(shared_rel), colourfulness(by_colour)
    )


def centre_px(group: Mapping[str, Sequence[PatchObservation]]) -> tuple[float, float]:
    """Middle (x, y) of a patch in the Bayer frame; a plane has half its pixels along each side."""
    x, y = next(iter(group.values()))[0].centre_px
    return 2 * x, 2 * y


def one_spectrum(
    observations: Mapping[str, Sequence[PatchObservation]],
    darks: Mapping[str, Sequence[DarkObservation]],
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
    rates = {plane: _rates(observations[plane], darks[plane], names) for plane in PLANES}
    seen = [name for name in names if all(name in of_plane for of_plane in rates.values())]
    level = {name: np.log([rates[p][name][0] for p in PLANES]) for name in seen}
    noise = {name: np.array([rates[p][name][1] for p in PLANES]) for name in seen}
    best: list[str] = []
    for name in seen:
        group = [
            other
            for other in seen
            if np.all(np.abs(_centred(level[other] - level[name])) < _SAME_RATIO + 3 * (noise[other] + noise[name]))
        ]
        best = max(best, group, key=len)
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


def _centred(values: NDArray[np.float64]) -> NDArray[np.float64]:
    centred: NDArray[np.float64] = values - values.mean()
    return centred


def _rates(
    observations: Sequence[PatchObservation], darks: Sequence[DarkObservation], names: Collection[str]
) -> dict[str, tuple[float, float]]:
    """Signal above dark per second, with its relative standard uncertainty; patches that are not usable are missing."""
    if not darks:
        return {}
    settings, _, _ = gain_settings(observations, darks)
    result = {}
    for name in names:
        kept, _, _ = usable([o for o in observations if o.patch == name], settings[:1])
        signals = net_signals(kept, settings)
        weight = 1 / (signals.scale_per_s**2 * signals.variance_dn2)
        if weight.size:
            rate = float(np.average(signals.net_dn * signals.scale_per_s, weights=weight))
            result[name] = rate, float(1 / (np.sqrt(weight.sum()) * rate))
    return result
