"""Marks of neighbouring pixels and their sums, in one pass over an 8-bit image.

Numbers are kept as narrow as they are: a loop over bytes goes many at a time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..compiled import compiled

#: Pixels of a row that are looked at together: where they are all alike, no pair has to be looked up.
_PIECE = 128


@compiled
def sum_marks(
    dn: NDArray[np.uint8],
    classes: NDArray[np.uint8],
    alike: NDArray[np.uint8],
    places: NDArray[np.uint8],
    counts: NDArray[np.int64],
    near: NDArray[np.int64],
    rows: NDArray[np.int64],
    columns: NDArray[np.uint32],
    sides: NDArray[np.uint8],
) -> None:
    """Count the classes of all pairs, and sum the marks of each contrast: how many of a pixel's pairs are inside, 0..2.

    Parameters
    ----------
    dn : ndarray of uint8, shape (height, width)
        The image, contiguous, with at least two columns; each pixel has a pair with its right and its lower neighbour.
    classes : ndarray of uint8, shape (65536,)
        Class of a pair by 256 times the DN of its first pixel plus that of its second one; below n, and below 255.
    alike : ndarray of uint8, shape (256,)
        By DN, the least difference at which a pair of this DN or more is of another class than a pair of DN 255.
    places : ndarray of uint8, shape (k, 2)
        A pair is inside for a contrast if its class is above the first and not above the second.
    counts : ndarray of int64, shape (n,)
        0 at first; returns how many pairs are above each class.
    near : ndarray of int64, shape (k,)
        0 at first; returns the sum of the products of each mark with itself and its eight neighbours.
    rows, columns : ndarray of int64, shape (k, height), and ndarray of uint32, shape (k, width)
        0 at first; return the sums of marks.
    sides : ndarray of uint8, shape (k, height, 3)
        Returns the marks of the first, the last but one and the last column.
    """
    height, width = dn.shape
    n_pieces = (width + _PIECE - 1) // _PIECE
    beside, below = np.zeros(_PIECE, np.uint8), np.zeros(_PIECE, np.uint8)
    # Marks of this row and the one before, with a pixel of nothing at either end, and which pieces hold any.
    marks = np.zeros((places.shape[0], 2, n_pieces * _PIECE + 2), np.uint8)
    marked = np.zeros((places.shape[0], 2, n_pieces), np.bool_)
    for y in range(height):
        this, other = y % 2, 1 - y % 2
        upper, lower = dn[y], dn[min(y + 1, height - 1)]
        for piece in range(n_pieces):
            start = piece * _PIECE
            stop = min(start + _PIECE, width)
            # Neither the last column nor the last row has a neighbour.
            n_beside, n_below = min(stop, width - 1) - start, stop - start if y < height - 1 else 0
            least, change = _change(upper[start:stop], upper[start + 1 : stop + 1], lower[start:stop])
            if change < alike[least]:
                lowest = highest = classes[65535]
                beside[:n_beside], below[:n_below] = lowest, lowest
            else:
                _look_up(upper[start:], upper[start + 1 : start + 1 + n_beside], classes, beside)
                _look_up(upper[start:], lower[start : start + n_below], classes, below)
                lowest, highest = _range(beside[:n_beside], below[:n_below])
            for one in range(lowest):
                counts[one] += n_beside + n_below
            for one in range(lowest, highest):
                counts[one] += _above(beside[:n_beside], np.uint8(one)) + _above(below[:n_below], np.uint8(one))
            # What is no pair is inside for no contrast.
            beside[n_beside:], below[n_below:] = 255, 255
            for n in range(places.shape[0]):
                low, high = places[n]
                if highest > low and lowest <= high:
                    marked[n, this, piece] = True
                    _mark(beside, below, low, high, marks[n, this, start + 1 : start + _PIECE + 1])
                elif marked[n, this, piece]:
                    marked[n, this, piece] = False
                    marks[n, this, start + 1 : start + _PIECE + 1] = 0
        for n in range(places.shape[0]):
            row, before = marks[n, this], marks[n, other]
            for piece in range(n_pieces):
                if marked[n, this, piece]:
                    start = piece * _PIECE
                    near[n] += _products(row[start : start + _PIECE + 2], before[start : start + _PIECE + 2])
                    rows[n, y] += _add_to(columns[n, start : start + _PIECE], row[start + 1 :])
            sides[n, y, 0], sides[n, y, 1], sides[n, y, 2] = row[1], row[width - 1], row[width]


@compiled
def _change(upper: NDArray[np.uint8], beside: NDArray[np.uint8], lower: NDArray[np.uint8]) -> tuple[np.uint8, np.uint8]:
    """Lowest DN of a piece and its neighbours, and the most by which two of a pair differ."""
    least, most = np.uint8(255), np.uint8(0)
    for i in range(beside.size):
        least = min(least, min(upper[i], beside[i]))
        most = max(most, np.uint8(max(upper[i], beside[i]) - min(upper[i], beside[i])))
    for i in range(lower.size):
        least = min(least, min(upper[i], lower[i]))
        most = max(most, np.uint8(max(upper[i], lower[i]) - min(upper[i], lower[i])))
    return least, most


@compiled
def _look_up(
    first: NDArray[np.uint8], second: NDArray[np.uint8], classes: NDArray[np.uint8], found: NDArray[np.uint8]
) -> None:
    """Look up the classes of pairs."""
    for i in range(second.size):
        found[i] = classes[np.uint32(first[i]) << np.uint32(8) | np.uint32(second[i])]


@compiled
def _range(beside: NDArray[np.uint8], below: NDArray[np.uint8]) -> tuple[np.uint8, np.uint8]:
    """Lowest and highest class."""
    lowest, highest = np.uint8(255), np.uint8(0)
    for i in range(beside.size):
        lowest, highest = min(lowest, beside[i]), max(highest, beside[i])
    for i in range(below.size):
        lowest, highest = min(lowest, below[i]), max(highest, below[i])
    return lowest, highest


@compiled
def _above(classes: NDArray[np.uint8], one: np.uint8) -> np.uint32:
    """Count what is above a class."""
    n = np.uint32(0)
    for i in range(classes.size):
        n = np.uint32(n + np.uint32(classes[i] > one))
    return n


@compiled
def _mark(
    beside: NDArray[np.uint8], below: NDArray[np.uint8], low: np.uint8, high: np.uint8, marks: NDArray[np.uint8]
) -> None:
    """Count, for each pixel of a piece, which of its two pairs are inside."""
    for i in range(_PIECE):
        marks[i] = np.uint8((beside[i] > low) & (beside[i] <= high)) + np.uint8((below[i] > low) & (below[i] <= high))


@compiled
def _products(row: NDArray[np.uint8], before: NDArray[np.uint8]) -> np.uint16:
    """Sum of the products of the marks of a piece with themselves and, twice, with the neighbours before them."""
    total = np.uint16(0)
    for i in range(_PIECE):
        mark = np.uint16(row[i + 1])
        around = np.uint16(row[i]) + np.uint16(before[i]) + np.uint16(before[i + 1]) + np.uint16(before[i + 2])
        total = np.uint16(total + np.uint16(mark * np.uint16(mark + np.uint16(2) * np.uint16(around))))
    return total


@compiled
def _add_to(columns: NDArray[np.uint32], marks: NDArray[np.uint8]) -> np.uint32:
    """Add the marks of a piece to the sums of columns, and return their sum."""
    total = np.uint32(0)
    for i in range(columns.size):
        mark = np.uint32(marks[i])
        columns[i] = np.uint32(columns[i] + mark)
        total = np.uint32(total + mark)
    return total
