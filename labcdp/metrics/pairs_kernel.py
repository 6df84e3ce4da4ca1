"""All pairs of pixels of two sorted regions, counted in one merge."""

from __future__ import annotations

from math import inf

import numpy as np
from numpy.typing import NDArray

from ..core.computer import compiled

_Array = NDArray[np.float64]


@compiled
def merge_counts(
    bright_values: _Array,
    bright_cumulative: _Array,
    dark_values: _Array,
    dark_weights: _Array,
    low: float,
    high: float,
    inside_per_dark: _Array,
    inside_per_bright: _Array,
) -> tuple[float, float, float]:
    """Return the numbers of pairs with a ratio of bright to dark value below, inside and above an interval.

    Parameters
    ----------
    bright_values, dark_values : ndarray of float, shape (n,) and (m,)
        Distinct values in rising order.
    bright_cumulative : ndarray of float, shape (n + 1,)
        Number of bright pixels of the first 0, 1, ... n values.
    dark_weights : ndarray of float, shape (m,)
        Number of dark pixels of each value.
    low, high : float
        Ends of the interval, with their tolerance; -inf or inf for an open one (see `pairs.count_pairs`).
    inside_per_dark, inside_per_bright : ndarray of float, shape (m,) and (n,)
        Filled with the shares of the pixels of the other region inside, of each value.
    """
    n, m = bright_values.size, dark_values.size
    n_bright = bright_cumulative[n]
    not_positive = 0
    while not_positive < n and bright_values[not_positive] <= 0:
        not_positive += 1
    below = inside = above = n_dark = 0.0
    first = last = 0
    inside_per_bright[:] = 0
    for j in range(m):
        dark, weight = dark_values[j], dark_weights[j]
        # A bright value above 0 has an unbounded contrast to a dark one of 0 or below.
        level = max(dark, 0.0)
        if low == -inf:
            first = 0 if dark > 0 else not_positive
        else:
            while first < n and bright_values[first] <= level * low:
                first += 1
        if high == inf:
            last = n
        else:
            while last < n and bright_values[last] <= level * high:
                last += 1
        lower, upper = bright_cumulative[first], bright_cumulative[last]
        below += weight * lower
        inside += weight * (upper - lower)
        above += weight * (n_bright - upper)
        n_dark += weight
        inside_per_dark[j] = (upper - lower) / n_bright
        # Each dark value enters at its first bright value inside and leaves after its last one.
        if first < n:
            inside_per_bright[first] += weight
        if last < n:
            inside_per_bright[last] -= weight
    flow = 0.0
    for i in range(n):
        flow += inside_per_bright[i]
        inside_per_bright[i] = flow / n_dark
    return below, inside, above
