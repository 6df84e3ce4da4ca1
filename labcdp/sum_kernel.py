"""Sums in an order that is the same wherever and however they are compiled."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .compiled import compiled


@compiled
def pairwise_sum(values: NDArray[np.floating[Any]]) -> float:
    """Sum by halves, many additions at a time.

    Parameters
    ----------
    values : ndarray of float, shape (n,)
        What is summed; it is written over.

    Returns
    -------
    float
    """
    n = values.size
    while n > 16:
        half = n // 2
        low, high = values[:half], values[n - half : n]
        for i in range(half):
            low[i] += high[i]
        n -= half
    total = 0.0
    for i in range(n):
        total += float(values[i])
    return total
