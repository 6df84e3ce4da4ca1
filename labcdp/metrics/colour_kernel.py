"""Points of a plane within a circle around others, counted with a grid of cells."""

from __future__ import annotations

from math import floor, sqrt

import numpy as np
from numpy.typing import NDArray

from ..core.computer import compiled

_Array = NDArray[np.float64]


@compiled
def counts_within(
    centres: _Array, radius: float, points: _Array, starts: NDArray[np.int64], origin: _Array, cell: float, columns: int
) -> _Array:
    """Return for each centre the number of points within a radius, the circle itself included.

    Parameters
    ----------
    centres : ndarray of float, shape (m, 2)
        Centres of the circles.
    radius : float
        Their radius.
    points : ndarray of float, shape (n, 2)
        The points, in the order of their cells, row by row.
    starts : ndarray of int64, shape (rows * columns + 1,)
        First point of each cell, and the number of points.
    origin : ndarray of float, shape (2,)
        Lower corner of the grid.
    cell : float
        Side of a cell.
    columns : int
        Cells of a row.
    """
    counts = np.zeros(len(centres))
    rows = (len(starts) - 1) // columns
    square = radius * radius
    # Rounding may put a point just outside its cell.
    surely = square * (1 - 1e-9)
    for at in range(len(centres)):
        x, y = centres[at, 0] - origin[0], centres[at, 1] - origin[1]
        total = 0
        for row in range(max(floor((y - radius) / cell) - 1, 0), min(floor((y + radius) / cell) + 2, rows)):
            low, high = row * cell - y, (row + 1) * cell - y
            nearest = low if low > 0 else -high if high < 0 else 0.0
            # A cell more on each side: points may lie just outside theirs.
            width = sqrt(max(square - nearest * nearest, 0.0)) + cell
            first = min(max(floor((x - width) / cell), 0), columns)
            last = min(max(floor((x + width) / cell) + 1, first), columns)
            farthest = max(abs(low), abs(high))
            inner = surely - farthest * farthest
            inner_first, inner_last = last, last
            if inner > 0:
                half = sqrt(inner)
                inner_first = min(max(floor((x - half) / cell) + 1, first), last)
                inner_last = max(min(floor((x + half) / cell), last), inner_first)
                total += starts[row * columns + inner_last] - starts[row * columns + inner_first]
            for begin, end in ((first, inner_first), (inner_last, last)):
                for i in range(starts[row * columns + begin], starts[row * columns + end]):
                    dx, dy = points[i, 0] - centres[at, 0], points[i, 1] - centres[at, 1]
                    if dx * dx + dy * dy <= square:
                        total += 1
        counts[at] = total
    return counts
