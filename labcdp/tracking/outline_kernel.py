"""Heights of edges part by part, compiled: see `labcdp.tracking.outline`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..compiled import compiled
from .select_kernel import kth_smallest


@compiled
def sum_edges(
    values: NDArray[np.float32], agrees: NDArray[np.float32], columns: int, near: NDArray[np.int64],
    parts: NDArray[np.int64], slopes: NDArray[np.float32], sums: NDArray[np.float64],
) -> None:  # fmt: skip
    """Add up the products of the gradients of a view with those of the template.

    Parameters
    ----------
    values, agrees : ndarray of float32, shape (n,)
        The view under each template pixel, row by row; nan where one lies outside the image.
    columns : int
        Pixels of a row.
    near, parts : ndarray of int64, shape (k,)
        Pixels that are looked at, and the part each belongs to.
    slopes : ndarray of float32, shape (2, k)
        Gradients of the template there, along x and y.
    sums : ndarray of float64, shape (p,)
        0 at first; returns the sum of each part, nan if any of it lies outside.
    """
    last = values.size // columns - 1
    for k in range(near.size):
        pixel = near[k]
        x, y = pixel % columns, pixel // columns
        # Central differences, one-sided at the ends.
        left, right = max(x - 1, 0), min(x + 1, columns - 1)
        above, below = max(y - 1, 0), min(y + 1, last)
        along = (values[y * columns + right] - values[y * columns + left]) / (right - left)
        down = (values[below * columns + x] - values[above * columns + x]) / (below - above)
        if np.isnan(agrees[pixel]):
            sums[parts[k]] = np.nan
        sums[parts[k]] += along * slopes[0, k] + down * slopes[1, k]


@compiled
def share_gone(
    kept: NDArray[np.float32], length: NDArray[np.float64], part: float, highest: float, dimmest: float
) -> float:
    """Share of an outline whose edges are below `part` of their usual height, but for light that went.

    Parameters
    ----------
    kept : ndarray of float32, shape (k,)
        Height of each part over the usual one; at least one.
    length : ndarray of float64, shape (k,)
        Length of each part.
    highest, dimmest : float
        Quantile of `kept` that tells how much light there is, and the least light.
    """
    at = highest * (kept.size - 1)
    below = int(at)
    low = kth_smallest(kept, below)
    high = kth_smallest(kept, min(below + 1, kept.size - 1))
    light = min(max(low + (at - below) * (high - low), dimmest), 1.0)
    gone = whole = 0.0
    for k in range(kept.size):
        whole += length[k]
        if kept[k] < part * light:
            gone += length[k]
    return gone / whole
