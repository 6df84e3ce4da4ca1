"""Detection of a single bad reading."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import hypot, inf, sqrt

import numpy as np

from ...core.errors import CalibrationError
from ...core.finding import Finding, warning
from ...core.reading import Reading
from ..findings import LeftOut
from ..readings import PatchReading, contradict, likely_cause, single_reading
from .alternatives import WORTH, ratio, strongest_alternative
from .candidates import CandidateModel
from .design import Array, Design
from .problem import Solution, solve
from .scatter import shift_with_scatter
from .significance import critical_value

#: Largest fraction of the patches that may be left out (at least one).
MAX_SHARE = 0.1
#: Fewest patches for detecting a bad one, so that three remain.
_MIN_PATCHES = 4
#: Standard uncertainties within which a reading agrees with the camera.
_AGREES = 3.0


@dataclass(frozen=True, eq=False)
class Screened:
    """Data after exclusion of bad readings.

    Parameters
    ----------
    design : Design
        Without them.
    readings : dict of str to PatchReading
        Of the patches in the design.
    left_out : tuple of LeftOut
        Excluded data.
    findings : tuple of Finding
        Findings with the contradicting values.
    """

    design: Design
    readings: Mapping[str, PatchReading]
    left_out: tuple[LeftOut, ...]
    findings: tuple[Finding, ...]


def screen(
    design: Design,
    candidates: Sequence[CandidateModel],
    joined: Mapping[str, PatchReading],
    readings: Mapping[str, Sequence[Reading]],
) -> Screened:
    """Exclude readings that contradict camera and other patches.

    Of two contradicting readings of one patch, the one closer to the camera is kept. A patch is bad if its standardised
    deleted residual (from a fit without its reading) exceeds the Bonferroni critical value for all patches, and no
    alternative explains the deviation better: another response, glare, a wrong dark signal or exposure time, a drift,
    or the positions of the patches. At most one patch or `MAX_SHARE` of them is left out.

    Parameters
    ----------
    design : Design
        All usable patches.
    candidates : sequence of CandidateModel
        Candidate responses.
    joined : mapping of str to PatchReading
        The patches' readings.
    readings : mapping of str to sequence of Reading
        Each reading of them.
    """
    design, joined, left_out, findings = _choose_of_two(design, candidates, dict(joined), readings)
    most = max(1, int(MAX_SHARE * len(design.patches)))
    for _ in range(most):
        if len(design.patches) < _MIN_PATCHES:
            break
        bad = _bad_patch(design, candidates)
        if bad is None:
            break
        patch, expected = bad
        name, shown = design.patches[patch], float(design.reading_cd_m2[patch])
        left_out.append(LeftOut(name, None, None, "contradicts the other patches"))
        findings.append(
            warning(
                f"patch-contradicts{likely_cause(shown / expected)}",
                name,
                reading_cd_m2=shown,
                expected_cd_m2=expected,
                ratio=shown / expected,
            )
        )
        design = design.without(patch)
    return Screened(design, {name: joined[name] for name in design.patches}, tuple(left_out), tuple(findings))


def _bad_patch(design: Design, candidates: Sequence[CandidateModel]) -> tuple[int, float] | None:
    """Find the number of a bad patch, and its luminance by the others; None if there is none."""
    best = _best_without_one(design, candidates, range(len(design.patches)))
    if best is None:
        return None
    solution, patch = best
    value, uncertainty, _ = shift_with_scatter(solution, _pattern(design, patch))
    # Even where the other patches seem not to scatter, they are few.
    dof = len(design.patches) - solution.parameters.size - 1
    if uncertainty == inf or abs(value) <= critical_value(len(design.patches), dof) * uncertainty:
        return None
    alternative = strongest_alternative(solution)
    if alternative is not None and alternative[1] >= ratio(solution.shift(_pattern(design, patch))):
        return None
    expected = float(design.reading_cd_m2[patch] + value)
    return (patch, expected) if expected > 0 else None


def _best_without_one(
    design: Design, candidates: Sequence[CandidateModel], patches: Iterable[int]
) -> tuple[Solution, int] | None:
    """Find the model that fits best without the reading of one of these patches, and which; None if no model fits."""
    best: tuple[float, Solution, int] | None = None
    for candidate in candidates:
        try:
            solution = solve(design, candidate)
        except CalibrationError:
            continue
        drop, worst = max((ratio(solution.shift(_pattern(design, patch))) ** 2, -patch) for patch in patches)
        left = solution.chi_squared - drop + WORTH * (candidate.n_parameters - 1)
        if best is None or left < best[0]:
            best = left, solution, -worst
    return None if best is None else best[1:]


def _choose_of_two(
    design: Design,
    candidates: Sequence[CandidateModel],
    joined: dict[str, PatchReading],
    readings: Mapping[str, Sequence[Reading]],
) -> tuple[Design, dict[str, PatchReading], list[LeftOut], list[Finding]]:
    """Of two contradicting readings of a patch, keep the one that agrees with the camera."""
    left_out: list[LeftOut] = []
    findings: list[Finding] = []
    for patch, name in enumerate(design.patches):
        distinct = [k for k, r in enumerate(readings[name], start=1) if r not in readings[name][: k - 1]]
        pair = [readings[name][k - 1] for k in distinct]
        if len(pair) != 2 or not contradict(pair) or len(design.patches) < _MIN_PATCHES:
            continue
        best = _best_without_one(design, candidates, [patch])
        if best is None:
            continue
        value, uncertainty = best[0].shift(_pattern(design, patch))
        if uncertainty == inf:
            continue
        expected = float(design.reading_cd_m2[patch] + value)
        # The shift's variance less that of this patch's reading is the camera's.
        by_camera = sqrt(max(uncertainty**2 - float(design.reading_variance[patch]), 0.0))
        off = [
            abs(r.luminance_cd_m2 - expected) / hypot(by_camera, r.standard_uncertainty_random_cd_m2, 1e-9 * expected)
            for r in pair
        ]
        right = int(np.argmin(off))
        if off[right] < _AGREES and off[1 - right] > critical_value(2 * len(design.patches)):
            before = len(joined[name].left_out)
            joined[name], found = single_reading(joined[name], readings[name], distinct[right])
            findings += found
            left_out += joined[name].left_out[before:]
            design = design.with_reading(patch, joined[name])
    return design, joined, left_out, findings


def _pattern(design: Design, patch: int) -> Array:
    """Effect of a patch's reading that is too low by 1 cd/m^2 on luminances less readings."""
    return np.where(design.patch == patch, 1.0, 0.0)
