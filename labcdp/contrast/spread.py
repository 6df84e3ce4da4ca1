"""The distribution of the contrasts of all pairs of pixels, for plots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from .distribution import Region, numeric_array
from .pairs import bright_and_dark, decimal_fraction, weight_up_to


@dataclass(frozen=True, eq=False)
class ContrastDistribution:
    """Cumulative probability of the contrast between two regions; all shares are fractions of all pairs.

    Parameters
    ----------
    edges : ndarray of float, shape (k,)
        Weber contrasts, fractions.
    cumulative : ndarray of float, shape (k,)
        Share of pairs whose contrast is at most that of the edge. Its differences are the bars of a histogram.
    unbounded : float
        Share of pairs with a dark pixel of 0 or below and a bright one above 0; no edge reaches them.
    undefined : float
        Share of pairs in which no pixel is above 0; they count as below every edge, as in `cdp`.
    """

    edges: NDArray[np.float64]
    cumulative: NDArray[np.float64]
    unbounded: float
    undefined: float


def contrast_distribution(a: Region, b: Region, bins: ArrayLike) -> ContrastDistribution:
    """Cumulative probability of the contrast of all pairs at given edges, exact at any size of the regions.

    Parameters
    ----------
    a, b : array_like of int or float of any shape, or Distribution
        Pixels of the two regions, as for `cdp`.
    bins : array_like of float, shape (k,)
        Edges in Weber contrast (fractions), rising, from -1 on; at least one. Below 0 are pairs whose pixel of the
        bright region is the darker of the two.

    Returns
    -------
    ContrastDistribution

    Raises
    ------
    InputError
        If the edges are not finite, not rising or below -1, or a region cannot be used (see `cdp`).

    Notes
    -----
    Each edge costs one pass over the distinct values; the pairs are never held.
    """
    edges = numeric_array(bins, "bins").astype(np.float64)
    if edges.ndim != 1 or edges.size == 0 or not np.isfinite(edges).all() or (np.diff(edges) <= 0).any():
        raise InputError("bins are not a rising list of finite contrasts: give edges such as 0, 0.1, 0.2")
    if edges[0] < -1:
        raise InputError(f"bins start at {edges[0]:g}: no contrast is below -1 between values above 0")
    bright, dark, _ = bright_and_dark(a, b)
    weights = [weight_up_to(bright, dark, decimal_fraction(edge)) for edge in edges]
    return ContrastDistribution(
        edges=edges,
        cumulative=np.array(weights) / (bright.total * dark.total),
        unbounded=dark.not_positive * (1 - bright.not_positive),
        undefined=dark.not_positive * bright.not_positive,
    )
