"""Selection of a response model by leave-one-out errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from ...core.clock import exposure_text
from ...core.errors import CalibrationError
from ...core.result import Finding, info
from ..findings import ModelStep
from ..uncertainty import SMALL_P_VALUE, p_value_of_chi_squared
from .candidates import CandidateModel
from .design import Array, Design
from .problem import Solution, solutions, solve

#: Relative decrease of the leave-one-out error required of a further parameter.
MIN_IMPROVEMENT = 0.1
#: Decrease of chi^2 required of a further parameter.
WORTH = 6.6
#: p-value of chi^2 below which patches contradict the response of a bracket: a refusal asks for more than a warning.
_CONTRADICTION = 1e-4
#: Patches in excess of the parameters required for a test of positions.
_SPARE_PATCHES = 2
#: Readings within this many hours cannot show a drift.
_MIN_HOURS = 1 / 60


@dataclass(frozen=True, eq=False)
class LeaveOneOut:
    """Deviations of each patch from a fit without it.

    Parameters
    ----------
    relative : ndarray of float, shape (P,)
        Luminance over reading, minus 1, combined over the patch's observations.
    score : ndarray of float, shape (P,)
        Sum of squares of the deviations of its observations, standardised with the stated errors.
    """

    relative: Array
    score: Array


def leave_one_out(solution: Solution, covariance: Array | None = None) -> LeaveOneOut:
    """Leave out each patch in turn.

    With P of the solution, the residuals of observations I of a patch from a fit without them are P_II^-1 (P r)_I,
    for fixed weights exactly (for example R. Christensen et al., Technometrics 34 (1992) 38).

    Parameters
    ----------
    solution : Solution
        The fit of all patches.
    covariance : ndarray of float, shape (n, n), or None
        Stated errors of the residuals, for the score; None for the solution's own.
    """
    stated = solution.covariance if covariance is None else covariance
    design, moved = solution.design, solution.left @ solution.residual
    relative, score = [], []
    for (own, weight), reading_cd_m2 in zip(weights_by_patch(solution), design.reading_cd_m2, strict=True):
        block = np.ix_(own, own)
        deviation = np.linalg.lstsq(solution.left[block], moved[own], rcond=1e-10)[0]
        relative.append(float(weight @ deviation) / reading_cd_m2)
        score.append(float(deviation @ np.linalg.solve(stated[block], deviation)))
    return LeaveOneOut(np.array(relative), np.array(score))


def weights_by_patch(solution: Solution) -> list[tuple[NDArray[np.intp], Array]]:
    """Observations of each patch, and weights of sum 1: inverse variances by noise, dark signal and common errors."""
    design, signals = solution.design, solution.design.signals
    variance = solution.slope**2 * (signals.noise_variance_dn2 + signals.dark_nonuniformity_dn**2)
    variance = variance + (design.patterns(solution.luminance, solution.slope) ** 2).sum(axis=0)
    inverse = 1 / np.maximum(variance, 1e-12 * solution.luminance**2)
    members = [np.flatnonzero(design.patch == patch) for patch in range(len(design.patches))]
    return [(own, inverse[own] / inverse[own].sum()) for own in members]


def seen_cd_m2(solution: Solution) -> Array:
    """Return the luminances of the patches by the camera, shape (P,)."""
    return np.array([weight @ solution.luminance[own] for own, weight in weights_by_patch(solution)])


def select_model(design: Design, candidates: Sequence[CandidateModel]) -> tuple[Solution, tuple[ModelStep, ...]]:
    """Fit all models and select one.

    A model is preferred to a simpler one as `_obstacle` says. The response of a bracket comes first; it contradicts the
    patches if another model is better by these rules and its own chi^2 is improbable.

    Parameters
    ----------
    design : Design
        The observations.
    candidates : sequence of CandidateModel
        From `candidate_models`.

    Returns
    -------
    Solution, tuple of ModelStep
        Of the chosen model; one for each model that fits with an increasing response.

    Raises
    ------
    CalibrationError
        If the first model cannot be fitted, or is that of a bracket and contradicts the patches.
    """
    chosen = solve(design, candidates[0])
    stated = chosen.covariance
    best = leave_one_out(chosen)
    bracket = candidates[0].bracket
    first = info("model-simplest")
    if bracket is not None:
        first = info("model-bracket", n_exposures=len(bracket.exposures_s), residual_rel=bracket.residual_rel)
    tried = [(candidates[0], best, first)]
    for solution in solutions(design, candidates[1:]):
        left_out = leave_one_out(solution, stated)
        before, after = float(best.score.sum()), float(left_out.score.sum())
        obstacle = _obstacle(chosen, best, solution, left_out)
        of_bracket = chosen.candidate.bracket is not None
        p_value = p_value_of_chi_squared(chosen.chi_squared, chosen.degrees_of_freedom)
        if obstacle is None and of_bracket and p_value >= _CONTRADICTION:
            obstacle = info("model-bracket-agrees")
        reason = obstacle or info("model-better")
        figures = {"chi_squared": after, "chi_squared_before": before, "other": chosen.candidate.kind}
        tried.append((solution.candidate, left_out, replace(reason, values={**reason.values, **figures})))
        if obstacle is None and of_bracket:
            raise CalibrationError(
                f"the response of the bracket contradicts the patches, a {solution.candidate.kind} one fits them "
                f"clearly better (leave-one-out χ² {after:.3g} against {before:.3g}): check that the scene and its "
                "light stood still over the bracket and that camera and exposures are right, or calibrate without it"
            )
        if obstacle is None:
            chosen, best = solution, left_out
    weight = 1 / (design.reading_variance / design.reading_cd_m2**2 + design.patch_rel**2 + 1e-6)
    errors = [sqrt(float(np.average(one.relative**2, weights=weight))) for _, one, _ in tried]
    return chosen, tuple(
        ModelStep(candidate.kind, candidate.n_parameters, error, candidate == chosen.candidate, reason)
        for (candidate, _, reason), error in zip(tried, errors, strict=True)
    )


def _obstacle(simple: Solution, before: LeaveOneOut, better: Solution, after: LeaveOneOut) -> Finding | None:
    """Why the better-fitting model is not selected; None if it is.

    It has to lower the sum of standardised squares of the leave-one-out deviations by more than `MIN_IMPROVEMENT` and
    one standard error of the difference over the patches, and significantly more than `strongest_alternative`.
    """
    gained = before.score - after.score
    error = sqrt(float(np.var(gained, ddof=1)) * gained.size)
    if gained.sum() <= MIN_IMPROVEMENT * before.score.sum() or gained.sum() <= error:
        return info("model-not-better")
    dof = max(better.candidate.n_parameters - simple.candidate.n_parameters, 1)
    unexplained = max(1.0, better.chi_squared / max(better.degrees_of_freedom, 1))
    drop = simple.chi_squared - better.chi_squared
    if p_value_of_chi_squared(max(drop, 0.0) / unexplained, dof) >= SMALL_P_VALUE:
        return info("model-not-significant")
    alternative = strongest_alternative(simple)
    if alternative is not None and alternative[1] ** 2 >= drop:
        return info("model-alternative", alternative=alternative[0])
    return None


def strongest_alternative(solution: Solution) -> tuple[str, float] | None:
    """Find the best alternative explanation of the residuals, and its standardised value.

    Considered are a veil of glare, a wrong dark, each exposure time, a drift, and smooth changes over the image, and a
    step of the meter. Each parameter beyond the first costs `WORTH`.
    """
    candidates = [("a veil of glare", np.ones_like(solution.luminance)), ("a wrong dark", solution.slope)]
    candidates += [(f"a wrong exposure time at {exposure_text(t)}", one) for t, one in exposure_patterns(solution)]
    candidates.append(("a drift", drift_pattern(solution)))
    found = [(name, solution.shift(pattern).z) for name, pattern in candidates]
    found += [("the place in the image", worth_of_place(solution)), ("a step of the meter", worth_of_step(solution))]
    strongest = max(found, key=lambda row: row[1])
    return strongest if strongest[1] > 0 else None


def exposure_patterns(solution: Solution) -> list[tuple[float, Array]]:
    """Exposure times, and deviations by each of them that is too long; none for a single one."""
    design = solution.design
    times = [*enumerate(design.exposures_s.tolist())] if design.exposures_s.size > 1 else []
    return [(exposure_s, np.where(design.exposure == n, solution.luminance, 0.0)) for n, exposure_s in times]


def drift_pattern(solution: Solution) -> Array:
    """Deviations by a light that changes by 1 per hour; 0 if the readings are (nearly) simultaneous."""
    design = solution.design
    hours = design.read_h - design.read_h.mean()
    if np.ptp(hours) < _MIN_HOURS:
        return np.zeros_like(solution.luminance)
    pattern: Array = hours[design.patch] * solution.luminance
    return pattern


def strongest_step(solution: Solution) -> tuple[Array, int, int]:
    """Find where the readings change at once the most, as those of a readjusted meter do.

    Returns deviations by readings that are 1 lower from one patch on, its number, and that of the possible steps, which
    have two patches on each side; without such a step they are 0.
    """
    design = solution.design
    order = np.argsort(design.read_h, kind="stable").tolist()
    steps = [(np.zeros_like(solution.luminance), 0, 0)]
    for first in order[2:-1]:
        after = design.read_h >= design.read_h[first]
        steps.append(((after - 0.5)[design.patch] * solution.luminance, first, len(order) - 3))
    return max(steps[1:] or steps, key=lambda step: solution.shift(step[0]).z)


def worth_of_step(solution: Solution) -> float:
    """Standardised value of the strongest step, comparable with that of a single parameter: its time is another one."""
    return sqrt(max(solution.shift(strongest_step(solution)[0]).z ** 2 - WORTH, 0.0))


def by_place(solution: Solution) -> tuple[float, int, Array]:
    """Explain residuals by r^2, x and y; only by r^2 for few patches.

    Returns the decrease of chi^2, the number of patterns used, and the relative deviation of each patch, shape (P,).
    """
    design = solution.design
    spare = len(design.patches) - solution.candidate.n_parameters - _SPARE_PATCHES
    place = design.place[:, : 3 if spare >= 3 else 1 if spare >= 1 else 0]
    patterns = place[design.patch] * solution.luminance[:, None]
    seen, whole = patterns.T @ solution.left @ patterns, patterns.T @ solution.weight @ patterns
    scale = np.sqrt(np.maximum(np.diag(whole), 1e-300))
    values, vectors = np.linalg.eigh(seen / np.outer(scale, scale))
    # Patterns collinear at these patches, or with the response, are dropped.
    vectors = vectors[:, values > 1e-6] / scale[:, None]
    pull = vectors.T @ (patterns.T @ solution.left @ solution.residual)
    explained = pull / values[values > 1e-6]
    deviation: Array = place @ (vectors @ explained)
    return float(pull @ explained), pull.size, deviation


def worth_of_place(solution: Solution) -> float:
    """Standardised value of the places' deviations, comparable with that of a single parameter."""
    drop, n, _ = by_place(solution)
    return sqrt(max(drop - WORTH * (n - 1), 0.0))
