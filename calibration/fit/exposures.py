"""Exposure times that the patches contradict: found one after the other, and corrected."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...core.result import Finding, warning
from ..converter import EXPOSURE_TIME
from ..exposure_times import ExposureTimes
from ..uncertainty import critical_value
from .candidates import CandidateModel
from .design import DRIFT, Array, Design, SharedError
from .problem import Shift, Solution, solve
from .scatter import shift_with_scatter
from .selection import exposure_patterns

#: Tolerated relative deviation of an exposure time: small compared with the 2 % of a meter.
EXPOSURE_TOLERANCE_REL = 0.002
#: Source of the error of an offset.
OFFSET = "exposure offset"


def with_applied_times(design: Design, candidate: CandidateModel) -> tuple[Design, ExposureTimes, list[Finding]]:
    """Correct exposure times, by an offset of all or by deviations of single ones, as long as one is significant.

    A veil or a wrong dark signal that explains the deviations better is left to its own test, and nothing is corrected;
    so are exposures to which a bracket has fitted the response. At least one exposure stays as stated.

    Parameters
    ----------
    design : Design
        The observations.
    candidate : CandidateModel
        The model.

    Returns
    -------
    Design
        With the applied times, and their uncertainties as common errors.
    ExposureTimes
        What was found.
    list of Finding
        One for each effect.
    """
    times, findings = ExposureTimes(), list[Finding]()
    stated_s = design.exposures_s
    for _ in range(0 if candidate.bracket is not None else stated_s.size - 1):
        solution = solve(design.without_shared(DRIFT), candidate)
        found = _most_significant(solution, times)
        if found is None:
            break
        exposure_s, shift = found
        if exposure_s is None:
            times = replace(times, offset_s=float(shift.value), offset_u_s=float(shift.uncertainty))
            findings.append(warning("exposures-offset", offset_s=float(shift.value), expanded_s=shift.expanded))
        else:
            deviation = exposure_s, float(shift.value), float(shift.uncertainty)
            times = replace(times, deviations=(*times.deviations, deviation))
            value, expanded = float(shift.value), shift.expanded
            findings.append(
                warning("exposure-deviates", exposure_s=exposure_s, deviation_rel=value, expanded_rel=expanded)
            )
        design = _applied(design, exposure_s, shift)
    return design, times, findings


def offset_pattern(solution: Solution) -> Array:
    """Deviations by exposures that are all 1 s longer than stated; 0 for a single one."""
    design = solution.design
    pattern: Array = solution.luminance / design.exposures_s[design.exposure]
    return pattern if design.exposures_s.size > 1 else np.zeros_like(pattern)


def _most_significant(solution: Solution, times: ExposureTimes) -> tuple[float | None, Shift] | None:
    """Return the exposure, None for an offset of all, and its shift; None if no effect is significant."""
    single = exposure_patterns(solution)
    known = {exposure_s for exposure_s, _, _ in times.deviations}
    rows: list[tuple[float | None, Array, float]] = [(t, pattern, 1.0) for t, pattern in single if t not in known]
    if single and not times.offset_s:
        rows.insert(0, (None, offset_pattern(solution), float(solution.design.exposures_s.min())))
    shifts = [(exposure_s, shift_with_scatter(solution, pattern), scale) for exposure_s, pattern, scale in rows]
    exposure_s, shift, scale = max(shifts, key=lambda row: row[1].z, default=(None, Shift(), 1.0))
    limit = max(critical_value(len(rows), shift.dof) * shift.uncertainty, EXPOSURE_TOLERANCE_REL * scale)
    if not shift.known or abs(shift.value) <= limit:
        return None
    pattern = next(row[1] for row in rows if row[0] == exposure_s)
    rivals = np.ones_like(solution.luminance), solution.slope
    if solution.shift(pattern).z < max(solution.shift(rival).z for rival in rivals):
        return None
    return exposure_s, shift


def _applied(design: Design, exposure_s: float | None, shift: Shift) -> Design:
    """Return the same with a corrected exposure, or all of them."""
    stated = design.exposures_s[design.exposure]
    if exposure_s is None:
        factor = 1 + shift.value / stated
        errors = [*design.shared, SharedError(OFFSET, shift.uncertainty / stated)]
    else:
        own = stated == exposure_s
        factor = np.where(own, 1 + shift.value, 1.0)
        errors = [*design.shared, SharedError(EXPOSURE_TIME, np.where(own, shift.uncertainty, 0.0))]
    signals = replace(design.signals, scale_per_s=design.signals.scale_per_s / factor)
    return replace(design, signals=signals, shared=tuple(errors))
