"""Medians without sorting."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..compiled import compiled


@compiled
def kth_smallest(values: NDArray[np.float32], k: int) -> float:
    """Return what would be at index `k` if `values`, shape (n,), contiguous and not nan, were sorted.

    Notes
    -----
    Bisection over the floats in the order of their bits, until as many values are below as there shall be: each step
    counts values, which the processor does for several of them at once.
    """
    n = values.size
    bits, keys = values.view(np.int32), np.empty(n, np.int32)
    for i in range(n):
        # The bits of a negative float fall as it rises.
        keys[i] = bits[i] ^ ((bits[i] >> 31) & 0x7FFFFFFF)
    low, high = -(2**31), 2**31 - 1
    one, none, least = np.float32(1), np.float32(0), np.int32(-(2**31))
    while low < high:
        limit = np.int32((low + high) >> 1)
        # Counted in floats, which are as narrow as what is compared; they are exact up to 2**24.
        below = none
        for i in range(n):
            below += one if keys[i] <= limit else none
        if below == k + 1:
            largest = least
            for i in range(n):
                largest = max(largest, keys[i] if keys[i] <= limit else least)
            low = high = int(largest)
        elif below > k:
            high = int(limit)
        else:
            low = int(limit) + 1
    found = np.empty(1, np.int32)
    found[0] = low if low >= 0 else low ^ 0x7FFFFFFF
    return float(found.view(np.float32)[0])


@compiled
def median(values: NDArray[np.float32]) -> float:
    """Return the median of `values`, shape (n,), contiguous, at least one, not nan."""
    half = values.size // 2
    upper = np.float32(kth_smallest(values, half))
    if values.size % 2:
        return float(upper)
    # The one before it is as large, or the largest of the smaller ones if all before it are smaller.
    smaller, largest = 0, np.float32(-np.inf)
    for i in range(values.size):
        if values[i] < upper:
            smaller += 1
            largest = max(largest, values[i])
    return (float(largest if smaller == half else upper) + float(upper)) / 2
