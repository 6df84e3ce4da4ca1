"""Straight lines through measured points, with the uncertainty of what they say."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Slope:
    """y = `value` x.

    Parameters
    ----------
    value, standard_uncertainty : float
        The slope.
    chi_squared : float
        Sum of squared deviations over the variances of the points.
    freedom : int
        Degrees of freedom.
    """

    value: float
    standard_uncertainty: float
    chi_squared: float
    freedom: int


@dataclass(frozen=True)
class Line:
    """y = `intercept` + `slope` x.

    Parameters
    ----------
    intercept, slope : float
        The line.
    covariance : ndarray of float, shape (2, 2)
        Of intercept and slope.
    """

    intercept: float
    slope: float
    covariance: FloatArray

    @property
    def intercept_uncertainty(self) -> float:
        """Standard uncertainty of the intercept."""
        return sqrt(float(self.covariance[0, 0]))

    @property
    def slope_uncertainty(self) -> float:
        """Standard uncertainty of the slope."""
        return sqrt(float(self.covariance[1, 1]))


def slope_through_origin(x: FloatArray, y: FloatArray, u: FloatArray, weighted: bool = False) -> Slope:
    """Fit a line through the origin.

    Parameters
    ----------
    x, y, u : ndarray of float, shape (n,)
        Points, and the standard uncertainties of y, above 0.
    weighted : bool
        False for the least squares of EMVA 1288, all points alike; True weights with 1 / u^2, for points whose
        uncertainties differ by orders.

    Returns
    -------
    Slope
        b = sum(w x y) / sum(w x^2). The uncertainty is propagated from u, sqrt(sum((w x u)^2)) / sum(w x^2), and
        widened by the Birge ratio sqrt(chi^2 / freedom) if the points scatter more than u says.
    """
    weight = 1 / u**2 if weighted else np.ones_like(x)
    normal = float(np.sum(weight * x**2))
    slope = float(np.sum(weight * x * y)) / normal
    propagated = sqrt(float(np.sum((weight * x * u) ** 2))) / normal
    chi_squared, freedom = float(np.sum(((y - slope * x) / u) ** 2)), x.size - 1
    return Slope(slope, propagated * _birge(chi_squared, freedom), chi_squared, freedom)


def line(x: FloatArray, y: FloatArray, u: FloatArray) -> Line:
    """Fit a line with intercept, points weighted with 1 / u^2.

    Parameters
    ----------
    x, y, u : ndarray of float, shape (n,)
        Points at two values of x at least, and the standard uncertainties of y, above 0.

    Returns
    -------
    Line
        Its covariance is widened by the Birge ratio squared if the points scatter more than u says.
    """
    centre = float(np.average(x, weights=1 / u**2))
    scale = float(np.ptp(x))
    design = np.column_stack([np.ones_like(x), (x - centre) / scale])
    root = design / u[:, None]
    covariance = np.linalg.inv(root.T @ root)
    parameters = covariance @ (root.T @ (y / u))
    chi_squared = float(np.sum(((y - design @ parameters) / u) ** 2))
    back = np.array([[1.0, -centre / scale], [0.0, 1 / scale]])
    intercept, slope = back @ parameters
    widened = back @ covariance @ back.T * _birge(chi_squared, x.size - 2) ** 2
    return Line(float(intercept), float(slope), widened)


def _birge(chi_squared: float, freedom: int) -> float:
    return max(1.0, sqrt(chi_squared / freedom)) if freedom > 0 else 1.0
