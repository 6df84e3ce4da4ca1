"""Variance components: scatter of patches and observations that the stated errors do not explain."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp, inf, log, sqrt
from typing import Literal

import numpy as np

from ..errors.uncertainty import effective_dof
from .candidates import CandidateModel
from .design import Array, Design
from .problem import Solution, solve
from .significance import SMALL_P_VALUE, p_value_of_chi_squared

Kind = Literal["scatter_rel", "scatter_each_rel", "scatter_each_dn"]
#: Least and largest scatter: relative ones of luminances, those in DN of the largest signal.
_LEAST, _MOST = 1e-6, 0.5
#: Scatter that does not count.
_NEGLIGIBLE = 1e-4
#: Decrease of the deviance required of the scatter of patches.
_WORTH = 0.25


@dataclass(frozen=True, eq=False)
class _Estimate:
    """Standard deviations by kind, their degrees of freedom, and the deviance."""

    sizes: dict[Kind, float]
    dof: dict[Kind, float]
    deviance: float


def with_scatter(design: Design, candidate: CandidateModel, *, by_place: bool = False) -> Solution:
    """Fit with the scatter that the residuals require, by restricted maximum likelihood (REML).

    Patches scatter relative to the luminance. If the observations of one patch contradict each other, they scatter
    too, relative to the luminance (exposure times) or in DN (dark signal), whichever is more likely. REML: H. D.
    Patterson and R. Thompson, Biometrika 58 (1971) 545; the degrees of freedom follow from its information (F. E.
    Satterthwaite, Biometrics 2 (1946) 110).

    Where deviations depend on position, uncorrected vignetting also makes the patches non-uniform. This non-uniformity
    does not explain the scatter and is then set to 0.

    Parameters
    ----------
    design : Design
        The observations.
    candidate : CandidateModel
        The model.
    by_place : bool
        Whether the deviations depend on the positions of the patches.

    Returns
    -------
    Solution
        With the scatter in its design; 0 if the stated errors explain all.
    """
    if by_place:
        design = replace(design, uneven_rel=np.zeros(len(design.patches)))
    first = solve(design, candidate)
    choices: list[tuple[Kind, ...]] = [("scatter_rel",)]
    inside = within_patches(first, first.covariance)
    if p_value_of_chi_squared(inside, design.net_dn.size - len(design.patches)) < SMALL_P_VALUE:
        choices = [("scatter_rel", "scatter_each_rel"), ("scatter_rel", "scatter_each_dn")]
    found = min((_estimate(first, kinds) for kinds in choices), key=lambda one: one.deviance)
    alone = _estimate(first, tuple(kind for kind in found.sizes if kind != "scatter_rel"))
    if alone.deviance - found.deviance < _WORTH and not by_place:
        found = alone
    if not found.sizes:
        return first
    changes: dict[str, float] = {f"{kind}_dof": value for kind, value in found.dof.items()}
    changes |= {f"{kind}": size for kind, size in found.sizes.items()}
    return solve(replace(design, **changes), candidate)  # type: ignore[arg-type]


def shift_with_scatter(solution: Solution, pattern: Array) -> tuple[float, float, float]:
    """Value, standard uncertainty and degrees of freedom of a further parameter; see `Solution.shift`.

    The uncertainty includes the scatter of the patches that it leaves; without, it has infinite degrees of freedom.
    """
    value, uncertainty = solution.shift(pattern)
    dof = solution.degrees_of_freedom - 1
    if dof < 1 or uncertainty == inf:
        return value, uncertainty, inf
    more = replace(solution, jacobian=np.column_stack([solution.jacobian, pattern]))
    size = _estimate(more, ("scatter_rel",)).sizes["scatter_rel"]
    if size < _NEGLIGIBLE:
        return value, uncertainty, inf
    left = _restricted_deviance(solution, solution.covariance + size**2 * _pattern(solution, "scatter_rel"))[1]
    seen = float(pattern @ left @ pattern)
    if seen <= 0:
        return value, uncertainty, inf
    of_patches = len(solution.design.patches) - solution.parameters.size - 1
    return float(pattern @ left @ solution.residual) / seen, seen**-0.5, max(of_patches, 1)


def _estimate(solution: Solution, kinds: tuple[Kind, ...]) -> _Estimate:
    """Maximise the restricted likelihood at the solution's luminances."""
    from scipy.optimize import minimize

    patterns = [_pattern(solution, kind) for kind in kinds]
    units = [float(solution.design.net_dn.max()) if kind == "scatter_each_dn" else 1.0 for kind in kinds]

    def covariance(logarithms: Array) -> Array:
        total: Array = solution.covariance + sum(
            (unit * exp(v)) ** 2 * pattern for v, unit, pattern in zip(logarithms, units, patterns, strict=True)
        )
        return total

    def deviance(logarithms: Array) -> float:
        return _restricted_deviance(solution, covariance(logarithms))[0]

    if not kinds:
        return _Estimate({}, {}, deviance(np.zeros(0)))
    limits = [(log(_LEAST), log(_MOST))] * len(kinds)
    best = minimize(deviance, [log(1e-3)] * len(kinds), method="L-BFGS-B", bounds=limits)
    sizes = {kind: unit * exp(v) for kind, unit, v in zip(kinds, units, best.x, strict=True)}
    left = _restricted_deviance(solution, covariance(best.x))[1]
    moved = [size**2 * left @ pattern for size, pattern in zip(sizes.values(), patterns, strict=True)]
    dof = {kind: max(float(np.sum(one * one.T)), 1.0) for kind, one in zip(kinds, moved, strict=True)}
    return _Estimate(sizes, dof, float(best.fun))


def _pattern(solution: Solution, kind: Kind) -> Array:
    """Covariance of the residuals for a scatter of 1."""
    if kind == "scatter_rel":
        level = np.sqrt(np.abs(solution.luminance * solution.design.readings))
        return np.where(solution.design.same_patch, np.outer(level, level), 0.0)
    return np.diag((solution.luminance if kind == "scatter_each_rel" else solution.slope) ** 2)


def _restricted_deviance(solution: Solution, covariance: Array) -> tuple[float, Array]:
    """Return minus twice the restricted log-likelihood, and P = K - K X (X^T K X)^-1 X^T K."""
    weight, jacobian = np.linalg.inv(covariance), solution.jacobian
    columns = weight @ jacobian
    information = jacobian.T @ columns
    left = weight - columns @ np.linalg.solve(information, columns.T)
    of_covariance, of_parameters = (float(np.linalg.slogdet(one)[1]) for one in (covariance, information))
    return of_covariance + of_parameters + float(solution.residual @ left @ solution.residual), left


def within_patches(solution: Solution, covariance: Array) -> float:
    """chi^2 of the observations within the patches, independent of the patches' luminances."""
    patch = solution.design.patch
    weight = np.linalg.inv(covariance)
    members = np.equal.outer(patch, np.arange(len(solution.design.patches))).astype(float)
    moved = weight @ solution.residual
    pull = members.T @ moved
    by_patches = pull @ np.linalg.solve(members.T @ weight @ members, pull)
    return max(float(solution.residual @ moved - by_patches), 0.0)


def scatter_of_one(design: Design) -> tuple[float, float]:
    """Relative scatter of a patch at one exposure, and its degrees of freedom."""
    parts = [(design.scatter_rel**2, design.scatter_rel_dof), (design.scatter_each_rel**2, design.scatter_each_rel_dof)]
    return sqrt(sum(variance for variance, _ in parts)), effective_dof(parts)


def fit_dof(solution: Solution) -> float:
    """Degrees of freedom of the first parameter's uncertainty, by those of scatter and flicker."""
    design, row = solution.design, solution.gain[0]
    total = float(row @ solution.covariance @ row)
    parts = [
        (getattr(design, kind) ** 2 * float(row @ _pattern(solution, kind) @ row), getattr(design, f"{kind}_dof"))
        for kind in ("scatter_rel", "scatter_each_rel", "scatter_each_dn")
    ]
    level = np.sqrt(np.abs(solution.luminance * design.readings))
    flickers = [one for one in design.shared if one.dof < inf]
    if flickers:
        variance = sum(float(row @ (one.relative * level)) ** 2 for one in flickers)
        parts.append((variance, flickers[0].dof))
    return effective_dof([*parts, (max(total - sum(v for v, _ in parts), 0.0), inf)])
