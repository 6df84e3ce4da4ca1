"""The distribution of the contrasts of all pairs of pixels, for plots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from .distribution import Distribution, Region, numeric_array
from .interval import decimal_fraction
from .pairs import bright_and_dark, weight_up_to
from .quantile import finite_quantile, finite_weights

#: Share of the finite contrasts that bins of equal width leave out: a few pairs with a dark pixel close to 0 have
#: contrasts far beyond all others.
_CUT_OFF = 0.001


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


def contrast_distribution(a: Region, b: Region, bins: int | ArrayLike) -> ContrastDistribution:
    """Cumulative probability of the contrast of all pairs at given edges, exact at any size of the regions.

    Parameters
    ----------
    a, b : array_like of int or float of any shape, or Distribution
        Pixels of the two regions, as for `cdp`.
    bins : int or array_like of float, shape (k,)
        Edges in Weber contrast (fractions), rising, from -1 on; at least one. Below 0 are pairs whose pixel of the
        bright region is the darker of the two. An integer asks for so many bins of equal width over the central
        99.9 % of the finite contrasts, and half a bin more on either side.

    Returns
    -------
    ContrastDistribution

    Raises
    ------
    InputError
        If the edges are not finite, not rising or below -1, the number of bins is not above 0 or there is no finite
        contrast for them, or a region cannot be used (see `cdp`).

    Notes
    -----
    Each edge costs one pass over the distinct values, and the ends for an integer about 60; the pairs are never held.
    """
    bright, dark, _ = bright_and_dark(a, b)
    edges = _even_edges(bright, dark, int(bins)) if isinstance(bins, int | np.integer) else _given_edges(bins)
    weights = [weight_up_to(bright, dark, decimal_fraction(edge)) for edge in edges]
    return ContrastDistribution(
        edges=edges,
        cumulative=np.array(weights) / (bright.total * dark.total),
        unbounded=dark.not_positive * (1 - bright.not_positive),
        undefined=dark.not_positive * bright.not_positive,
    )


def _given_edges(bins: ArrayLike) -> NDArray[np.float64]:
    edges = numeric_array(bins, "bins").astype(np.float64)
    if edges.ndim != 1 or edges.size == 0 or not np.isfinite(edges).all() or (np.diff(edges) <= 0).any():
        raise InputError("bins are not a rising list of finite contrasts: give edges such as 0, 0.1, 0.2")
    if edges[0] < -1:
        raise InputError(f"bins start at {edges[0]:g}: no contrast is below -1 between values above 0")
    return edges


def _even_edges(bright: Distribution, dark: Distribution, bins: int) -> NDArray[np.float64]:
    if bins < 1:
        raise InputError(f"bins is {bins}: give a number above 0, or edges such as 0, 0.1, 0.2")
    undefined, bounded = finite_weights(bright, dark)
    if not bounded > undefined:
        raise InputError("no pair has a finite contrast, so there is nothing to bin: check exposure and black level")
    low, high = (
        finite_quantile(bright, dark, undefined + share * (bounded - undefined), 1e-9)
        for share in (_CUT_OFF / 2, 1 - _CUT_OFF / 2)
    )
    # Half a bin, so that what lies on an end is inside; equal contrasts have no width of their own.
    margin = (high - low) / (2 * bins) if high - low > 1e-8 * (1 + high) else 0.005 * (1 + high)
    return np.linspace(max(low - margin, -1), high + margin, bins + 1)
