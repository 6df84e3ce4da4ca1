"""Photon transfer: the overall system gain K as slope of the variance over the signal, through the dark point."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray

from .dark.lines import birge

FloatArray = NDArray[np.float64]

#: Share of saturation up to which photon transfer is a straight line (EMVA 1288 Release 4.0 Linear).
FIT_SHARE = 0.7
#: Rounds of weights; they change little after the second.
_ROUNDS = 4


@dataclass(frozen=True)
class Slope:
    """y = `value` x, with its standard uncertainty."""

    value: float
    standard_uncertainty: float


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
        widened by the Birge ratio if the points scatter more than u says.
    """
    weight = 1 / u**2 if weighted else np.ones_like(x)
    normal = float(np.sum(weight * x**2))
    slope = float(np.sum(weight * x * y)) / normal
    propagated = sqrt(float(np.sum((weight * x * u) ** 2))) / normal
    return Slope(slope, propagated * birge(float(np.sum(((y - slope * x) / u) ** 2)), x.size - 1))


def weighted_gain(
    net_dn: FloatArray,
    excess_dn2: FloatArray,
    dark_dn2: FloatArray,
    dof: FloatArray,
    dark_dof: FloatArray | float = inf,
) -> Slope:
    """Fit var - var_dark = K (mean - mean_dark) with the variances of the variances, 2 s^4 / dof.

    The weights follow from the fitted line: those from the points would be biased towards low values.

    Parameters
    ----------
    net_dn, excess_dn2 : ndarray of float, shape (n,)
        Signals above dark, and variances over those in the dark.
    dark_dn2 : ndarray of float, shape (n,)
        Variances in the dark at the same exposures.
    dof, dark_dof : ndarray of float, shape (n,)
        Degrees of freedom of both.
    """
    found = Slope(float(excess_dn2.sum() / net_dn.sum()), 0.0)
    for _ in range(_ROUNDS):
        light_dn2 = max(found.value, 0.0) * net_dn + dark_dn2
        u = np.sqrt(2 * (light_dn2**2 / dof + dark_dn2**2 / dark_dof)) + 1e-12
        found = slope_through_origin(net_dn, excess_dn2, u, weighted=True)
    return found
