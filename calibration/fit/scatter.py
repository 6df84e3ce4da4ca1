"""Scatter of patches and observations that the stated errors do not explain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import exp, log
from typing import NamedTuple

import numpy as np

from .candidates import CandidateModel
from .design import Array, Design
from .gls import Solution, solve
from .significance import SMALL_P_VALUE, p_value_of_chi_squared

#: Least scatter, relative or in DN: far below all stated errors.
_LEAST = 1e-5
#: Largest relative scatter, at which a calibration is useless.
_MOST_REL = 0.5


def with_scatter(design: Design, candidate: CandidateModel, *, by_place: bool = False) -> Solution:
    """Refit with additional scatter, if chi^2 is improbable without.

    The method of R. C. Paule and J. Mandel, J. Res. NBS 87 (1982) 377: the scatter is chosen such that chi^2 equals its
    degrees of freedom, first for the observations within the patches, then between patches. Observations scatter
    relative to the luminance (wrong exposure times) or in DN (wrong dark signal), whichever is more likely.

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
    n, n_patches = design.net_dn.size, len(design.patches)
    if by_place:
        design = replace(design, uneven_rel=np.zeros(n_patches))
    first = solve(design, candidate)
    if not by_place and p_value_of_chi_squared(first.chi_squared, first.degrees_of_freedom) >= SMALL_P_VALUE:
        return first

    inside = within_patches(first, first.covariance)
    if p_value_of_chi_squared(inside, n - n_patches) < SMALL_P_VALUE:
        design, inside = _observations_scatter(first, n - n_patches)
    of_patches = n_patches - first.parameters.size

    def between(patch_rel: float) -> float:
        return solve(replace(design, scatter_rel=patch_rel), candidate).chi_squared - inside

    excess = between(0.0)
    if p_value_of_chi_squared(excess, of_patches) < SMALL_P_VALUE or (by_place and excess > of_patches > 0):
        design = replace(design, scatter_rel=_crossing(between, of_patches, _MOST_REL))
    return solve(design, candidate)


def _observations_scatter(solution: Solution, dof: int) -> tuple[Design, float]:
    """Return the design with the more likely kind of scatter of the observations, and their chi^2."""
    relative, most_dn = solution.luminance**2, float(solution.design.net_dn.max())
    in_parts = _scattered(solution, relative, dof, _MOST_REL)
    in_dn = _scattered(solution, solution.slope**2, dof, most_dn)
    # At equal chi^2, the likelihood depends only on the determinant of the covariance.
    if in_parts.log_determinant <= in_dn.log_determinant:
        return replace(solution.design, scatter_each_rel=in_parts.scatter), in_parts.chi_squared
    return replace(solution.design, scatter_each_dn=in_dn.scatter), in_dn.chi_squared


class _Scattered(NamedTuple):
    scatter: float
    log_determinant: float
    chi_squared: float


def _scattered(solution: Solution, pattern: Array, dof: int, most: float) -> _Scattered:
    """Find the amplitude of a variance pattern, shape (n,), that the observations require."""

    def covariance(scatter: float) -> Array:
        added: Array = solution.covariance + np.diag(scatter**2 * pattern)
        return added

    scatter = _crossing(lambda s: within_patches(solution, covariance(s)), dof, most)
    final = covariance(scatter)
    return _Scattered(scatter, float(np.linalg.slogdet(final)[1]), within_patches(solution, final))


def within_patches(solution: Solution, covariance: Array) -> float:
    """chi^2 of the observations within the patches, independent of the patches' luminances."""
    patch = solution.design.patch
    weight = np.linalg.inv(covariance)
    members = np.equal.outer(patch, np.arange(len(solution.design.patches))).astype(float)
    moved = weight @ solution.residual
    pull = members.T @ moved
    by_patches = pull @ np.linalg.solve(members.T @ weight @ members, pull)
    return max(float(solution.residual @ moved - by_patches), 0.0)


def _crossing(chi_squared: Callable[[float], float], dof: int, most: float) -> float:
    """Scatter at which a decreasing chi^2 equals its degrees of freedom."""
    from scipy.optimize import brentq

    low = high = _LEAST
    while chi_squared(high) > dof:
        if high >= most:
            return most
        low, high = high, min(2 * high, most)
    if low == high:
        return low
    return exp(float(brentq(lambda s: chi_squared(exp(s)) - dof, log(low), log(high), xtol=1e-3)))
