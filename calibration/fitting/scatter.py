"""Variance components: scatter of patches and observations that the stated errors do not explain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import exp, inf, log, sqrt
from typing import Any, Literal, get_args

import numpy as np

from ..camera import OF_FRAMES
from ..uncertainty import COVERAGE, NO_SCATTER, SMALL_P_VALUE, Scatter, effective_dof, p_value_of_chi_squared
from .candidates import CandidateModel
from .design import Array, Design
from .problem import Solution, solve

Kind = Literal["scatter_rel", "scatter_each_rel", "scatter_each_dn"]
#: Least and largest scatter: relative ones of luminances, those in DN of the largest signal.
_LEAST, _MOST = 1e-6, 0.5
#: Relative distance from the least deviance that was found within which its slope is 0.
_NEAR = 1e-3
#: Scatter that does not count.
_NEGLIGIBLE = 1e-4
#: Decrease of the deviance required of the scatter of patches.
_WORTH = 0.25
#: Largest scatter, and number of scatters evenly spaced in their logarithms, over which its likelihood is integrated.
_WIDEST, _N_SIZES = 1e3, 500
#: Share of a column that the others leave, below which it is a combination of them.
_COLLINEAR = 1e-10


@dataclass(frozen=True, eq=False)
class _Likelihood:
    """Restricted likelihood of one further variance s^2, in the coordinates in which all covariances are diagonal.

    Minus twice its logarithm is constant + sum(ln(1 + s^2 v) + z^2 / (1 + s^2 v)).
    """

    constant: float
    values: Array
    squares: Array

    @classmethod
    def of(cls, jacobian: Array, residual: Array, covariance: Array, pattern: Array) -> _Likelihood:
        """Of residuals with a known covariance and s^2 times a pattern."""
        from scipy.linalg import qr, solve_triangular

        root = np.linalg.cholesky(covariance)
        white = solve_triangular(root, np.eye(len(root)), lower=True)
        columns = white @ jacobian
        size = np.linalg.norm(columns, axis=0)
        # Patches in one row do not show how the light changes across it: such a column is none.
        columns, size = columns[:, size > 0] / size[size > 0], size[size > 0]
        q, r, order = qr(columns, pivoting=True)
        left_of_columns = np.abs(np.diag(r))
        rank = int((left_of_columns > _COLLINEAR).sum())
        # What the parameters leave of the whitened residuals.
        left = q[:, rank:].T @ white
        values, vectors = np.linalg.eigh(left @ pattern @ left.T)
        volume = np.log(left_of_columns[:rank] * size[order[:rank]]).sum()
        constant = 2 * float(np.log(np.diag(root)).sum() + volume)
        return cls(constant, np.maximum(values, 0.0), (vectors.T @ (left @ residual)) ** 2)

    def deviance(self, size: float) -> float:
        """Minus twice the logarithm."""
        return self.constant + float(self._deviances(np.array([size]))[0])

    def best(self, unit: float) -> float:
        """Return the most likely size, in units, between the limits: where the slope of the deviance is 0."""
        from scipy.optimize import brentq

        def slope(v: float) -> float:
            grown = (unit * exp(v)) ** 2 * self.values
            return float(np.sum(grown / (1 + grown) * (1 - self.squares / (1 + grown))))

        nearest = _minimum(lambda v: self.deviance(unit * exp(v)))
        low, high = nearest - _NEAR, nearest + _NEAR
        return unit * exp(brentq(slope, low, high, xtol=1e-14) if slope(low) < 0 < slope(high) else nearest)

    def dof(self, size: float, unit: float) -> float:
        """Degrees of freedom with which Student's t and the estimate give the error of another patch.

        That error is normal with a standard deviation s of this likelihood, with the prior of H. Jeffreys (Proc. R.
        Soc. A 186 (1946) 453) for a variance. Where s is much larger than the stated errors this is Student's
        distribution of the patches' number; where it is not, s is known not to be much larger than those.
        """
        from scipy.optimize import brentq
        from scipy.special import erfc, stdtridf

        sizes = unit * np.geomspace(_LEAST, _WIDEST, _N_SIZES)
        grown = sizes[:, None] ** 2 * self.values
        logarithm = np.log(np.sum((grown / (1 + grown)) ** 2, axis=1)) / 2 - self._deviances(sizes) / 2
        weight = np.exp(logarithm - logarithm.max())
        weight /= weight.sum()
        limits = log(sizes[0] / 100), log(sizes[-1] * 100)
        half_width = exp(brentq(lambda w: weight @ erfc(exp(w) / (sqrt(2) * sizes)) - (1 - COVERAGE), *limits))
        dof = float(stdtridf((1 + COVERAGE) / 2, half_width / size))
        return max(dof, 1.0) if np.isfinite(dof) else inf

    def _deviances(self, sizes: Array) -> Array:
        grown = 1 + sizes[:, None] ** 2 * self.values
        total: Array = np.sum(np.log(grown) + self.squares / grown, axis=1)
        return total


def with_scatter(design: Design, candidate: CandidateModel, *, by_place: bool = False) -> Solution:
    """Fit with the scatter that the residuals require, by restricted maximum likelihood (REML).

    Patches scatter relative to the luminance. If the observations of one patch contradict each other, they scatter
    too, relative to the luminance (exposure times) or in DN (dark signal), whichever is more likely. REML: H. D.
    Patterson and R. Thompson, Biometrika 58 (1971) 545.

    Parameters
    ----------
    design : Design
        The observations.
    candidate : CandidateModel
        The model.
    by_place : bool
        Whether the deviations depend on the positions of the patches: the scatter by them then counts, however small.

    Returns
    -------
    Solution
        With the scatter in its design; 0 if the stated errors explain all.
    """
    first = solve(design, candidate)
    choices: list[tuple[Kind, ...]] = [("scatter_rel",)]
    inside = within_patches(first, first.covariance)
    if p_value_of_chi_squared(inside, design.net_dn.size - len(design.patches)) < SMALL_P_VALUE:
        choices = [("scatter_rel", "scatter_each_rel"), ("scatter_rel", "scatter_each_dn")]
    deviance, sizes = min((_estimate(first, kinds) for kinds in choices), key=lambda estimate: estimate[0])
    deviance_of_rest, rest = _estimate(first, tuple(sizes)[1:])
    if deviance_of_rest - deviance < _WORTH and not by_place:
        sizes = rest
    if not sizes:
        return first
    scatter: dict[str, Any] = {kind: Scatter(size, _dof(first, sizes, kind)) for kind, size in sizes.items()}
    return solve(replace(design, **scatter), candidate)


def scatter_around_mean(values: Array, variances: Array) -> Scatter:
    """Return the scatter of values that their variances do not explain, estimated as that of the patches of a fit."""
    likelihood = _Likelihood.of(np.ones((values.size, 1)), values, np.diag(variances), np.eye(values.size))
    size = likelihood.best(1.0)
    if likelihood.deviance(0.0) - likelihood.deviance(size) < _WORTH:
        return NO_SCATTER
    return Scatter(size, likelihood.dof(size, 1.0))


def residual_scatter(solution: Solution) -> float:
    """Return the relative scatter of the patches that the model leaves; 0 if it does not count."""
    size = _estimate(solution, ("scatter_rel",))[1]["scatter_rel"]
    return size if size >= _NEGLIGIBLE else 0.0


def _estimate(solution: Solution, kinds: tuple[Kind, ...]) -> tuple[float, dict[Kind, float]]:
    """Return the least deviance at the solution's luminances, and the sizes of at most two kinds that have it."""
    kind = kinds[0] if kinds else "scatter_rel"
    pattern, unit = _pattern(solution, kind), _unit(solution, kind)

    def with_rest_of_size(size: float) -> tuple[float, dict[Kind, float]]:
        rest = dict.fromkeys(kinds[1:], size)
        likelihood = _Likelihood.of(solution.jacobian, solution.residual, covariance_with(solution, rest), pattern)
        best = likelihood.best(unit) if kinds else 0.0
        return likelihood.deviance(best), {kind: best, **rest} if kinds else {}

    if len(kinds) < 2:
        return with_rest_of_size(0.0)
    widest = _unit(solution, kinds[1])
    return with_rest_of_size(widest * exp(_minimum(lambda v: with_rest_of_size(widest * exp(v))[0])))


def _minimum(deviance: Callable[[float], float]) -> float:
    """Logarithm of a size, between the limits, at which a deviance is least."""
    from scipy.optimize import minimize_scalar

    return float(minimize_scalar(deviance, bounds=(log(_LEAST), log(_MOST)), method="bounded").x)


def _dof(solution: Solution, sizes: dict[Kind, float], kind: Kind) -> float:
    """Degrees of freedom of one size, the others known."""
    rest = covariance_with(solution, {other: size for other, size in sizes.items() if other != kind})
    likelihood = _Likelihood.of(solution.jacobian, solution.residual, rest, _pattern(solution, kind))
    return likelihood.dof(sizes[kind], _unit(solution, kind))


def covariance_with(solution: Solution, sizes: dict[Kind, float]) -> Array:
    """Covariance of the residuals with scatter."""
    total: Array = solution.covariance + sum(size**2 * _pattern(solution, kind) for kind, size in sizes.items())
    return total


def _unit(solution: Solution, kind: Kind) -> float:
    """Size that limits are relative to."""
    return float(solution.design.net_dn.max()) if kind == "scatter_each_dn" else 1.0


def _pattern(solution: Solution, kind: Kind) -> Array:
    """Covariance of the residuals for a scatter of 1."""
    if kind == "scatter_rel":
        return np.where(solution.design.same_patch, np.outer(solution.level, solution.level), 0.0)
    return np.diag((solution.luminance if kind == "scatter_each_rel" else solution.slope) ** 2)


def within_patches(solution: Solution, covariance: Array) -> float:
    """chi^2 of the observations within the patches, independent of the patches' luminances."""
    patch = solution.design.patch
    weight = np.linalg.inv(covariance)
    members = np.equal.outer(patch, np.arange(len(solution.design.patches))).astype(float)
    moved = weight @ solution.residual
    pull = members.T @ moved
    by_patches = pull @ np.linalg.solve(members.T @ weight @ members, pull)
    return max(float(solution.residual @ moved - by_patches), 0.0)


def patch_scatter(design: Design) -> Scatter:
    """Relative scatter of a patch at one exposure."""
    parts = [design.scatter_rel.part, design.scatter_each_rel.part]
    return Scatter(sqrt(sum(variance for variance, _ in parts)), effective_dof(parts))


def fit_dof(solution: Solution) -> float:
    """Degrees of freedom of the first parameter's uncertainty, by those of scatter, flicker and black level."""
    design, row = solution.design, solution.gain[0]
    total = float(row @ solution.covariance @ row)
    scatter: dict[Kind, Scatter] = {kind: getattr(design, kind) for kind in get_args(Kind)}
    parts = [
        (of_kind.size**2 * float(row @ _pattern(solution, kind) @ row), of_kind.dof)
        for kind, of_kind in scatter.items()
    ]
    for source in OF_FRAMES:
        errors = [error for error in design.shared if error.source == source]
        variance = sum(
            float(row @ (error.relative * solution.level + error.dn * solution.slope)) ** 2 for error in errors
        )
        parts += [(variance, errors[0].dof)] if errors else []
    return effective_dof([*parts, (max(total - sum(v for v, _ in parts), 0.0), inf)])
