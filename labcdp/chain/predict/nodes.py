"""Nodes that stand for a fixed pattern and for all electron rates, and interpolation between them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import ceil, expm1, log, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Error aimed at, relative to what is integrated.
_ERROR = 1e-7
#: Logarithm of a share of the mean that is no signal.
_LOWEST = -60.0


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
    off exponentially on both sides. Where that takes long, of small orders, the lowest node stands for all below it.
    """
    step = 0.6 / sqrt(1 + order + sharpness**2)
    reach = -log(_ERROR * 1e-2)
    # order (e^y - 1 - y) > reach on both sides.
    low = -(1 + reach / order) if order < reach else -2 * sqrt(2 * reach / order)
    low = max(low, _LOWEST)
    high = log(1 + sqrt(2 * reach / order) + reach / order)
    logs = np.arange(low, high + step, step)
    weights = np.exp(order * (logs + 1 - np.exp(logs)))
    # With those below it, a geometric series.
    weights[0] /= -expm1(-order * step)
    return np.exp(logs), weights / weights.sum()


def lagrange_weights(nodes: FloatArray, at: NDArray[Any]) -> FloatArray:
    """Weights of the values at the nodes in the polynomial through them.

    Parameters
    ----------
    nodes : ndarray, shape (k,) or (n, k)
        Distinct nodes, the same for each place or a row for each.
    at : ndarray, shape (n,)
        Places.

    Returns
    -------
    ndarray, shape (n, k)
    """
    # A row for each node, so that all places of a node are contiguous.
    rows: FloatArray = np.ascontiguousarray(nodes.T)
    distance, weights = [at - row for row in rows], np.ones((len(rows), at.size))
    for j, weight in enumerate(weights):
        for k, row in enumerate(rows):
            if k != j:
                weight *= distance[k] / (rows[j] - row)
    return np.ascontiguousarray(weights.T)


FloatArray = NDArray[np.float64]

#: Nodes used by one interpolation.
_POINTS = 10


@dataclass(frozen=True, eq=False)
class RateGrid:
    """Nodes even in the square root of the rate, as shot noise asks for, and denser where more exposures see it.

    Parameters
    ----------
    exposures_s : tuple of float
        Exposure times in seconds, longest first.
    certain_e : float
        Mean electrons from which on the outcome of an exposure is certain.
    step : float
        Distance of nodes in standard deviations of the shot noise. What is tabulated varies with the rate like a
        normal density of unit width in these deviations, for which the error of a Lagrange polynomial through 10 nodes
        is below max|f^(10)| / 10! * (h/2 * 3h/2 * 5h/2 * 7h/2 * 9h/2)^2: 9e-8 at 0.25, 1e-5 at 0.4.
    """

    exposures_s: tuple[float, ...]
    certain_e: float
    step: float = 0.25

    @cached_property
    def roots(self) -> FloatArray:
        """Square roots of the rates of the nodes, rising from 0."""
        ends = [sqrt(self.certain_e / exposure_s) for exposure_s in self.exposures_s]
        pieces, start = [], 0.0
        for i, end in enumerate(ends):
            # d(2 sqrt(rate t)) is a standard deviation of the count; the exposures not yet saturated add up.
            step = self.step / 2 / sqrt(sum(self.exposures_s[i:]))
            pieces.append(np.linspace(start, end, ceil((end - start) / step), endpoint=False))
            start = end
        return np.concatenate([*pieces, start + step * np.arange(_POINTS // 2 + 1)])

    @property
    def rates_e_s(self) -> FloatArray:
        """Rates of the nodes in electrons per second, shape (nodes,)."""
        return self.roots**2

    @cached_property
    def last_e_s(self) -> float:
        """Rate beyond which nothing changes."""
        return self.certain_e / self.exposures_s[-1]

    def stencil(self, rates_e_s: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
        """Nodes and weights that interpolate at given rates.

        Parameters
        ----------
        rates_e_s : ndarray, shape (n,)
            Rates; below 0 they count as 0, above the grid as its last node.

        Returns
        -------
        index, weight : ndarray, shape (n, 10)
            A node may occur twice: functions of the rate are even in its square root, so the nodes are mirrored at 0.
        """
        roots = self.roots
        at = np.sqrt(np.clip(rates_e_s, 0.0, self.last_e_s))
        first = np.searchsorted(roots, at, side="right") - _POINTS // 2
        offset = np.minimum(first, roots.size - _POINTS)[:, None] + np.arange(_POINTS)
        index = np.abs(offset)
        node = np.where(offset < 0, -roots[index], roots[index])
        return index, lagrange_weights(node, at)


@dataclass(frozen=True, eq=False)
class KnownRates:
    """Rates whose distributions are known, where nothing lies between them.

    Parameters
    ----------
    rates_e_s : ndarray of float, shape (nodes,)
        Rising.
    """

    rates_e_s: FloatArray

    def stencil(self, rates_e_s: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
        """Nodes and weights for some of the rates, of shape (n, 1); see `RateGrid.stencil`."""
        return np.searchsorted(self.rates_e_s, rates_e_s)[:, None], np.ones((rates_e_s.size, 1))
