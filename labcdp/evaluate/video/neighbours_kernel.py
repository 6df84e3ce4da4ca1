"""Marks of neighbouring pixels and their sums, in one pass over an 8-bit image.

Numbers are kept as narrow as they are, so that a loop over bytes goes many at a time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.computer import compiled

#: Pixels of a row that are looked up together, or not at all where they are alike; and whose sums fit in 16 bits.
_PIECE, _RUN = 128, 1024

_Bytes = NDArray[np.uint8]


class Pairs(NamedTuple):
    """Classes of pairs of DN, and which of them each contrast detects.

    Parameters
    ----------
    classes : ndarray of uint8, shape (65536,)
        Class of a pair by 256 times the DN of its first pixel plus that of its second one; 0 if there is no light.
    alike : ndarray of uint8, shape (256,)
        By DN, the least difference at which a pair of this DN or more is of another class than a pair of DN 255.
    ends : ndarray of uint8, shape (k, 2)
        A pair is detected at a contrast if its class is above the first and not above the second.
    """

    classes: _Bytes
    alike: _Bytes
    ends: _Bytes


class Sums(NamedTuple):
    """Sums of the marks of each contrast: how many of the pairs of a pixel are detected, 0 to 2.

    Parameters
    ----------
    lit : ndarray of int64, shape (1,)
        Pairs with light.
    above : ndarray of int64, shape (k,)
        Pairs with a higher contrast.
    near : ndarray of int64, shape (k,)
        Sum of the products of each mark with itself and its eight neighbours.
    mixed : ndarray of int64, shape (k,)
        Sum of the products of each mark with the number of pairs of its pixel and of the eight neighbours.
    rows, columns : ndarray of int64, shape (k, height), and ndarray of uint32, shape (k, width)
        Sums of marks.
    """

    lit: NDArray[np.int64]
    above: NDArray[np.int64]
    near: NDArray[np.int64]
    mixed: NDArray[np.int64]
    rows: NDArray[np.int64]
    columns: NDArray[np.uint32]


@compiled
def sum_marks(dn: _Bytes, pairs: Pairs, sums: Sums) -> None:
    """Classify all pairs, and sum the marks of each contrast.

    Parameters
    ----------
    dn : ndarray of uint8, shape (height, width)
        The image, contiguous, with at least two columns; each pixel has a pair with its right and its lower neighbour.
    pairs : Pairs
        What is looked up.
    sums : Sums
        0 at first; are filled.
    """
    classes, alike, ends = pairs
    height, width = dn.shape
    row, beside, below = np.empty(width + 1, np.uint8), np.zeros(width, np.uint8), np.zeros(width, np.uint8)
    # Marks of this row and the one before, with a pixel of nothing at either end.
    marks = np.zeros((ends.shape[0], 2, width + 2), np.uint8)
    for y in range(height):
        this, other = y % 2, 1 - y % 2
        row[:width], row[width] = dn[y], dn[y, width - 1]
        under = dn[min(y + 1, height - 1)]
        for start in range(0, width, _PIECE):
            stop = min(start + _PIECE, width)
            _classify(row[start : stop + 1], under[start:stop], classes, alike, beside[start:stop], below[start:stop])
        # The last column and the last row have a neighbour less.
        beside[width - 1] = 0
        if y == height - 1:
            below[:] = 0
        for start in range(0, width, _RUN):
            stop = min(start + _RUN, width)
            sums.lit[0] += _count_above(beside[start:stop], below[start:stop], np.uint8(0))
        for n in range(ends.shape[0]):
            low, high, these = ends[n, 0], ends[n, 1], marks[n, this]
            total = np.int64(0)
            for start in range(0, width, _RUN):
                stop = min(start + _RUN, width)
                _mark(beside[start:stop], below[start:stop], low, high, these[start + 1 : stop + 1])
                _add(sums.columns[n, start:stop], these[start + 1 : stop + 1])
                sums.above[n] += _count_above(beside[start:stop], below[start:stop], high)
            for start in range(0, width, _RUN):
                stop = min(start + _RUN, width) + 2
                products, marked = _sum_run(these[start:stop], marks[n, other, start:stop])
                sums.near[n] += np.int64(products)
                total += np.int64(marked)
            sums.rows[n, y] = total
            # Each pixel has nine neighbours, with itself, but at the border; each of these two pairs, but one less at
            # the right and at the lower end.
            across = 3 * total - these[1] - these[width]
            right = across - these[width - 1] - these[width]
            n_rows = 3 - (y == 0) - (y == height - 1)
            sums.mixed[n] += n_rows * (across + right) - (y >= height - 2) * across


@compiled
def _classify(upper: _Bytes, lower: _Bytes, classes: _Bytes, alike: _Bytes, beside: _Bytes, below: _Bytes) -> None:
    """Find the classes of the pairs of a piece of a row; `upper` has a pixel more."""
    least, most = np.uint8(255), np.uint8(0)
    for i in range(lower.size):
        one, right, down = upper[i], upper[i + 1], lower[i]
        least = min(least, min(one, min(right, down)))
        most = max(most, np.uint8(max(one, right) - min(one, right)))
        most = max(most, np.uint8(max(one, down) - min(one, down)))
    if most < alike[least]:
        same = classes[65535]
        # Quicker than slices.
        for i in range(lower.size):
            beside[i], below[i] = same, same
        return
    for i in range(lower.size):
        first = np.uint32(upper[i]) << np.uint32(8)
        beside[i], below[i] = classes[first | np.uint32(upper[i + 1])], classes[first | np.uint32(lower[i])]


@compiled
def _count_above(beside: _Bytes, below: _Bytes, limit: np.uint8) -> np.int64:
    """Count the pairs whose class is above a limit."""
    count = np.uint16(0)
    for i in range(beside.size):
        count = np.uint16(count + np.uint16(np.uint8(beside[i] > limit) + np.uint8(below[i] > limit)))
    return np.int64(count)


@compiled
def _add(columns: NDArray[np.uint32], marks: _Bytes) -> None:
    for i in range(marks.size):
        columns[i] += marks[i]


@compiled
def _mark(beside: _Bytes, below: _Bytes, low: np.uint8, high: np.uint8, marks: _Bytes) -> None:
    """Count, for each pixel of a row, which of its two pairs are detected."""
    for i in range(marks.size):
        marks[i] = np.uint8((beside[i] > low) & (beside[i] <= high)) + np.uint8((below[i] > low) & (below[i] <= high))


@compiled
def _sum_run(row: _Bytes, before: _Bytes) -> tuple[np.uint16, np.uint16]:
    """Sum the products of marks with themselves and, twice, with the neighbours before them; and the marks."""
    products, total = np.uint16(0), np.uint16(0)
    for i in range(row.size - 2):
        mark = row[i + 1]
        around = np.uint8(np.uint8(row[i] + before[i]) + np.uint8(before[i + 1] + before[i + 2]))
        product = np.uint8(mark * np.uint8(mark + np.uint8(around + around)))
        products = np.uint16(products + np.uint16(product))
        total = np.uint16(total + np.uint16(mark))
    return products, total
