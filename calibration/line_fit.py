"""Straight line through points with errors in both variables, by effective variances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import CalibrationError

_MAX_ROUNDS = 200
_TOLERANCE = 1e-10


@dataclass(frozen=True, eq=False)
class Line:
    """y = slope x + intercept.

    Parameters
    ----------
    slope, intercept : float
        The intercept is 0 if it was not fitted.
    slope_variance, intercept_variance : float
        Variances by the errors given for the points, not scaled with chi^2.
    chi_squared : float
        Minimum of the sum of squares.
    degrees_of_freedom : int
        Points less parameters.
    standardised_residuals : ndarray of float, shape (n,)
        (y - slope x - intercept) over its standard deviation.
    """

    slope: float
    intercept: float
    slope_variance: float
    intercept_variance: float
    chi_squared: float
    degrees_of_freedom: int
    standardised_residuals: NDArray[np.float64]


def fit_line(
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    x_variance: NDArray[np.float64],
    y_covariance: NDArray[np.float64],
    *,
    free_intercept: bool,
) -> Line:
    """Fit a straight line, through zero or free, to points with errors in both variables.

    Minimises chi^2 = r^T C^-1 r with r = y - b x - a and the effective covariance C = C_y + b^2 diag(var_x). Setting
    the derivative to zero gives the weighted normal equations with the adjusted points x' = x + b var_x C^-1 r on
    the left; they are solved by repetition. For uncorrelated errors these are the unified equations of D. York et
    al., Am. J. Phys. 72 (2004) 367, also for the variances, (X'^T C^-1 X')^-1.

    Parameters
    ----------
    x, y : ndarray of float, shape (n,)
        Points, n at least the number of parameters.
    x_variance : ndarray of float, shape (n,)
        Variances of x, independent of each other and of y.
    y_covariance : ndarray of float, shape (n, n)
        Covariance of y, positive definite.
    free_intercept : bool
        False for a line through zero.

    Raises
    ------
    CalibrationError
        If the repetition does not settle.
    """
    ones = np.ones_like(x)
    intercept = 0.0
    slope = float(x @ y / (x @ x))
    for _ in range(_MAX_ROUNDS):
        inverse = np.linalg.inv(y_covariance + slope**2 * np.diag(x_variance))
        residual = y - slope * x - intercept
        adjusted = x + slope * x_variance * (inverse @ residual)
        if free_intercept:
            left = np.column_stack([adjusted, ones]).T @ inverse
            new_slope, new_intercept = np.linalg.solve(left @ np.column_stack([x, ones]), left @ y)
        else:
            left = adjusted @ inverse
            new_slope, new_intercept = (left @ y) / (left @ x), 0.0
        change = abs(new_slope - slope) * np.max(np.abs(x)) + abs(new_intercept - intercept)
        slope, intercept = float(new_slope), float(new_intercept)
        if change <= _TOLERANCE * np.max(np.abs(y)):
            break
    else:
        raise CalibrationError(
            f"the fit did not settle in {_MAX_ROUNDS} rounds: check that readings and frames belong to the same patches"
        )
    effective = y_covariance + slope**2 * np.diag(x_variance)
    inverse = np.linalg.inv(effective)
    residual = y - slope * x - intercept
    adjusted = x + slope * x_variance * (inverse @ residual)
    design = np.column_stack([adjusted, ones]) if free_intercept else adjusted[:, None]
    covariance = np.linalg.inv(design.T @ inverse @ design)
    return Line(
        slope=slope,
        intercept=intercept,
        slope_variance=float(covariance[0, 0]),
        intercept_variance=float(covariance[-1, -1]) if free_intercept else 0.0,
        chi_squared=float(residual @ inverse @ residual),
        degrees_of_freedom=x.size - design.shape[1],
        standardised_residuals=residual / np.sqrt(np.diag(effective)),
    )
