"""The distribution of the contrasts of all pairs of pixels, for plots."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor, inf, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError
from .arrays import numeric_array
from .contrast import decimal_ratio
from .distribution import Distribution, Region, weight_not_positive
from .pixel_pairs import bright_and_dark, weight_up_to

#: Share of the finite contrasts outside bins of equal width: a few pairs with a dark pixel close to 0 have contrasts
#: far beyond all others.
CUT_OFF = 0.001
#: Most bins of a histogram, and its largest edge as a multiple of the highest detected contrast.
MOST_BINS, MOST_TIMES = 200, 10.0


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

    Examples
    --------
    >>> from labcdp.metrics import contrast_distribution
    >>> contrast_distribution([120, 130], [100, 100], [0.1, 0.2, 0.3]).edges.tolist()
    [0.1, 0.2, 0.3]
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
        Edges in Weber contrast (fractions), increasing, from -1 on; at least one. Pairs whose bright region's pixel is
        the darker one have contrasts below 0. An integer is the largest number of bins of equal width over the central
        99.9 % of the finite contrasts; there are fewer where the contrasts of neighbouring values are farther apart.

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
    Each edge costs one pass over the distinct values, and the ends for an integer about 60; the pairs are never stored.

    Examples
    --------
    >>> from labcdp.metrics import contrast_distribution
    >>> contrast_distribution([120, 130], [100, 100], [0.1, 0.2, 0.3]).cumulative
    array([0. , 0.5, 1. ])
    """
    bright, dark, _ = bright_and_dark(a, b)
    edges = _even_edges(bright, dark, int(bins)) if isinstance(bins, int | np.integer) else _given_edges(bins)
    ratios = ((of + number) / of for number, of in map(decimal_ratio, edges))
    weights = [weight_up_to(bright, dark, ratio) for ratio in ratios]
    return ContrastDistribution(
        edges=edges,
        cumulative=np.array(weights) / (bright.total * dark.total),
        unbounded=dark.not_positive * (1 - bright.not_positive),
        undefined=dark.not_positive * bright.not_positive,
    )


def contrast_histogram(a: Region, b: Region, detected_up_to: float) -> ContrastDistribution | None:
    """Return the distribution of the contrasts for a plot, in up to 200 bins up to 10 times the highest detected one.

    Parameters
    ----------
    a, b : array_like of int or float of any shape, or Distribution
        Pixels of the two regions, as for `cdp`.
    detected_up_to : float
        Highest Weber contrast that counts as detected: a dark pixel close to 0 makes arbitrarily large contrasts.

    Returns
    -------
    ContrastDistribution or None
        None if no contrast is finite.

    Examples
    --------
    >>> from labcdp.metrics import contrast_histogram
    >>> histogram = contrast_histogram([118, 120, 122], [100, 101, 99], 0.3)
    >>> round(float(histogram.cumulative[-1]), 1)
    1.0
    """
    bright, dark, _ = bright_and_dark(a, b)
    undefined, bounded = finite_weights(bright, dark)
    if not bounded > undefined:
        return None
    return contrast_distribution(bright, dark, _even_edges(bright, dark, MOST_BINS, MOST_TIMES * detected_up_to))


def _even_edges(bright: Distribution, dark: Distribution, most: int, up_to: float = inf) -> NDArray[np.float64]:
    """Return edges of equal bins up to at most a contrast, with one bin centred at the contrast of the means.

    Bins are at least as wide as the distance of contrasts of neighbouring values: narrower bins would show artefacts of
    whole DN.
    """
    if most < 1:
        raise InputError(f"bins is {most}: give a number above 0, or edges such as 0, 0.1, 0.2")
    low, high = _finite_range(bright, dark)
    high = min(high, max(up_to, low))
    # The mean of the dark region is not above 0.
    ratio = bright.mean / dark.mean if dark.mean > 0 else 1 + low
    step = max(spacing(bright), spacing(dark) * ratio) / dark.mean if dark.mean > 0 else 0.0
    # Equal contrasts have no width.
    width = max((high - low) / most, step, 1e-4 * (1 + high))
    first, last = floor((low - ratio + 1) / width + 0.5), ceil((high - ratio + 1) / width - 0.5)
    edges = ratio - 1 + width * (np.arange(first, last + 2, dtype=np.float64) - 0.5)
    return np.append(-1.0, edges[edges > -1]) if edges[0] < -1 else edges


def spacing(region: Distribution) -> float:
    """Mean distance of neighbouring values, weighted by their frequencies; 0 if all are equal."""
    if region.values.size < 2:
        return 0.0
    return float(np.average(np.diff(region.values), weights=np.minimum(region.weights[1:], region.weights[:-1])))


def _given_edges(bins: ArrayLike) -> NDArray[np.float64]:
    edges = numeric_array(bins, "bins").astype(np.float64)
    if edges.ndim != 1 or edges.size == 0 or not np.isfinite(edges).all() or (np.diff(edges) <= 0).any():
        raise InputError("bins are not a rising list of finite contrasts: give edges such as 0, 0.1, 0.2")
    if edges[0] < -1:
        raise InputError(f"bins start at {edges[0]:g}: no contrast is below -1 between values above 0")
    return edges


def _finite_range(bright: Distribution, dark: Distribution) -> tuple[float, float]:
    """Return the ends of the central 99.9 % of the finite contrasts."""
    undefined, bounded = finite_weights(bright, dark)
    if not bounded > undefined:
        raise InputError("no pair has a finite contrast, so there is nothing to bin: check exposure and black level")
    low, high = (
        finite_quantile(bright, dark, undefined + share * (bounded - undefined), 1e-9)
        for share in (CUT_OFF / 2, 1 - CUT_OFF / 2)
    )
    return low, high


#: Upper bound of all relevant finite ratios.
_BEYOND_ALL = 1e300


def finite_weights(bright: Distribution, dark: Distribution) -> tuple[float, float]:
    """Weight of the pairs of undefined contrast, and of these plus those of finite contrast."""
    undefined = weight_not_positive(bright) * weight_not_positive(dark)
    return undefined, weight_up_to(bright, dark, _BEYOND_ALL)


def finite_quantile(bright: Distribution, dark: Distribution, weight: float, precision: float) -> float:
    """Smallest contrast, -1 or more, at which the cumulative weight reaches one between those of `finite_weights`.

    The ratio 1 + contrast is accurate to the relative `precision`.
    """
    at_lowest = weight_up_to(bright, dark, 0.0)
    if at_lowest > 0 and weight <= at_lowest:
        return -1.0
    positive_bright, positive_dark = bright.values[bright.values > 0], dark.values[dark.values > 0]
    # Bracket of the ratio: the upper end reaches the weight, the lower one does not.
    low = float(positive_bright[0]) / float(positive_dark[-1]) * (1 - 1e-12)
    high = min(float(positive_bright[-1]) / float(positive_dark[0]), _BEYOND_ALL)
    while high > low * (1 + precision):
        middle = sqrt(low) * sqrt(high)
        if weight_up_to(bright, dark, middle) >= weight:
            high = middle
        else:
            low = middle
    return high - 1
