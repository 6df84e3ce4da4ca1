"""Detection of a single bad reading."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import hypot, sqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...core.reading import Reading
from ...core.result import Finding, warning
from ..findings import LeftOut
from ..frames.observations import Groups
from ..readings import combine_readings, contradict, contradiction, distinct
from ..sensor.noise import GainSetting
from ..setup import Readings
from ..signal import net_signals, usable
from ..uncertainty import critical_value
from .candidates import CandidateModel
from .design import Array, Design
from .problem import Shift, Solution, solutions
from .scatter import shift_with_scatter
from .selection import WORTH, strongest_alternative

#: Largest fraction of the patches that may be left out (at least one).
MAX_SHARE = 0.1
#: Fewest patches for detecting a bad one, so that three remain.
_MIN_PATCHES = 4
#: Standard uncertainties within which a reading agrees with the camera.
_AGREES = 3.0
#: Signals this close to the highest one may be a plateau.
_ALIKE_REL = 0.01
#: Ratio to the signal extrapolated from a shorter exposure below which a signal is compressed.
_SHORT = 0.9
#: Least ratio of the light of signals on a plateau, above that of a single bad reading in a non-linear response.
_LIGHT_RATIO = 1.2
#: Share of a full well above which some pixels of a patch may be full.
SAFE_SHARE = 0.9


@dataclass(frozen=True, eq=False)
class FitData:
    """What a fit uses, and what it leaves out.

    Parameters
    ----------
    design : Design
        Usable observations and readings.
    left_out : tuple of LeftOut
        Excluded exposures, readings and patches.
    findings : tuple of Finding
        Findings for the user.
    """

    design: Design
    left_out: tuple[LeftOut, ...]
    findings: tuple[Finding, ...]

    def instead(self, design: Design, left_out: LeftOut, finding: Finding) -> FitData:
        """Return the same with a design from which more is left out."""
        return FitData(design, (*self.left_out, left_out), (*self.findings, finding))


def screen(data: FitData, candidates: Sequence[CandidateModel], readings: Readings) -> FitData:
    """Exclude readings that contradict camera and other patches.

    Of two contradicting readings of one patch, the one closer to the camera is kept. A patch is bad if its standardised
    deleted residual (from a fit without its reading) exceeds the Bonferroni critical value for all patches, and no
    alternative explains the deviation better: another response, glare, a wrong dark signal or exposure time, a drift,
    or the positions of the patches. At most one patch or `MAX_SHARE` of them is left out.

    Parameters
    ----------
    data : FitData
        All usable patches.
    candidates : sequence of CandidateModel
        Candidate responses.
    readings : mapping of str to sequence of Reading
        Each reading of the patches.
    """
    for patch in range(len(data.design.patches)):
        data = _better_of_two(data, candidates, patch, readings[data.design.patches[patch]])
    most = max(1, int(MAX_SHARE * len(data.design.patches)))
    for _ in range(most):
        design = data.design
        bad = _bad_patch(design, candidates) if len(design.patches) >= _MIN_PATCHES else None
        if bad is None:
            break
        patch, expected = bad
        name, shown = design.patches[patch], float(design.reading_cd_m2[patch])
        found = contradiction("patch-contradicts", name, shown, expected)
        left_out = LeftOut(name, None, None, "contradicts the other patches")
        data = data.instead(design.without(patch), left_out, found)
    return data


def _bad_patch(design: Design, candidates: Sequence[CandidateModel]) -> tuple[int, float] | None:
    """Find the number of a bad patch, and its luminance by the others; None if there is none."""
    best = _best_without_one(design, candidates, range(len(design.patches)))
    if best is None:
        return None
    solution, patch = best
    shift = shift_with_scatter(solution, _pattern(design, patch))
    # Even where the other patches seem not to scatter, they are few.
    dof = len(design.patches) - solution.parameters.size - 1
    if not shift.known or shift.z <= critical_value(len(design.patches), dof):
        return None
    alternative = strongest_alternative(solution)
    if alternative is not None and alternative[1] >= solution.shift(_pattern(design, patch)).z:
        return None
    expected = float(design.reading_cd_m2[patch] + shift.value)
    return (patch, expected) if expected > 0 else None


def _best_without_one(
    design: Design, candidates: Sequence[CandidateModel], patches: Iterable[int]
) -> tuple[Solution, int] | None:
    """Find the model that fits best without the reading of one of these patches, and which; None if no model fits."""
    found = []
    for solution in solutions(design, candidates):
        drop, worst = max((solution.shift(_pattern(design, patch)).z ** 2, -patch) for patch in patches)
        left = solution.chi_squared - drop + WORTH * (solution.candidate.n_parameters - 1)
        found.append((left, solution, -worst))
    return min(found, key=lambda one: one[0])[1:] if found else None


def _better_of_two(
    data: FitData, candidates: Sequence[CandidateModel], patch: int, readings: Sequence[Reading]
) -> FitData:
    """Of two contradicting readings of a patch, keep the one that agrees with the camera."""
    design, name = data.design, data.design.patches[patch]
    pair = distinct(readings)
    if len(pair) != 2 or not contradict([*pair.values()]) or len(design.patches) < _MIN_PATCHES:
        return data
    best = _best_without_one(design, candidates, [patch])
    shift = Shift() if best is None else best[0].shift(_pattern(design, patch))
    if not shift.known:
        return data
    expected = float(design.reading_cd_m2[patch] + shift.value)
    # The shift's variance less that of this patch's reading is the camera's.
    by_camera = sqrt(max(shift.uncertainty**2 - float(design.reading_variance[patch]), 0.0))
    off = {
        k: abs(r.luminance_cd_m2 - expected) / hypot(by_camera, r.standard_uncertainty_random_cd_m2, 1e-9 * expected)
        for k, r in pair.items()
    }
    right, wrong = sorted(off, key=lambda k: off[k])
    if off[right] >= _AGREES or off[wrong] <= critical_value(2 * len(design.patches)):
        return data
    kept, _ = combine_readings(name, [pair[right]])
    shown = pair[wrong].luminance_cd_m2, kept.luminance_cd_m2
    found = contradiction("reading-contradicts", name, *shown, number=wrong)
    left_out = LeftOut(name, None, wrong, "contradicts the other readings")
    return data.instead(design.with_reading(patch, kept), left_out, found)


def _pattern(design: Design, patch: int) -> Array:
    """Effect of a patch's reading that is too low by 1 cd/m^2 on luminances less readings."""
    return np.where(design.patch == patch, 1.0, 0.0)


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
    found: list[tuple[float, float]] = []
    for index, setting in enumerate(settings):
        rows: list[Any] = [np.empty((3, 0))]
        for patch, group in groups.items():
            signals = net_signals(usable(group, settings)[0], settings)
            own = signals.where(signals.gain_index == index)
            light = float(np.mean([reading.luminance_cd_m2 for reading in readings[patch]]))
            promised = own.net_dn * own.scale_per_s
            if own.net_dn.size:
                promised = promised[np.argmax(own.scale_per_s)] / own.scale_per_s
            rows.append([own.net_dn, light / own.scale_per_s, promised])
        level = plateau_dn(*np.hstack(rows))
        if level is not None:
            found.append((level + setting.dark.offset_dn, SAFE_SHARE * level + setting.dark.offset_dn))
    if not found:
        return None
    level_dn, safe_dn = min(found)
    stated_dn = next(iter(groups.values()))[0].state.saturation_dn
    return safe_dn, warning("full-below-saturation", level_dn=level_dn, stated_dn=stated_dn, saturation_dn=safe_dn)
