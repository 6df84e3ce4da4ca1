"""Sums of the products of pairs of pixels by their lag, compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..compiled import compiled

#: Pixels that all lags are summed for in turn: few enough to stay in the processor's fastest cache.
_BLOCK = 1024


@compiled
def sums_at_lags(values: NDArray[np.float64], down: int, right: int) -> NDArray[np.float64]:
    """Sum the products of all pairs of pixels at the lags below `down` and `right`.

    Parameters
    ----------
    values : ndarray of float, shape (height, width)
        The image.
    down, right : int
        Lags along each axis, from 0, that are asked for.

    Returns
    -------
    ndarray of float, shape (2 down - 1, 2 right - 1)
        Sums in the square of the unit of the values; lag 0 is in the middle.
    """
    height, width = values.shape
    # Zeros between the rows: shifted as one long row, no pixel meets one of a row that it should not meet.
    row = width + right - 1
    n = height * row
    flat = np.zeros(n + 3)
    for y in range(height):
        for x in range(width):
            flat[y * row + x] = values[y, x]
    # Four lags at a time, so that a pixel is read once for them; what goes beyond the last lag is cut off.
    sums = np.zeros((down, 2 * right + 2))
    for start in range(0, n, _BLOCK):
        for dy in range(min(down, height)):
            for first in range(right - 1 if dy == 0 else 0, 2 * right - 1, 4):
                shift = dy * row + first + 1 - right
                size = min(_BLOCK, n - shift - start)
                if size <= 0:
                    continue
                here, there = flat[start : start + size], flat[start + shift : start + shift + size + 3]
                a = b = c = d = 0.0
                for i in range(size):
                    a += here[i] * there[i]
                    b += here[i] * there[i + 1]
                    c += here[i] * there[i + 2]
                    d += here[i] * there[i + 3]
                line = sums[dy]
                line[first] += a
                line[first + 1] += b
                line[first + 2] += c
                line[first + 3] += d
    # Lags of opposite signs have the same sum.
    table = np.empty((2 * down - 1, 2 * right - 1))
    for dy in range(down):
        for place in range(right - 1 if dy == 0 else 0, 2 * right - 1):
            table[down - 1 + dy, place] = sums[dy, place]
            table[down - 1 - dy, 2 * right - 2 - place] = sums[dy, place]
    return table
