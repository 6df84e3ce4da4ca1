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
    Bisection over the floats in the order of their bits: each of its 32 steps counts values, which the processor does
    for several of them at once.
    """
    bits = values.view(np.int32)
    low, high = -(2**31), 2**31 - 1
    while low < high:
        middle = (low + high) >> 1
        # The bits of a negative float fall as it rises.
        limit = np.int32(middle if middle >= 0 else middle ^ 0x7FFFFFFF)
        below = 0
        if middle >= 0:
            for i in range(bits.size):
                below += bits[i] <= limit
        else:
            for i in range(bits.size):
                below += (bits[i] < 0) & (bits[i] >= limit)
        if below > k:
            high = middle
        else:
            low = middle + 1
    found = np.empty(1, np.int32)
    found[0] = low if low >= 0 else low ^ 0x7FFFFFFF
    return float(found.view(np.float32)[0])


@compiled
def median(values: NDArray[np.float32]) -> float:
    """Return the median of `values`, shape (n,), contiguous, at least one, not nan."""
    half = values.size // 2
    upper = kth_smallest(values, half)
    return upper if values.size % 2 else (kth_smallest(values, half - 1) + upper) / 2
