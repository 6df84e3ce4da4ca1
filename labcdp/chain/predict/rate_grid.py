"""Grid of electron rates on which distributions are tabulated, and interpolation between its nodes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import ceil, sqrt

import numpy as np
from numpy.typing import NDArray

from .lagrange import lagrange_weights

FloatArray = NDArray[np.float64]

#: Distance of nodes in standard deviations of the shot noise, and nodes used by one interpolation. What is tabulated
#: varies with the rate like a normal density of unit width in these deviations, for which the error of a Lagrange
#: polynomial through 10 nodes is below max|f^(10)| / 10! * (h/2 * 3h/2 * 5h/2 * 7h/2 * 9h/2)^2 = 9e-8.
_STEP = 0.25
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
    """

    exposures_s: tuple[float, ...]
    certain_e: float

    @cached_property
    def roots(self) -> FloatArray:
        """Square roots of the rates of the nodes, rising from 0."""
        ends = [sqrt(self.certain_e / exposure_s) for exposure_s in self.exposures_s]
        pieces, start = [], 0.0
        for i, end in enumerate(ends):
            # d(2 sqrt(rate t)) is a standard deviation of the count; the exposures not yet saturated add up.
            step = _STEP / 2 / sqrt(sum(self.exposures_s[i:]))
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
        place = np.minimum(first, roots.size - _POINTS)[:, None] + np.arange(_POINTS)
        index = np.abs(place)
        node = np.where(place < 0, -roots[index], roots[index])
        return index, lagrange_weights(node, at)
