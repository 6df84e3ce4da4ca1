"""Weighted straight lines with uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Line:
    """y = `intercept` + `slope` x.

    Parameters
    ----------
    intercept, slope : float
        The line.
    covariance : ndarray of float, shape (2, 2)
        Of intercept and slope.
    chi_squared : float
        Sum of squared deviations over the variances of the points.
    """

    intercept: float
    slope: float
    covariance: FloatArray
    chi_squared: float

    @property
    def intercept_uncertainty(self) -> float:
        """Standard uncertainty of the intercept."""
        return sqrt(float(self.covariance[0, 0]))

    @property
    def slope_uncertainty(self) -> float:
        """Standard uncertainty of the slope; nan where it is not known."""
        return sqrt(float(self.covariance[1, 1]))


def line(x: FloatArray, y: FloatArray, u: FloatArray) -> Line:
    """Fit a line, points weighted with 1 / u^2; a constant if all x are equal.

    Parameters
    ----------
    x, y, u : ndarray of float, shape (n,)
        Points, and the standard uncertainties of y, above 0.

    Returns
    -------
    Line
        Its covariance is widened by the Birge ratio squared if the points scatter more than u says. The slope of a
        constant is 0 with unknown uncertainty (nan).
    """
    centre, scale = float(np.average(x, weights=1 / u**2)), float(np.ptp(x))
    n = 2 if scale > 0 else 1
    design = np.column_stack([np.ones_like(x), (x - centre) / (scale or 1.0)])[:, :n]
    root = design / u[:, None]
    covariance = np.linalg.inv(root.T @ root)
    parameters = covariance @ (root.T @ (y / u))
    chi_squared = float(np.sum(((y - design @ parameters) / u) ** 2))
    covariance *= birge(chi_squared, x.size - n) ** 2
    if n == 1:
        return Line(float(parameters[0]), 0.0, np.diag([covariance[0, 0], np.nan]), chi_squared)
    back = np.array([[1.0, -centre / scale], [0.0, 1 / scale]])
    intercept, slope = back @ parameters
    return Line(float(intercept), float(slope), back @ covariance @ back.T, chi_squared)


def birge(chi_squared: float, dof: int) -> float:
    """Birge ratio sqrt(chi^2 / dof), at least 1."""
    return max(1.0, sqrt(chi_squared / dof)) if dof > 0 else 1.0
