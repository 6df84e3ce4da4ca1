"""Colours and planes of a Bayer sensor, and the patches of one spectrum."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ...core.errors import CalibrationError
from ...core.finding import Finding, info
from ...core.frame import PLANES
from ..fit.intake import MIN_PATCHES, gain_settings
from ..frames.observations import DarkObservation, PatchObservation
from ..model import Calibration
from ..signal import net_signal, usable

#: The colours, each of one or two planes.
COLOURS = ("R", "G", "B")
#: Relative difference of the planes' signal ratios within one spectrum; linearity is not known yet.
_SAME_RATIO = 0.1


def colours_of_planes(planes: Sequence[Calibration]) -> NDArray[np.float64]:
    """Matrix that averages planes to colours, shape (planes, 3); its transpose distributes a colour's weight."""
    names = [f"{plane.state.plane}"[0] for plane in planes]
    return np.array([[float(name == colour) / max(names.count(colour), 1) for colour in COLOURS] for name in names])


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
        signals = [net_signal(o, settings) for o in kept]
        weight = np.array([1 / (s.scale_per_s**2 * s.variance_dn2) for s in signals])
        if weight.size:
            rate = float(np.average([s.net_dn * s.scale_per_s for s in signals], weights=weight))
            result[name] = rate, float(1 / (np.sqrt(weight.sum()) * rate))
    return result
