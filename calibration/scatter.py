"""Scatter of patches and observations that the stated errors do not explain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import exp, log
from typing import NamedTuple

import numpy as np

from .chance import SMALL_CHANCE, chance_of_chi_squared
from .design import Array, Design
from .gls import Solution, solve
from .rungs import Rung

#: Least scatter, relative or in DN: far below all stated errors.
_LEAST = 1e-5
#: Most relative scatter: a calibration is no better than a guess there.
_MOST_REL = 0.5


def with_scatter(design: Design, rung: Rung, *, by_place: bool = False) -> Solution:
    """Fit again with the further scatter that the residuals show, if chi^2 is improbable without.

    The method of R. C. Paule and J. Mandel, J. Res. NBS 87 (1982) 377: the scatter is what makes chi^2 equal its
    degrees of freedom; first that of the single observations of one patch among each other, then that of the patches.
    The observations scatter in parts of the luminance, as by wrong exposure times, or in DN, as by a wrong dark,
    whichever is likelier.

    Where the patches deviate by their place, a fall-off that is not taken off makes them uneven, too. This unevenness
    then is no error of the patches' light that could explain how they scatter: it counts as 0.

    Parameters
    ----------
    design : Design
        The observations.
    rung : Rung
        The model.
    by_place : bool
        Whether the deviations of the patches go with their places.

    Returns
    -------
    Solution
        With the scatter in its design; 0 if the stated errors explain all.
    """
    n, n_patches = design.net_dn.size, len(design.patches)
    if by_place:
        design = replace(design, uneven_rel=np.zeros(n_patches))
    first = solve(design, rung)
    if not by_place and chance_of_chi_squared(first.chi_squared, first.degrees_of_freedom) >= SMALL_CHANCE:
        return first

    inside = within_patches(first, first.covariance)
    if chance_of_chi_squared(inside, n - n_patches) < SMALL_CHANCE:
        design, inside = _observations_scatter(first, n - n_patches)
    of_patches = n_patches - first.parameters.size

    def between(patch_rel: float) -> float:
        return solve(replace(design, scatter_rel=patch_rel), rung).chi_squared - inside

    excess = between(0.0)
    if chance_of_chi_squared(excess, of_patches) < SMALL_CHANCE or (by_place and excess > of_patches > 0):
        design = replace(design, scatter_rel=_crossing(between, of_patches, _MOST_REL))
    return solve(design, rung)


def _observations_scatter(solution: Solution, freedom: int) -> tuple[Design, float]:
    """Return the design with the observations' scatter of the likelier kind, and what their chi^2 then is."""
    relative, most_dn = solution.luminance**2, float(solution.design.net_dn.max())
    in_parts = _scattered(solution, relative, freedom, _MOST_REL)
    in_dn = _scattered(solution, solution.slope**2, freedom, most_dn)
    # With chi^2 the same, the likelihood is that of the covariance's determinant.
    if in_parts.log_determinant <= in_dn.log_determinant:
        return replace(solution.design, scatter_each_rel=in_parts.scatter), in_parts.chi_squared
    return replace(solution.design, scatter_each_dn=in_dn.scatter), in_dn.chi_squared


class _Scattered(NamedTuple):
    scatter: float
    log_determinant: float
    chi_squared: float


def _scattered(solution: Solution, pattern: Array, freedom: int, most: float) -> _Scattered:
    """Find how much of a variance pattern, shape (n,), the observations need."""

    def covariance(scatter: float) -> Array:
        added: Array = solution.covariance + np.diag(scatter**2 * pattern)
        return added

    scatter = _crossing(lambda s: within_patches(solution, covariance(s)), freedom, most)
    final = covariance(scatter)
    return _Scattered(scatter, float(np.linalg.slogdet(final)[1]), within_patches(solution, final))


def within_patches(solution: Solution, covariance: Array) -> float:
    """chi^2 of the observations of each patch among each other, whatever the patch's luminance."""
    patch = solution.design.patch
    weight = np.linalg.inv(covariance)
    members = np.equal.outer(patch, np.arange(len(solution.design.patches))).astype(float)
    moved = weight @ solution.residual
    pull = members.T @ moved
    by_patches = pull @ np.linalg.solve(members.T @ weight @ members, pull)
    return max(float(solution.residual @ moved - by_patches), 0.0)


def _crossing(chi_squared: Callable[[float], float], freedom: int, most: float) -> float:
    """Scatter at which a falling chi^2 meets its degrees of freedom."""
    from scipy.optimize import brentq

    low = high = _LEAST
    while chi_squared(high) > freedom:
        if high >= most:
            return most
        low, high = high, min(2 * high, most)
    if low == high:
        return low
    return exp(float(brentq(lambda s: chi_squared(exp(s)) - freedom, log(low), log(high), xtol=1e-3)))
