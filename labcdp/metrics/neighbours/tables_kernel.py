"""Marks of neighbouring pixels and their sums, in one pass over an 8-bit image.

Numbers are kept as narrow as they are and pieces of rows of one length, which the compiler knows: a loop over bytes
goes many at a time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.computer import compiled, compiled_part

#: Pixels of a row that are processed together: where all are equal, no pair needs a look-up.
_PIECE = 128
#: Pixels whose products of marks are summed in 16 bits, a multiple of those, and rows whose marks are in 8 bits.
_RUN, _ROWS = 1024, 120


class Pairs(NamedTuple):
    """Classes of pairs of DN, and the classes inside the interval of each contrast.

    Parameters
    ----------
    classes : ndarray of uint8, shape (65536,)
        Class of a pair by 256 times the DN of its first pixel plus that of its second one; below n, and below 255.
    alike : ndarray of uint8, shape (256,)
        By DN, the least difference at which a pair of this DN or more is of another class than a pair of DN 255.
    places : ndarray of uint8, shape (k, 2)
        A pair is inside for a contrast if its class is above the first and not above the second.
    """

    classes: NDArray[np.uint8]
    alike: NDArray[np.uint8]
    places: NDArray[np.uint8]


class Sums(NamedTuple):
    """Sums of the marks of each contrast: how many of a pixel's pairs are inside, 0 to 2.

    Parameters
    ----------
    counts : ndarray of int64, shape (n,)
        Number of pairs above each class.
    near : ndarray of int64, shape (k,)
        Sum of the products of each mark with itself and its eight neighbours.
    rows, columns : ndarray of int64, shape (k, height), and ndarray of uint32, shape (k, width)
        Sums of marks.
    sides : ndarray of uint8, shape (k, height, 3)
        Marks of the first, the last but one and the last column.
    """

    counts: NDArray[np.int64]
    near: NDArray[np.int64]
    rows: NDArray[np.int64]
    columns: NDArray[np.uint32]
    sides: NDArray[np.uint8]


@compiled
def sum_marks(dn: NDArray[np.uint8], pairs: Pairs, sums: Sums) -> None:
    """Count the classes of all pairs, and sum the marks of each contrast.

    Parameters
    ----------
    dn : ndarray of uint8, shape (height, width)
        The image, contiguous, with at least two columns; each pixel has a pair with its right and its lower neighbour.
    pairs : Pairs
        Classes of pairs, and the classes inside each interval.
    sums : Sums
        0 at first; are filled.
    """
    (classes, alike, places), counts = pairs, sums.counts  # once: each access counts a reference
    height, width = dn.shape
    n_pieces, n_contrasts = (width + _PIECE - 1) // _PIECE, places.shape[0]
    same, n_alike = classes[65535], 0
    padded = n_pieces * _PIECE
    beside, below = np.zeros(_PIECE, np.uint8), np.zeros(_PIECE, np.uint8)
    # Marks of this row and the one before, with a pixel of nothing at either end, and which pieces hold any.
    marks = np.zeros((n_contrasts, 2, padded + 2), np.uint8)
    marked = np.zeros((n_contrasts, 2, n_pieces), np.bool_)
    some_rows = np.zeros((n_contrasts, padded), np.uint8)
    # This row and the next one, the last pixel repeated.
    rows_of_dn = np.empty((2, padded + 1), np.uint8)
    _repeat_last(dn[0], rows_of_dn[0])
    for y in range(height):
        this, other = y % 2, 1 - y % 2
        _repeat_last(dn[min(y + 1, height - 1)], rows_of_dn[other])
        for piece in range(n_pieces):
            start, stop = piece * _PIECE, min((piece + 1) * _PIECE, width)
            # The last column and the last row have a neighbour less.
            n_beside, n_below = min(stop, width - 1) - start, stop - start if y < height - 1 else 0
            upper, lower = rows_of_dn[this, start : start + _PIECE + 1], rows_of_dn[other, start : start + _PIECE]
            least, change = _change(upper, lower)
            empty = change < alike[least]
            if empty:
                lowest = highest = same
                n_alike += n_beside + n_below
            else:
                _look_up(upper, upper[1:], classes, beside)
                _look_up(upper, lower, classes, below)
                _end(beside, below, n_beside, n_below)
                lowest, highest = _count(beside, below, counts)
            for n in range(n_contrasts):
                low, high = places[n, 0], places[n, 1]
                if highest > low and lowest <= high:
                    marked[n, this, piece] = True
                    if empty:
                        _fill(beside, below, same, n_beside, n_below)
                        empty = False
                    _mark(beside, below, low, high, marks[n, this, start + 1 : start + _PIECE + 1])
                elif marked[n, this, piece]:
                    marked[n, this, piece] = False
                    _clear(marks[n, this, start + 1 : start + _PIECE + 1])
        _sum_rows(y, width, marks, marked, some_rows, sums)
        if y % _ROWS == _ROWS - 1 or y == height - 1:
            _move(some_rows, sums.columns)
    for value in range(same):
        counts[value] += n_alike


@compiled_part
def _move(some_rows: NDArray[np.uint8], columns: NDArray[np.uint32]) -> None:
    """Add the sums of some rows to those of columns, and make them 0."""
    # Compiled in half of the time that slices take, whose shapes may not fit.
    for n in range(columns.shape[0]):
        for x in range(columns.shape[1]):
            columns[n, x] += some_rows[n, x]
            some_rows[n, x] = 0


@compiled_part
def _fill(beside: NDArray[np.uint8], below: NDArray[np.uint8], same: np.uint8, n_beside: int, n_below: int) -> None:
    """Make all pairs of a piece of one class; what is no pair is of class 0."""
    # Quicker than slices.
    for i in range(_PIECE):
        beside[i], below[i] = same, same
    _end(beside, below, n_beside, n_below)


@compiled_part
def _clear(marks: NDArray[np.uint8]) -> None:
    for i in range(_PIECE):
        marks[i] = 0


@compiled_part
def _end(beside: NDArray[np.uint8], below: NDArray[np.uint8], n_beside: int, n_below: int) -> None:
    for i in range(n_beside, _PIECE):
        beside[i] = 0
    for i in range(n_below, _PIECE):
        below[i] = 0


@compiled_part
def _sum_rows(
    y: int, width: int, marks: NDArray[np.uint8], marked: NDArray[np.bool_], columns: NDArray[np.uint8], sums: Sums
) -> None:
    """Add what the marks of a row give for each contrast."""
    this, other = y % 2, 1 - y % 2
    for n in range(marks.shape[0]):
        row = marks[n, this]
        near, total = _sum_row(row, marks[n, other], marked[n, this], columns[n])
        sums.near[n] += near
        sums.rows[n, y] = total
        sums.sides[n, y, 0], sums.sides[n, y, 1], sums.sides[n, y, 2] = row[1], row[width - 1], row[width]


@compiled_part
def _sum_row(
    row: NDArray[np.uint8], before: NDArray[np.uint8], marked: NDArray[np.bool_], columns: NDArray[np.uint8]
) -> tuple[np.int64, np.int64]:
    """Sum products and marks of a row, run by run of pieces that hold any."""
    near, total_of_row, first = np.int64(0), np.int64(0), 0
    while first < marked.size:
        last = first
        while last < marked.size and marked[last] and (last - first) * _PIECE < _RUN:
            last += 1
        if last > first:
            start, stop = first * _PIECE, last * _PIECE
            products, total = _sum_run(row[start : stop + 2], before[start : stop + 2], columns[start:stop])
            near += np.int64(products)
            total_of_row += np.int64(total)
        first = max(last, first + 1)
    return near, total_of_row


@compiled_part
def _repeat_last(row: NDArray[np.uint8], longer: NDArray[np.uint8]) -> None:
    """Copy a row into a longer one, whose rest is its last pixel."""
    # Quicker than slices.
    for i in range(row.size):
        longer[i] = row[i]
    for i in range(row.size, longer.size):
        longer[i] = row[row.size - 1]


@compiled_part
def _change(upper: NDArray[np.uint8], lower: NDArray[np.uint8]) -> tuple[np.uint8, np.uint8]:
    """Lowest DN of a piece and its neighbours, and the most by which two of a pair differ."""
    least, most = np.uint8(255), np.uint8(0)
    for i in range(_PIECE):
        here, right, down = upper[i], upper[i + 1], lower[i]
        least = min(least, min(here, min(right, down)))
        beside = np.uint8(max(here, right) - min(here, right))
        below = np.uint8(max(here, down) - min(here, down))
        most = max(most, max(beside, below))
    return least, most


@compiled_part
def _look_up(
    first: NDArray[np.uint8], second: NDArray[np.uint8], classes: NDArray[np.uint8], classes_found: NDArray[np.uint8]
) -> None:
    """Look up the classes of the pairs of a piece."""
    for i in range(_PIECE):
        classes_found[i] = classes[np.uint32(first[i]) << np.uint32(8) | np.uint32(second[i])]


@compiled_part
def _count(beside: NDArray[np.uint8], below: NDArray[np.uint8], counts: NDArray[np.int64]) -> tuple[np.uint8, np.uint8]:
    """Count the pairs of a piece above each class; its lowest and highest class."""
    lowest, highest = np.uint8(255), np.uint8(0)
    for i in range(_PIECE):
        lowest = min(lowest, min(beside[i], below[i]))
        highest = max(highest, max(beside[i], below[i]))
    for value in range(lowest):
        counts[value] += 2 * _PIECE
    for value in range(lowest, highest):
        n, limit = np.uint16(0), np.uint8(value)
        for i in range(_PIECE):
            n = np.uint16(n + np.uint16(np.uint8(beside[i] > limit) + np.uint8(below[i] > limit)))
        counts[value] += n
    return lowest, highest


@compiled_part
def _mark(
    beside: NDArray[np.uint8], below: NDArray[np.uint8], low: np.uint8, high: np.uint8, marks: NDArray[np.uint8]
) -> None:
    """Count, for each pixel of a piece, which of its two pairs are inside."""
    for i in range(_PIECE):
        marks[i] = np.uint8((beside[i] > low) & (beside[i] <= high)) + np.uint8((below[i] > low) & (below[i] <= high))


@compiled_part
def _sum_run(
    row: NDArray[np.uint8], before: NDArray[np.uint8], columns: NDArray[np.uint8]
) -> tuple[np.uint16, np.uint16]:
    """Sum the products of marks with themselves and, twice, with the neighbours before them; and the marks."""
    products, total = np.uint16(0), np.uint16(0)
    for i in range(columns.size):
        mark = row[i + 1]
        around = np.uint8(np.uint8(row[i] + before[i]) + np.uint8(before[i + 1] + before[i + 2]))
        product = np.uint8(mark * np.uint8(mark + np.uint8(around + around)))
        products = np.uint16(products + np.uint16(product))
        total = np.uint16(total + np.uint16(mark))
        columns[i] = np.uint8(columns[i] + mark)
    return products, total
