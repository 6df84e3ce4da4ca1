"""Debevec's equations in the logarithm of DN: the response, and the light of each group of pixels, at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Number of knots, in equal ratios of DN above dark, and weight of the curve's second differences.
_KNOTS, _SMOOTHNESS = 48, 1.0
#: Weight at the ends of the range, of that in its middle.
_LEAST_WEIGHT = 0.1


def solve(
    net_dn: NDArray[np.floating[Any]], exposures_s: Sequence[float], limits: tuple[float, float]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Solve ln h(n_ij) = ln E_j + ln t_i by least squares, with h linear in logarithms between knots.

    Equations, hat-shaped weights and second differences are those of P. E. Debevec and J. Malik, "Recovering high
    dynamic range radiance maps from photographs", SIGGRAPH 1997; in the logarithm of DN the second differences of a
    power law are 0, so that smoothing does not bend a gamma curve.

    Parameters
    ----------
    net_dn : ndarray of float, shape (exposures, groups)
        DN above dark of groups of pixels.
    exposures_s : sequence of float
        Of the frames.
    limits : (float, float)
        DN above dark between which values are used.

    Returns
    -------
    net_dn, linear_dn : ndarray of float, shape (n,)
        Knots from the lower to the upper limit, and h there, rising; h = n at the first.
    """
    low, high = np.log(limits)
    inside = (net_dn >= limits[0]) & (net_dn <= limits[1])
    inside &= np.count_nonzero(inside, axis=0) > 1
    i, j = np.nonzero(inside)
    groups, j = np.unique(j, return_inverse=True)
    place = (np.log(net_dn[inside]) - low) / (high - low) * (_KNOTS - 1)
    left = np.minimum(place.astype(int), _KNOTS - 2)
    rows = np.arange(place.size)
    design = np.zeros((place.size + _KNOTS - 1, _KNOTS + groups.size))
    design[rows, left], design[rows, left + 1] = left + 1 - place, place - left
    design[rows, _KNOTS + j] = -1.0
    wanted = np.zeros(len(design))
    wanted[rows] = np.log(exposures_s)[i]
    weight = np.maximum(1 - np.abs(2 * place / (_KNOTS - 1) - 1), _LEAST_WEIGHT)
    design[rows] *= weight[:, None]
    wanted[rows] *= weight
    for knot in range(_KNOTS - 2):
        design[place.size + knot, knot : knot + 3] = _SMOOTHNESS * np.array([1.0, -2.0, 1.0])
    design[-1, _KNOTS // 2] = 1.0  # the scale is free
    curve = np.linalg.lstsq(design, wanted)[0][:_KNOTS]
    knots = np.exp(np.linspace(low, high, _KNOTS))
    rising = np.exp(np.maximum.accumulate(curve - curve[0])) * (1 + 1e-6 * np.arange(_KNOTS))
    return knots, knots[0] * rising
