"""Selection of the response and of the effects beside it: one nested model."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import log, sqrt

import numpy as np
from numpy.typing import NDArray

from ...core.errors import CalibrationError
from ...core.result import Finding, info
from ..fit_records import ModelStep
from ..uncertainty import SMALL_P_VALUE, p_value_of_chi_squared
from .candidates import CandidateModel
from .design import Array, Design
from .effects import WORTH, Effect, FittedEffect, Kind, amplitude, assess, largest_of_each_kind, possible_effects
from .problem import Solution, solutions, solve

#: Relative decrease of the leave-one-out error required of a further parameter.
MIN_IMPROVEMENT = 0.1
#: p-value of chi^2 below which patches contradict the response of a bracket: a refusal asks for more than a warning.
_CONTRADICTION = 1e-4
#: Ratio of the probabilities by chance, e^2, within which two effects explain the observations about equally well: the
#: better one is then no more than about seven times as likely.
_ALIKE = 2.0
#: Probability by chance below which an effect may be the cause of what another one, beside it no longer significant,
#: explains.
_RIVAL = 0.05
#: Share of the deviation of a patch from which another effect is about as large there.
_AS_MUCH = 0.5
#: Difference of their logarithms within which effects are the same at these patches; the first one is then named.
_SAME = 0.01
#: Least factor by which an exposure may be shorter than stated.
SHORTEST = 0.01
#: Most rounds for exposure times, and the step in standard uncertainties at which they end.
_TIME_ROUNDS, _EXACT = 20, 0.01


def leave_one_out(solution: Solution, covariance: Array | None = None) -> tuple[Array, Array]:
    """Return the deviations of each patch from a fit without it.

    With P of the solution, the residuals of observations I of a patch from a fit without them are P_II^-1 (P r)_I,
    for fixed weights exactly (for example R. Christensen et al., Technometrics 34 (1992) 38).

    Parameters
    ----------
    solution : Solution
        The fit of all patches.
    covariance : ndarray of float, shape (n, n), or None
        Stated errors of the residuals, for the score; None for the solution's own.

    Returns
    -------
    relative : ndarray of float, shape (P,)
        Luminance over reading, minus 1, combined over the patch's observations.
    score : ndarray of float, shape (P,)
        Sum of squares of the deviations of its observations, standardised with the stated errors.
    """
    stated = solution.covariance if covariance is None else covariance
    design, moved = solution.design, solution.left @ solution.residual
    relative, score = [], []
    for (members, weight), reading_cd_m2 in zip(weights_by_patch(solution), design.reading_cd_m2, strict=True):
        block = np.ix_(members, members)
        deviation = np.linalg.lstsq(solution.left[block], moved[members], rcond=1e-10)[0]
        relative.append(float(weight @ deviation) / reading_cd_m2)
        score.append(float(deviation @ np.linalg.solve(stated[block], deviation)))
    return np.array(relative), np.array(score)


def weights_by_patch(solution: Solution) -> list[tuple[NDArray[np.intp], Array]]:
    """Observations of each patch, and weights of sum 1: inverse variances by noise, dark signal and common errors."""
    design, signals = solution.design, solution.design.signals
    variance = solution.slope**2 * (signals.noise_variance_dn2 + signals.dark_nonuniformity_dn**2)
    variance = variance + (design.patterns(solution.luminance, solution.slope) ** 2).sum(axis=0)
    inverse = 1 / np.maximum(variance, 1e-12 * solution.luminance**2)
    members = [np.flatnonzero(design.patch == patch) for patch in range(len(design.patches))]
    return [(of_patch, inverse[of_patch] / inverse[of_patch].sum()) for of_patch in members]


def seen_cd_m2(solution: Solution) -> Array:
    """Return the luminances of the patches by the camera, shape (P,)."""
    return np.array([weight @ solution.luminance[members] for members, weight in weights_by_patch(solution)])


@dataclass(frozen=True, eq=False)
class ModelSelection:
    """The model that the observations require.

    Parameters
    ----------
    solution : Solution
        The fit, with the effects.
    ladder : tuple of ModelStep
        Candidates of the response.
    effects : tuple of FittedEffect
        Effects beside it.
    """

    solution: Solution
    ladder: tuple[ModelStep, ...]
    effects: tuple[FittedEffect, ...] = ()

    def size_of(self, kind: Kind) -> float:
        """Return the amplitude of the effect of a kind; 0 if there is none."""
        return next((fitted.value for fitted in self.effects if fitted.effect.kind == kind), 0.0)


def select(design: Design, candidates: Sequence[CandidateModel]) -> ModelSelection:
    """Select the response, and the effects beside it that are significant, one after the other.

    Each step takes what explains the observations best, a better response or one more effect, and fits all anew, at
    corrected exposure times before the next effect is looked for. At last, effects that the others have made
    insignificant are dropped.

    Raises
    ------
    CalibrationError
        As `select_model`.
    """
    effects, fitted_effects = (
        possible_effects(design, with_exposures=candidates[0].bracket is None),
        list[FittedEffect](),
    )
    now = ModelSelection(*select_model(design, candidates, effects))
    while further := _next(design, now.solution, effects, fitted_effects):
        fitted_effects = [*fitted_effects, *further]
        for _ in candidates:
            candidate = now.solution.candidate
            fitted_effects = _with_exact_times(design, candidate, fitted_effects)
            now = ModelSelection(*_with(design, candidates, effects, fitted_effects))
            if now.solution.candidate == candidate:
                break
    settled = _without_others(design, now.solution.candidate, fitted_effects)
    if len(settled) < len(fitted_effects):
        now = ModelSelection(*_with(design, candidates, effects, settled))
    candidate = now.solution.candidate
    return replace(now, effects=tuple(_with_rivals(design, candidate, effects, settled, fitted) for fitted in settled))


def time_factor(design: Design, fitted_effects: Iterable[FittedEffect]) -> Array:
    """Return exposure times by the effects on them, over the stated ones, shape (n,)."""
    errors = [
        (fitted.value, fitted.effect.errors[0].relative) for fitted in fitted_effects if fitted.effect.changes_times
    ]
    factor: Array = np.ones_like(design.net_dn) + sum(value * relative for value, relative in errors)
    return np.maximum(factor, SHORTEST)


def with_times_of(design: Design, fitted_effects: Iterable[FittedEffect]) -> Design:
    """Return the design with exposure times as the effects make them."""
    factor = time_factor(design, fitted_effects)
    return replace(design, signals=replace(design.signals, scale_per_s=design.signals.scale_per_s / factor))


def with_effects(design: Design, fitted_effects: Sequence[FittedEffect]) -> Design:
    """Return the design with effects as parameters, those of exposure times around their amplitudes."""
    factor = time_factor(design, fitted_effects)
    shared = (
        *design.shared,
        *(e for fitted in fitted_effects for e in fitted.effect.around(factor).within(fitted.widths)),
    )
    return replace(with_times_of(design, fitted_effects), shared=shared)


def _with_exact_times(
    design: Design, candidate: CandidateModel, fitted_effects: Sequence[FittedEffect]
) -> list[FittedEffect]:
    """Return exposure times that leave nothing: they are factors of luminances, and their columns only tangents."""
    now = list(fitted_effects)
    numbers = [k for k, fitted in enumerate(now) if fitted.effect.changes_times]
    for _ in range(_TIME_ROUNDS):
        steps = [_step_of_time(design, candidate, now, k) for k in numbers]
        if all(step < _EXACT for step in steps):
            break
    return now


def _step_of_time(design: Design, candidate: CandidateModel, now: list[FittedEffect], number: int) -> float:
    """Correct the effect on an exposure time by what it leaves; return that, in standard uncertainties."""
    before, rest = now[number], [fitted for k, fitted in enumerate(now) if k != number]
    effect = before.effect.around(time_factor(design, now))
    corrected = replace(with_effects(design, rest), signals=with_times_of(design, now).signals)
    try:
        left = assess(solve(corrected, candidate), effect)
    except CalibrationError:
        return 0.0
    if not left.amplitude.n:
        return 0.0
    # The column is relative to the root of luminance times reading, see `Design.level`.
    largest = float(np.max(np.abs(effect.errors[0].relative)))
    moved = before.amplitude.value + np.expm1(2 * np.arcsinh(left.value * largest / 2)) / largest
    amplitude = before.amplitude._replace(value=moved, uncertainty=left.amplitude.uncertainty)
    now[number] = before._replace(amplitude=amplitude)
    return abs(left.value / left.uncertainty)


def _with(
    design: Design,
    candidates: Sequence[CandidateModel],
    effects: Sequence[Effect],
    fitted_effects: Sequence[FittedEffect],
) -> tuple[Solution, tuple[ModelStep, ...]]:
    return select_model(with_effects(design, fitted_effects), candidates, _others(effects, fitted_effects))


def _others(effects: Sequence[Effect], fitted_effects: Sequence[FittedEffect]) -> list[Effect]:
    """Effects that are not fitted, where more of the kind may be."""
    keys = {fitted.effect.key for fitted in fitted_effects}
    kinds = [fitted.effect.kind for fitted in fitted_effects]
    return [effect for effect in effects if effect.key not in keys and kinds.count(effect.kind) < effect.most]


def _next(
    design: Design, solution: Solution, effects: Sequence[Effect], fitted_effects: Sequence[FittedEffect]
) -> Sequence[FittedEffect]:
    """Return the most significant effect that is not fitted yet, or patches that hide each other."""
    if solution.degrees_of_freedom <= 1:
        return ()
    rows = _significant(solution, _others(effects, fitted_effects))
    if not rows:
        return _several_patches(design, solution.candidate, effects, fitted_effects)
    best = min(row.log_p for row in rows)
    return (next(row for row in rows if row.log_p <= best + _SAME),)


def _several_patches(
    design: Design, candidate: CandidateModel, effects: Sequence[Effect], fitted_effects: Sequence[FittedEffect]
) -> Sequence[FittedEffect]:
    """Return patches of which each makes the others look like scatter: the one that deviates most is left out in turn.

    As many count as the last one that is significant has before it: B. Rosner, Technometrics 25 (1983) 165.
    """
    more, result = list[FittedEffect](), list[FittedEffect]()
    while patches := [effect for effect in _others(effects, [*fitted_effects, *more]) if effect.kind == "patch"]:
        solution = next(solutions(with_effects(design, [*fitted_effects, *more]), [candidate]), None)
        if solution is None or solution.degrees_of_freedom <= 1:
            break
        row = assess(solution, largest_of_each_kind(solution, patches)[0])
        more.append(row)
        if row.significant and row.matters(solution):
            result = list(more)
    return result


def _significant(solution: Solution, effects: Iterable[Effect]) -> list[FittedEffect]:
    return [row for row in _assessed(solution, effects) if row.significant and row.matters(solution)]


def _assessed(solution: Solution, effects: Iterable[Effect]) -> list[FittedEffect]:
    return [assess(solution, effect) for effect in largest_of_each_kind(solution, effects)]


def _without_others(
    design: Design, candidate: CandidateModel, fitted_effects: Sequence[FittedEffect]
) -> list[FittedEffect]:
    """Assess each effect beside the other fitted ones, and drop what is not significant."""
    kept = list(fitted_effects)
    for fitted in fitted_effects:
        rest = [other for other in kept if other is not fitted]
        # A response may need an effect to rise at all.
        solution = next(solutions(with_effects(design, rest), [candidate]), None)
        again = fitted if solution is None else assess(solution, fitted.effect)
        if not again.significant:
            kept = rest
        elif not fitted.effect.changes_times:
            kept = [again if other is fitted else other for other in kept]
    return _with_exact_times(design, candidate, kept)


def _with_rivals(
    design: Design,
    candidate: CandidateModel,
    effects: Sequence[Effect],
    fitted_effects: Sequence[FittedEffect],
    fitted: FittedEffect,
) -> FittedEffect:
    """Return an effect with others that explain the observations about as well in its place."""
    rest = [other for other in fitted_effects if other is not fitted]
    solution = next(solutions(with_effects(design, rest), [candidate]), None)
    if solution is None:
        return fitted
    if fitted.effect.changes_times:
        others = [other for other in _others(effects, rest) if other.key != fitted.effect.key]
        alike = _as_good(design, candidate, fitted_effects, fitted, _significant(solution, others))
    else:
        others = [other for other in _others(effects, fitted_effects) if other.kind != fitted.effect.kind]
        rows = [row for row in _assessed(solution, others) if row.log_p < log(_RIVAL) and row.possible]
        alike = [row for row in rows if _is_rival(row, fitted, with_effects(design, rest), solution)]
    if fitted.effect.kind == "patch":
        alike += [row for row in rest if _is_more_at(row, fitted, solution)]
    return fitted._replace(rivals=tuple(sorted(alike, key=lambda row: row.log_p)))


def _as_good(
    design: Design,
    candidate: CandidateModel,
    fitted_effects: Sequence[FittedEffect],
    fitted: FittedEffect,
    others: Iterable[FittedEffect],
) -> list[FittedEffect]:
    """Return what may stand for an effect of exposure times, by fits at exact ones: a linear test only says where."""
    best, rest, result = (
        solve(with_effects(design, fitted_effects), candidate),
        [f for f in fitted_effects if f is not fitted],
        [],
    )
    most = best.chi_squared + 2 * _ALIKE * max(1.0, best.chi_squared / max(best.degrees_of_freedom, 1))
    for other in others:
        instead = with_effects(design, _with_exact_times(design, candidate, [*rest, other]))
        result += [other for solution in solutions(instead, [candidate]) if solution.chi_squared <= most]
    return result


def _is_rival(row: FittedEffect, fitted: FittedEffect, design: Design, solution: Solution) -> bool:
    """Whether an effect explains the observations about as well as a fitted one, or what that one explains."""
    if not row.matters(solution):
        return False
    if row.significant and row.log_p <= fitted.log_p + _ALIKE:
        return True
    with suppress(CalibrationError):
        return not assess(solve(with_effects(design, [row]), solution.candidate), fitted.effect).significant
    return False


def _is_more_at(row: FittedEffect, patch: FittedEffect, solution: Solution) -> bool:
    """Whether a patch that deviates may be more of another effect: that is largest there, or about as large."""
    moved = np.abs(row.amplitude.value @ row.effect.columns(solution)) / solution.level
    members, design = solution.design.patch == patch.effect.number, solution.design
    deviation_rel = abs(patch.value) / design.reading_cd_m2[patch.effect.number]
    much = moved[members].max() >= min(moved.max(), _AS_MUCH * deviation_rel)
    return row.effect.kind in ("rim", "glare", "place", "dark signal") and bool(much)


def worth(solution: Solution, effect: Effect) -> float:
    """Decrease of chi^2 by an effect, comparable with that of a single parameter.

    One of several alike has been searched for, and a patch explains any deviation of its own.
    """
    seen = amplitude(solution, effect.columns(solution))
    extra = seen.n - 1 + (effect.kind == "patch")
    return seen.drop - WORTH * extra - 2 * log(effect.alike)


def select_model(
    design: Design, candidates: Sequence[CandidateModel], effects: Sequence[Effect]
) -> tuple[Solution, tuple[ModelStep, ...]]:
    """Fit all models and select one.

    A model is preferred to a simpler one as `_obstacle` says. The response of a bracket comes first; it contradicts the
    patches if another model is better by these rules and its own chi^2 is improbable.

    Parameters
    ----------
    design : Design
        The observations.
    candidates : sequence of CandidateModel
        From `candidate_models`.
    effects : sequence of Effect
        What may explain the deviations as well.

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
    relative, best = leave_one_out(chosen)
    bracket = candidates[0].bracket
    first = info("model-simplest")
    if bracket is not None:
        first = info("model-bracket", n_exposures=len(bracket.exposures_s), residual_rel=bracket.residual_rel)
    tried = [(candidates[0], relative, first)]
    for solution in solutions(design, candidates[1:]):
        relative, score = leave_one_out(solution, stated)
        before, after = float(best.sum()), float(score.sum())
        obstacle = _obstacle(chosen, best, solution, score, effects)
        of_bracket = chosen.candidate.bracket is not None
        p_value = p_value_of_chi_squared(chosen.chi_squared, chosen.degrees_of_freedom)
        if obstacle is None and of_bracket and p_value >= _CONTRADICTION:
            obstacle = info("model-bracket-agrees")
        reason = obstacle or info("model-better")
        figures = {"chi_squared": after, "chi_squared_before": before, "other": chosen.candidate.kind}
        tried.append((solution.candidate, relative, replace(reason, values={**reason.values, **figures})))
        if obstacle is None and of_bracket:
            raise CalibrationError(
                f"the response of the bracket contradicts the patches, a {solution.candidate.kind} one fits them "
                f"clearly better (leave-one-out χ² {after:.3g} against {before:.3g}): check that the scene and its "
                "light stood still over the bracket and that camera and exposures are right, or calibrate without it"
            )
        if obstacle is None:
            chosen, best = solution, score
    weight = 1 / (design.reading_variance / design.reading_cd_m2**2 + design.own_rel**2 + 1e-6)
    errors = [sqrt(float(np.average(relative**2, weights=weight))) for _, relative, _ in tried]
    return chosen, tuple(
        ModelStep(candidate.kind, candidate.n_parameters, error, candidate == chosen.candidate, reason)
        for (candidate, _, reason), error in zip(tried, errors, strict=True)
    )


def _obstacle(
    simple: Solution, before: Array, better: Solution, after: Array, effects: Sequence[Effect]
) -> Finding | None:
    """Why the better-fitting model is not selected; None if it is.

    It has to lower the sum of standardised squares of the leave-one-out deviations, of each patch `before` and `after`,
    by more than `MIN_IMPROVEMENT` and one standard error of the difference over the patches, and significantly more
    than any of the effects.
    """
    gained = before - after
    error = sqrt(float(np.var(gained, ddof=1)) * gained.size)
    if gained.sum() <= MIN_IMPROVEMENT * before.sum() or gained.sum() <= error:
        return info("model-not-better")
    dof = max(better.candidate.n_parameters - simple.candidate.n_parameters, 1)
    unexplained = max(1.0, better.chi_squared / max(better.degrees_of_freedom, 1))
    drop = simple.chi_squared - better.chi_squared
    if p_value_of_chi_squared(max(drop, 0.0) / unexplained, dof) * better.candidate.alike >= SMALL_P_VALUE:
        return info("model-not-significant")
    alternative = max(effects, key=lambda effect: worth(simple, effect), default=None)
    if alternative is not None and worth(simple, alternative) >= drop:
        return info("model-alternative", alternative=alternative.name)
    return None
