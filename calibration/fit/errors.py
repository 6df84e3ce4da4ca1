"""Common errors of luminances from a fit."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

import numpy as np

from ..fit_error import FitError
from .candidates import CandidateModel
from .design import Array
from .problem import Solution
from .scatter import fit_dof

#: Signals at which the error of a non-linear response is stored; linear interpolation is accurate to 0.1 % of it.
_N_NODES = 48


def parameter_covariance(solution: Solution) -> Array:
    """Covariance of the parameters, dark signal included, shape (p, p)."""
    covariance: Array = solution.gain @ solution.covariance @ solution.gain.T
    return covariance


def fit_errors(solution: Solution) -> tuple[FitError, ...]:
    """Split the errors of parameters and dark signal into independent ones.

    An error of the dark signal also changes the parameters: it is kept as one error with both effects. The rest of the
    covariance is split into the eigenvectors of the response, a given shape corrected included (``fit``; the gain
    factors follow by regression), and those of the gain factors given the response (``gain``).

    Parameters
    ----------
    solution : Solution
        The fit.
    """
    dark = [error for error in solution.design.shared if error.dark]
    by_dark = [solution.slope * error.dn for error in dark]
    every = np.vstack([solution.gain / _scale(solution)[:, None], solution.of_shape])
    own = _covariance(solution, every, by_dark)
    n, size = solution.candidate.n_parameters, solution.parameters.size
    of_response, of_gains = np.r_[:n, size : len(every)], np.r_[n:size]
    response = own[np.ix_(of_response, of_response)]
    between, factors = own[np.ix_(of_gains, of_response)], own[np.ix_(of_gains, of_gains)]
    errors, dof = [], fit_dof(solution)
    values, vectors = np.linalg.eigh(response)
    regression = between @ np.linalg.pinv(response)
    for value, vector in zip(values, vectors.T, strict=True):
        step = np.zeros(len(every))
        step[of_response] = np.sqrt(max(value, 0.0)) * vector
        step[of_gains] = regression @ step[of_response]
        errors.append(_error(solution, "fit", step, dof))
    if factors.size:
        values, vectors = np.linalg.eigh(factors - regression @ between.T)
        for value, vector in zip(values, vectors.T, strict=True):
            step = np.zeros(len(every))
            step[of_gains] = np.sqrt(max(value, 0.0)) * vector
            errors.append(_error(solution, "gain", step, dof))
    for error, column in zip(dark, by_dark, strict=True):
        moved = _error(solution, "dark and temperature", every @ column)
        errors.append(FitError(moved.source, moved.net_dn, moved.relative, moved.gain_rel, error.dark, error.gain_db))
    return tuple(errors)


def _scale(solution: Solution) -> Array:
    """Sizes of the parameters, which differ by orders of magnitude."""
    size: Array = np.maximum(np.abs(solution.parameters), 1e-6 * abs(solution.parameters[0]))
    return size


def _covariance(solution: Solution, every: Array, by_dark: Sequence[Array]) -> Array:
    """Covariance of parameters and shape, less what errors of the dark signal make of it."""
    level = np.sqrt(np.abs(solution.luminance * solution.design.readings))
    by_shape = level * solution.candidate.errors(solution.design.net_dn)
    rest = solution.covariance - by_shape.T @ by_shape - sum(np.outer(column, column) for column in by_dark)
    # An error of the shape is found in part: what is left of it counts.
    missed = every @ by_shape.T
    missed[solution.parameters.size :] -= np.eye(len(by_shape))
    total: Array = every @ rest @ every.T + missed @ missed.T
    return total


def _nodes(candidate: CandidateModel) -> Array:
    top = candidate.knots_dn[-1]
    if candidate.kind == "linear":
        return np.array([top])
    if candidate.kind == "table":
        return np.geomspace(candidate.knots_dn[0], top, _N_NODES)
    return top * np.arange(1, _N_NODES + 1) / _N_NODES


def finite(dof: float) -> float | None:
    """Return degrees of freedom as a file holds them, None for infinite ones."""
    return dof if dof < inf else None


def _error(solution: Solution, source: str, step: Array, dof: float = inf) -> FitError:
    """Return the change of the luminances by a step of all parameters and errors of the shape."""
    candidate, n, size = solution.candidate, solution.candidate.n_parameters, solution.parameters.size
    nodes = _nodes(candidate)
    curve = candidate.curve(solution.parameters[:n], nodes)
    relative = curve.jacobian @ (step[:n] * _scale(solution)[:n]) / curve.value - step[size:] @ candidate.errors(nodes)
    return FitError(
        source,
        tuple(float(v) for v in nodes),
        tuple(float(v) for v in relative),
        tuple(float(v) for v in step[n:size] * _scale(solution)[n:] / solution.parameters[n:]),
        dof=finite(dof),
    )
