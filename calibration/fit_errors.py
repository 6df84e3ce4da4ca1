"""From a fit to the independent errors that all luminances share."""

from __future__ import annotations

import numpy as np

from .common_errors import FitError
from .design import Array
from .gls import Solution
from .rungs import Rung

#: Signals at which the error of a bent response is kept: a straight line between them is exact to 0.1 % of it.
_N_NODES = 48


def parameter_covariance(solution: Solution) -> Array:
    """Covariance of the parameters, darkness included, shape (p, p)."""
    covariance: Array = solution.gain @ solution.covariance @ solution.gain.T
    return covariance


def fit_errors(solution: Solution, widening: float) -> tuple[FitError, ...]:
    """Split the errors of parameters and darkness into independent ones.

    An error of the darkness moves the parameters too: it is kept whole, with both its effects. The rest of the
    parameters' covariance is split into the eigenvectors of the response (``fit``; the gain factors follow by
    regression) and those of the gain factors given the response (``gain``). An error of a response that is given
    (``linearity``) is less what the scale, fitted with it, makes good.

    Parameters
    ----------
    solution : Solution
        The fit.
    widening : float
        Factor on the errors that do not come from the darkness.
    """
    by_dark = [solution.slope * error.dark_dn for error in solution.design.dark_errors]
    by_shape = list(solution.luminance * solution.rung.errors(solution.design.net_dn))
    rest = solution.covariance - sum(np.outer(column, column) for column in (*by_dark, *by_shape))
    own = solution.gain @ rest @ solution.gain.T
    n = solution.rung.n_parameters
    response, between, factors = own[:n, :n], own[n:, :n], own[n:, n:]
    errors = []
    values, vectors = np.linalg.eigh(response)
    regression = between @ np.linalg.pinv(response)
    for value, vector in zip(values, vectors.T, strict=True):
        step = widening * np.sqrt(max(value, 0.0)) * vector
        errors.append(_error(solution, "fit", np.concatenate([step, regression @ step])))
    if factors.size:
        values, vectors = np.linalg.eigh(factors - regression @ between.T)
        for value, vector in zip(values, vectors.T, strict=True):
            step = widening * np.sqrt(max(value, 0.0)) * vector
            errors.append(_error(solution, "gain", np.concatenate([np.zeros(n), step])))
    for error, column in zip(solution.design.dark_errors, by_dark, strict=True):
        moved = _error(solution, "dark and temperature", solution.gain @ column)
        errors.append(
            FitError(
                moved.source,
                moved.net_dn,
                moved.relative,
                moved.gain_rel,
                tuple(float(v) for v in error.parameters),
                error.gain_db,
            )
        )
    for row, column in zip(solution.rung.errors(_nodes(solution.rung)), by_shape, strict=True):
        moved = _error(solution, "linearity", -solution.gain @ column)
        relative = tuple(float(v) for v in row + np.array(moved.relative))
        errors.append(FitError(moved.source, moved.net_dn, relative, moved.gain_rel))
    return tuple(errors)


def _nodes(rung: Rung) -> Array:
    top = rung.knots_dn[-1]
    if rung.kind == "linear":
        return np.array([top])
    if rung.kind == "table":
        return np.geomspace(rung.knots_dn[0], top, _N_NODES)
    return top * np.arange(1, _N_NODES + 1) / _N_NODES


def _error(solution: Solution, source: str, step: Array) -> FitError:
    """Return what a step of all parameters does to the luminances."""
    rung, n = solution.rung, solution.rung.n_parameters
    nodes = _nodes(rung)
    curve = rung.curve(solution.parameters[:n], nodes)
    return FitError(
        source,
        tuple(float(v) for v in nodes),
        tuple(float(v) for v in curve.jacobian @ step[:n] / curve.value),
        tuple(float(v) for v in step[n:] / solution.parameters[n:]),
    )
