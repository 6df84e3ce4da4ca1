"""Detection of signals that saturate below the stated saturation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...core.errors import CalibrationError
from ..frames.observations import PatchObservation
from ..gains import GainSetting
from ..readings import PatchReading
from ..signal import NetSignal, net_signal

#: Signals this close to the highest one may be a plateau.
_ALIKE_REL = 0.01
#: Ratio to the signal extrapolated from a shorter exposure below which a signal is compressed.
_SHORT = 0.9
#: Least ratio of the light of signals on a plateau, above that of a single bad reading in a non-linear response.
_LIGHT_RATIO = 1.2


def require_no_plateau(
    groups: Mapping[str, Sequence[PatchObservation]],
    readings: Mapping[str, PatchReading],
    settings: Sequence[GainSetting],
) -> None:
    """Refuse a camera whose pixels saturate below the converter's range, which would bias the fit.

    Parameters
    ----------
    groups : dict of str to sequence of PatchObservation
        Usable observations by patch.
    readings : dict of str to PatchReading
        Of the same patches.
    settings : sequence of GainSetting
        Dark signal and noise of the gains.

    Raises
    ------
    CalibrationError
        If several of the highest signals are equal for different light and each is below that extrapolated from a
        shorter exposure of its patch. Signals of a non-linear response can be too low, but still grow with the light.
    """
    rows = [
        (o, signal, readings[patch].luminance_cd_m2 / signal.scale_per_s, _promised(signal, own))
        for patch, group in groups.items()
        for own in [[net_signal(o, settings) for o in group]]
        for o, signal in zip(group, own, strict=True)
    ]
    for gain_index in range(len(settings)):
        of_gain = [row for row in rows if row[1].gain_index == gain_index]
        highest = max((signal.net_dn for _, signal, _, _ in of_gain), default=0.0)
        short = [
            (o, light, signal.net_dn + settings[gain_index].dark.mean_dn(o.exposure_s, o.temperature_c))
            for o, signal, light, promised in of_gain
            if signal.net_dn > (1 - _ALIKE_REL) * highest and signal.net_dn < _SHORT * promised
        ]
        if len(short) < 2:
            continue
        lights = [light for _, light, _ in short]
        if max(lights) > _LIGHT_RATIO * min(lights):
            level = float(np.mean([dn for _, _, dn in short]))
            names = ", ".join(f"{o.patch!r} at {o.exposure_s:g} s" for o, _, _ in short[:3])
            more = f" and {len(short) - 3} more" if len(short) > 3 else ""
            raise CalibrationError(
                f"the signal stays at {level:.4g} DN with more light (patches {names}{more}): the camera saturates "
                f"there, below the {short[0][0].state.saturation_dn:g} DN that count as saturated; record with "
                "exposures at which no patch comes near that"
            )


def _promised(signal: NetSignal, own: Sequence[NetSignal]) -> float:
    """Signal by the shortest exposure of the same patch and gain."""
    shortest = max((s for s in own if s.gain_index == signal.gain_index), key=lambda s: s.scale_per_s)
    return shortest.net_dn * shortest.scale_per_s / signal.scale_per_s
