"""Nodes and weights that stand for the spread of a fixed pattern over the pixels."""

from __future__ import annotations

from math import ceil, log, sqrt

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Error aimed at, relative to what is integrated.
_ERROR = 1e-7


def normal_nodes(sharpness: float) -> tuple[FloatArray, FloatArray]:
    """Nodes and weights of a standard normal distribution.

    Parameters
    ----------
    sharpness : float
        Standard deviation of the distribution over that of the normal density which the integrand varies like.

    Returns
    -------
    nodes, weights : ndarray
        The weights add up to 1.

    Notes
    -----
    The error of Gauss-Hermite rules falls like (q^2 / (1 + q^2))^n with the sharpness q. Above 1 the trapezoidal rule
    needs fewer nodes; for products of normal densities it converges exponentially.
    """
    if sharpness == 0:
        return np.zeros(1), np.ones(1)
    if sharpness < 1:
        ratio = sharpness**2 / (1 + sharpness**2)
        nodes, weights = np.polynomial.hermite_e.hermegauss(ceil(log(_ERROR) / log(ratio)) + 1)
    else:
        reach = 6.3
        step = 0.9 / sqrt(1 + sharpness**2)
        nodes = np.linspace(-reach, reach, 2 * ceil(reach / step) + 1)
        weights = np.exp(-(nodes**2) / 2)
    return nodes, weights / weights.sum()


def gamma_nodes(order: float, sharpness: float) -> tuple[FloatArray, FloatArray]:
    """Nodes and weights of a gamma distribution of mean 1 and standard deviation order^(-1/2).

    Parameters
    ----------
    order : float
        Shape parameter, above 0.
    sharpness : float
        Mean of the distribution over the standard deviation of the normal density which the integrand varies like.

    Returns
    -------
    nodes, weights : ndarray
        The weights add up to 1.

    Notes
    -----
    Trapezoidal rule in the logarithm, in which the density exp(order (y - e^y)) is smooth for every order and falls
    off exponentially on both sides.
    """
    step = 0.6 / sqrt(1 + order + sharpness**2)
    reach = -log(_ERROR * 1e-2)
    # order (e^y - 1 - y) > reach on both sides.
    low = -(1 + reach / order) if order < reach else -2 * sqrt(2 * reach / order)
    high = log(1 + sqrt(2 * reach / order) + reach / order)
    logs = np.arange(low, high + step, step)
    weights = np.exp(order * (logs + 1 - np.exp(logs)))
    return np.exp(logs), weights / weights.sum()
