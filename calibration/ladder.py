"""The ladder of models: which response the data ask for, by leave-one-out errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from ..errors import CalibrationError
from .alternatives import strongest_alternative
from .chance import SMALL_CHANCE, chance_of_chi_squared
from .design import Array, Design
from .findings import ModelStep
from .gls import Solution, solve
from .response_curve import ResponseCurve
from .rungs import Rung

#: Part by which a further parameter must lower the leave-one-out error.
MIN_IMPROVEMENT = 0.1


@dataclass(frozen=True, eq=False)
class LeaveOneOut:
    """Deviations of each patch from a fit without it.

    Parameters
    ----------
    relative : ndarray of float, shape (P,)
        Luminance over reading, less one, combined over the patch's observations.
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
    for patch in range(len(design.patches)):
        own = np.flatnonzero(design.patch == patch)
        block = np.ix_(own, own)
        deviation = np.linalg.lstsq(solution.left[block], moved[own], rcond=1e-10)[0]
        weight = patch_weights(solution, patch)
        relative.append(float(weight @ deviation) / design.reading_cd_m2[patch])
        score.append(float(deviation @ np.linalg.solve(stated[block], deviation)))
    return LeaveOneOut(np.array(relative), np.array(score))


def patch_weights(solution: Solution, patch: int) -> Array:
    """Weights of a patch's observations in its luminance: inverse variances by noise and darkness; their sum is 1."""
    design = solution.design
    own = design.patch == patch
    variance = design.noise_variance_dn2 + design.dark_nonuniformity_dn**2
    variance = variance + sum(error.dark_dn**2 for error in design.dark_errors)
    weight: Array = 1 / (solution.slope[own] ** 2 * variance[own])
    weight /= weight.sum()
    return weight


def climb(design: Design, ladder: Sequence[Rung]) -> tuple[Solution, tuple[ModelStep, ...]]:
    """Fit all models and choose one.

    A model is taken instead of a simpler one if it lowers the sum of standardised squares of the leave-one-out
    deviations by more than `MIN_IMPROVEMENT`, by more than one standard error of the difference over the patches, and
    if it explains the data better than chance and than what `strongest_alternative` knows would.
    The response of a bracket comes first; if another is better by these rules, and chi^2 improbable for the
    bracket's, it contradicts the patches.

    Parameters
    ----------
    design : Design
        The observations.
    ladder : sequence of Rung
        From `rungs`.

    Returns
    -------
    Solution
        Of the chosen model.
    tuple of ModelStep
        One for each model that a rising response fits.

    Raises
    ------
    CalibrationError
        If the first model cannot be fitted, or is that of a bracket and contradicts the patches.
    """
    chosen = solve(design, ladder[0])
    stated = chosen.covariance
    best = leave_one_out(chosen)
    bracket = ladder[0].bracket
    tried = [(ladder[0], best, "the simplest model" if bracket is None else _given(bracket))]
    for rung in ladder[1:]:
        try:
            solution = solve(design, rung)
        except CalibrationError:
            continue  # no rising response of this kind fits
        left_out = leave_one_out(solution, stated)
        before, after = float(best.score.sum()), float(left_out.score.sum())
        figures = f"leave-one-out chi^2 {after:.3g} against {before:.3g} of the {chosen.rung.kind} one"
        obstacle = _obstacle(chosen, best, solution, left_out)
        if obstacle is None and chosen.rung.bracket is not None and _explained(chosen):
            obstacle = "better, but the patches agree with the bracket within its error"
        tried.append((rung, left_out, figures + (f": {obstacle}" if obstacle else ": clearly better")))
        if obstacle is None and chosen.rung.bracket is not None:
            raise CalibrationError(
                f"the response of the bracket contradicts the patches, a {rung.kind} one fits them clearly better "
                f"({figures}): check that the scene and its light stood still over the bracket and that camera and "
                "exposures are right, or calibrate without it"
            )
        if obstacle is None:
            chosen, best = solution, left_out
    weight = 1 / (design.reading_variance / design.reading_cd_m2**2 + design.patch_rel**2 + 1e-6)
    return chosen, tuple(
        ModelStep(
            kind=rung.kind,
            n_parameters=rung.n_parameters,
            leave_one_out_rel=sqrt(float(np.average(loo.relative**2, weights=weight))),
            chosen=rung == chosen.rung,
            reason=reason,
        )
        for rung, loo, reason in tried
    )


def _explained(solution: Solution) -> bool:
    return chance_of_chi_squared(solution.chi_squared, solution.degrees_of_freedom) >= SMALL_CHANCE


def _given(bracket: ResponseCurve) -> str:
    return (
        f"the shape by {bracket.method.capitalize()} from a bracket of {len(bracket.exposures_s)} exposures, which "
        f"differ from it by {bracket.residual_rel:.2%}; the patches scale it"
    )


def _obstacle(simple: Solution, before: LeaveOneOut, better: Solution, after: LeaveOneOut) -> str | None:
    """Why the better-fitting model is not taken, None if it is."""
    gained = before.score - after.score
    error = sqrt(float(np.var(gained, ddof=1)) * gained.size)
    if gained.sum() <= MIN_IMPROVEMENT * before.score.sum() or gained.sum() <= error:
        return "not clearly better"
    freedom = max(better.rung.n_parameters - simple.rung.n_parameters, 1)
    unexplained = max(1.0, better.chi_squared / max(better.degrees_of_freedom, 1))
    drop = simple.chi_squared - better.chi_squared
    if chance_of_chi_squared(max(drop, 0.0) / unexplained, freedom) >= SMALL_CHANCE:
        return "may be chance"
    alternative = strongest_alternative(simple)
    if alternative is not None and alternative[1] ** 2 >= drop:
        return f"{alternative[0]} explains the residuals better"
    return None
