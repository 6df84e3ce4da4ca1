"""Count all pairs of dark and bright pixels in a contrast interval without visiting each pair."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf, isfinite
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.computer import LONG, each_in_thread
from ..core.errors import InputError
from .distribution import Distribution, Region, as_distribution, weighted_sum

#: A bright value this close to an end of the interval, relative to it, lies on the end. The end (factor times dark
#: value) is known to three roundings, 3 * 2^-53, so no pair that lies on it in exact arithmetic is missed. No other
#: pair of integers is included as long as the largest integer times the denominator of the factor stays below 2^52 / 10
#: = 4.5e14, because bright value and end then differ by more than 10 * 2^-52, relatively. That covers 24-bit data with
#: ends of up to 7 decimals, 16-bit data with 9.
RELATIVE_TOLERANCE = 8 * 2.0**-52

_Array: TypeAlias = NDArray[np.float64]
#: Dark values processed at once, so that temporary arrays fit in the processor's cache.
_BLOCK = 16384


def bright_and_dark(
    a: Region, b: Region, names: tuple[str, str] = ("region a", "region b")
) -> tuple[Distribution, Distribution, Literal["a", "b"]]:
    """Return the brighter region, the darker one, and the name of the brighter one.

    The bright region has the larger mean, or is `a` if the means are equal; `names` are those of `a` and `b` in
    messages.

    Raises
    ------
    InputError
        If a region cannot be used, or neither holds a value above 0.
    """
    # Values of up to 16 bits are not sorted; counting them is too fast to benefit from a thread.
    regions = [region for region in (a, b) if isinstance(region, np.ndarray)]
    sizes = [region.size for region in regions if region.dtype.kind == "f" or region.dtype.itemsize > 2]
    first, second = each_in_thread(
        lambda named: as_distribution(*named), list(zip((a, b), names, strict=True)), max(sizes, default=0)
    )
    if max(first.values[-1], second.values[-1]) <= 0:
        raise InputError(
            "neither region holds a value above 0, so no contrast is defined: check exposure and black level"
        )
    if second.mean > first.mean:
        return second, first, "b"
    return first, second, "a"


def weight_up_to(bright: Distribution, dark: Distribution, ratio: float) -> float:
    """Weight of all pairs up to a ratio (0 or more) of bright to dark value, including those of undefined contrast."""
    total = 0.0
    for block, start, counts in _counts_up_to(bright, dark.values, ratio * (1 + RELATIVE_TOLERANCE)):
        total += _sum(_weight_of_first(bright, start, counts), None if dark.each_once else dark.weights[block])
    return total


def count_pairs(bright: Distribution, dark: Distribution, ratios: tuple[float, float]) -> tuple[_Array, _Array, _Array]:
    """Classify all pairs by the lowest and highest ratio, both included, of bright to dark value.

    Parameters
    ----------
    bright, dark : Distribution
        The regions.
    ratios : (float, float)
        0 or more; -inf or inf for an open end (see `contrast.detected_ratios`).

    Returns
    -------
    shares : ndarray of float, shape (3,)
        Shares of the pairs with a ratio below, inside and above the interval. Undefined pairs are below.
    inside_per_dark : ndarray of float, shape (m,)
        For each distinct dark value, share of the bright pixels inside.
    inside_per_bright : ndarray of float, shape (n,)
        For each distinct bright value, share of the dark pixels inside.
    """
    n = dark.values.size
    # Each part takes a thread.
    parts = [slice(0, n // 2), slice(n // 2, n)] if n >= LONG else [slice(0, n)]
    counts = each_in_thread(lambda part: _count_part(bright, dark, part, ratios), parts, n)
    weights, per_dark, flow = (list(arrays) for arrays in zip(*counts, strict=True))
    inside_per_dark = np.concatenate(per_dark)
    inside_per_dark /= bright.total
    for other in flow[1:]:
        flow[0] += other
    inside_per_bright = np.cumsum(flow[0][:-1], out=flow[0][:-1])
    inside_per_bright /= dark.total
    return np.sum(weights, axis=0) / (bright.total * dark.total), inside_per_dark, inside_per_bright


def share_inside(bright: Distribution, dark: Distribution, ratios: tuple[float, float]) -> float:
    """Share of the pairs with a ratio inside an interval, as `count_pairs`."""
    return float(count_pairs(bright, dark, ratios)[0][1])


def _count_part(
    bright: Distribution, dark: Distribution, part: slice, ratios: tuple[float, float]
) -> tuple[_Array, _Array, _Array]:
    """Weights of the pairs of some dark values below, inside and above, as `count_pairs`.

    The last array holds the increments of the weight inside from each bright value to the next.
    """
    values, weights = dark.values[part], dark.weights[part]
    low, high = ratios
    if low == -inf:
        lower_counts = _undefined_counts(bright, values)
    else:
        lower_counts = _counts_up_to(bright, values, low * (1 - RELATIVE_TOLERANCE))
    upper_counts = _counts_up_to(bright, values, high * (1 + RELATIVE_TOLERANCE))
    below = inside = above = 0.0
    inside_per_dark = np.empty(values.size)
    # Each dark value enters at its first bright value inside and leaves after its last one.
    flow = np.zeros(bright.values.size + 1)
    for (block, enter, first), (_, leave, last) in zip(lower_counts, upper_counts, strict=True):
        below_each = _weight_of_first(bright, enter, first)
        up_to_each = _weight_of_first(bright, leave, last)
        inside_each = np.subtract(up_to_each, below_each, out=inside_per_dark[block])
        block_weights = None if dark.each_once else weights[block]
        below += _sum(below_each, block_weights)
        inside += _sum(inside_each, block_weights)
        above += _sum(bright.total - up_to_each, block_weights)
        entering, leaving = np.bincount(first, block_weights), np.bincount(last, block_weights)
        flow[enter : enter + entering.size] += entering
        flow[leave : leave + leaving.size] -= leaving
    return np.array((below, inside, above)), inside_per_dark, flow


def _weight_of_first(distribution: Distribution, start: int, counts: NDArray[np.intp]) -> NDArray[np.float64]:
    """Weight of the first `start` + `counts` values of a distribution."""
    if distribution.each_once:
        return np.add(counts, float(start))
    return distribution.cumulative[start:][counts]


def _sum(values: NDArray[np.float64], weights: NDArray[np.float64] | None) -> float:
    return float(values.sum()) if weights is None else weighted_sum(weights, values)


def _undefined_counts(
    bright: Distribution, dark_values: NDArray[np.float64]
) -> Iterator[tuple[slice, int, NDArray[np.intp]]]:
    """Count the distinct bright values each dark one has an undefined contrast to; yields as `_counts_up_to`."""
    not_positive = np.searchsorted(bright.values, 0, side="right")
    for begin in range(0, dark_values.size, _BLOCK):
        block = slice(begin, begin + _BLOCK)
        yield block, 0, np.where(dark_values[block] > 0, 0, not_positive)


def _counts_up_to(
    bright: Distribution, dark_values: NDArray[np.float64], factor: float
) -> Iterator[tuple[slice, int, NDArray[np.intp]]]:
    """Count, for each dark value, the distinct bright values of at most `factor` (0 or more) times the dark one.

    Where the dark value is 0 or below, bright values up to 0 are counted: each bright value above 0 has an unbounded
    contrast to it. An infinite factor counts every bright value.

    Yields
    ------
    block : slice
        Indices of the dark values.
    start : int
        Count for the last dark value before the block, a lower bound of all in the block.
    counts : ndarray of int
        Count for each dark value of the block, less `start`.
    """
    start = 0
    for begin in range(0, dark_values.size, _BLOCK):
        block = slice(begin, begin + _BLOCK)
        with np.errstate(over="ignore"):
            limits = np.maximum(dark_values[block], 0 if isfinite(factor) else 1) * factor
        stop = int(bright.values.searchsorted(limits[-1], side="right"))
        yield block, start, bright.values[start:stop].searchsorted(limits, side="right")
        start = stop
