"""What the summed marks of neighbouring pixels leave uncertain about their share."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

_Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MarkSums:
    """Sums of the marks of a contrast: the detected pairs, 0 to 2, of each pixel with its right and lower neighbour.

    Parameters
    ----------
    near : int
        Sum of the products of each mark with itself and its eight neighbours.
    rows, columns : ndarray of int, shape (height,) and (width,)
        Sums of marks, of at least 3 rows and columns.
    sides : ndarray of int, shape (height, 3)
        Marks of the first, the last but one and the last column.
    """

    near: int
    rows: NDArray[np.int64]
    columns: NDArray[np.uint32]
    sides: NDArray[np.uint8]

    def variance(self, share: float) -> float:
        """Variance of the share of detected pairs, as `labcdp.metrics.neighbours.uncertainty.variance_of_neighbours`.

        With a the marks, p the pairs of each pixel and U the share, its sums of products of a - U p are opened: those
        of a and a are sums of integers, and those with p follow from sums over rows and columns and from the border.
        """
        geometry = _geometry(self.rows.size, self.columns.size)
        near = self.near - 2 * share * self._near_mixed(geometry) + share**2 * geometry.near
        lines = _lines(self.rows - share * geometry.rows, self.columns - share * geometry.columns) - near
        squares = geometry.n_pairs**2
        return max(
            lines / (squares - geometry.lines), near / (squares - geometry.near), share * (1 - share) / geometry.n_pairs
        )

    def _near_mixed(self, geometry: _Geometry) -> float:
        """Sum of the products of each pixel's marks with its own and its neighbours' pairs.

        A pixel has nine neighbours, with itself, but at the border; each has two pairs, but one less at the right and
        at the lower end.
        """
        first, last_but_one, last = self.sides.T.astype(np.float64)
        across = 3 * self.rows - first - last
        pairs = geometry.neighbours_down @ (2 * across - last_but_one - last)
        return float(pairs - across[-2:].sum())


class _Geometry:
    """What of the variance depends on the size of the image alone.

    Parameters
    ----------
    height, width : int
        The size.
    """

    def __init__(self, height: int, width: int) -> None:
        self.rows, self.columns = np.full(height, 2.0 * width - 1), np.full(width, 2.0 * height - 1)
        self.rows[-1], self.columns[-1] = width - 1, height - 1
        #: Rows among each row and the ones above and below it.
        self.neighbours_down = np.full(height, 3.0)
        self.neighbours_down[[0, -1]] = 2
        self.n_pairs = float(self.rows.sum())
        # All pairs are marked where the share is 1.
        sides = np.full((height, 3), 2, np.uint8)
        sides[:, -1] -= 1
        sides[-1] -= 1
        everything = MarkSums(0, self.rows.astype(np.int64), self.columns.astype(np.uint32), sides)
        self.near = everything._near_mixed(self)
        self.lines = _lines(self.rows, self.columns) - self.near


@lru_cache(maxsize=2)
def _geometry(height: int, width: int) -> _Geometry:
    """Geometry of a size, kept for the next frame."""
    return _Geometry(height, width)


def _lines(rows: _Array, columns: _Array) -> float:
    """Sum of products over pairs of pixels in the same or an adjacent row, and in the same or an adjacent column."""
    return float(sum(sums @ sums + 2 * (sums[1:] @ sums[:-1]) for sums in (rows, columns)))
