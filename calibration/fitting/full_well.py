"""Pixels that are full below the stated saturation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...core.result import Finding, warning
from ..frames.observations import Groups
from ..sensor.noise import GainSetting
from ..setup import Readings
from ..signal import net_signals, usable

#: Signals this close to the highest one may be a plateau.
_ALIKE_REL = 0.01
#: Ratio to the signal extrapolated from a shorter exposure below which a signal is compressed.
_SHORT = 0.9
#: Least ratio of the light of signals on a plateau, above that of a single bad reading in a non-linear response.
_LIGHT_RATIO = 1.2
#: Share of a full well above which some pixels of a patch may be full.
SAFE_SHARE = 0.9


def plateau_dn(net_dn: ArrayLike, light: ArrayLike, promised_dn: ArrayLike) -> float | None:
    """Find signals that do not rise with the light.

    Several of the highest signals are equal for different light, and each is below that extrapolated from a shorter
    exposure of its patch. Signals of a non-linear response can be too low, but still grow with the light.

    Parameters
    ----------
    net_dn, light, promised_dn : array_like of float, shape (n,)
        Signals above dark, their relative light, and the signals that the shortest exposure of each patch promises.

    Returns
    -------
    float or None
        Their mean above dark; None without a plateau.
    """
    net, amount, promised = (np.asarray(values, float) for values in (net_dn, light, promised_dn))
    full = (net > (1 - _ALIKE_REL) * net.max(initial=0.0)) & (net < _SHORT * promised)
    if full.sum() < 2 or not amount[full].max() > _LIGHT_RATIO * amount[full].min():
        return None
    return float(net[full].mean())


def full_well(groups: Groups, readings: Readings, settings: Sequence[GainSetting]) -> tuple[float, Finding] | None:
    """Find the DN from which pixels may be full, below the stated saturation.

    Parameters
    ----------
    groups : mapping of str to sequence of PatchObservation
        By patch.
    readings : mapping of str to sequence of Reading
        Of the same patches.
    settings : sequence of GainSetting
        Dark signal and noise of the gains.

    Returns
    -------
    (float, Finding) or None
        90 % of the way from the dark signal to the full well, the lowest of the gains; None if none is found.
    """
    levels: list[tuple[float, float]] = []
    for index, setting in enumerate(settings):
        rows: list[Any] = [np.empty((3, 0))]
        for patch, group in groups.items():
            signals = net_signals(usable(group, settings)[0], settings)
            of_gain = signals.where(signals.gain_index == index)
            light = float(np.mean([reading.luminance_cd_m2 for reading in readings[patch]]))
            promised = of_gain.net_dn * of_gain.scale_per_s
            if of_gain.net_dn.size:
                promised = promised[np.argmax(of_gain.scale_per_s)] / of_gain.scale_per_s
            rows.append([of_gain.net_dn, light / of_gain.scale_per_s, promised])
        level = plateau_dn(*np.hstack(rows))
        if level is not None:
            levels.append((level + setting.dark.offset_dn, SAFE_SHARE * level + setting.dark.offset_dn))
    if not levels:
        return None
    level_dn, safe_dn = min(levels)
    stated_dn = next(iter(groups.values()))[0].state.saturation_dn
    return safe_dn, warning("full-below-saturation", level_dn=level_dn, stated_dn=stated_dn, saturation_dn=safe_dn)
