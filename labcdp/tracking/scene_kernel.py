"""A frame made small by few of its rows, compiled: see `labcdp.tracking.scene`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..compiled import compiled


@compiled
def deviations(grey: NDArray[np.uint8], rows: int, columns: int, taken: tuple[int, int]) -> NDArray[np.float32]:
    """Means of `rows` x `columns` cells of a frame, less the mean of all of them.

    Parameters
    ----------
    grey : ndarray of uint8, shape (height, width)
        The frame, contiguous, of no fewer rows and columns than cells.
    taken : (int, int)
        Rows and columns of pixels of each cell that are enough; no more than 100 rows, so that sums have room.
    """
    height, width = grey.shape
    means = np.empty((rows, columns), np.float32)
    down, across = max(height // (rows * taken[0]), 1), max(width // (columns * taken[1]), 1)
    sums = np.empty(width, np.uint16)
    # Where each column of cells begins, and how many pixels of a row are taken there.
    starts, n_across = np.empty(columns, np.uint32), np.empty(columns, np.uint32)
    for column in range(columns):
        left, right = column * width // columns, (column + 1) * width // columns
        starts[column], n_across[column] = left, (right - left + across - 1) // across
    whole = 0.0
    for row in range(rows):
        top, bottom = row * height // rows, (row + 1) * height // rows
        sums[:] = 0
        # All of a row is read, as memory gives that as quickly.
        for y in range(top, bottom, down):
            pixels = grey[y]
            for x in range(width):
                sums[x] += pixels[x]
        n_rows = (bottom - top + down - 1) // down
        for column in range(columns):
            x, total = starts[column], np.uint32(0)
            for _ in range(n_across[column]):
                total += sums[x]
                x += np.uint32(across)
            mean = total / (n_rows * n_across[column])
            means[row, column] = mean
            whole += mean
    less = np.float32(whole / (rows * columns))
    for row in range(rows):
        for column in range(columns):
            means[row, column] -= less
    return means
