"""Sums over the marks of neighbouring pixels, strip by strip, and what they leave uncertain."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

#: Rows and columns along the border whose pixels have other neighbours than those inside.
_BORDER = [0, -2, -1]


class MarkSums:
    """Sums of the marks of a contrast: the detected pairs, 0 to 2, of each pixel with its right and lower neighbour.

    Parameters
    ----------
    shape : (int, int)
        Height and width of the image, at least 3 pixels each.
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        height, width = self._shape = shape
        self._rows, self._columns = np.empty(height), np.zeros(width)
        self._last = np.empty((0, width), np.uint8)
        self._ends = np.empty((3, width))
        self._sides = np.empty((height, 3))
        self._squares = self._differences = 0.0

    def add(self, start: int, marks: NDArray[np.uint8]) -> None:
        """Add the marks of the rows from `start` on; strips follow each other. The marks may be overwritten then."""
        import cv2

        n_rows = len(marks)
        self._rows[start : start + n_rows] = cv2.reduce(marks, 1, cv2.REDUCE_SUM, dtype=cv2.CV_32S).ravel()
        self._columns += cv2.reduce(marks, 0, cv2.REDUCE_SUM, dtype=cv2.CV_32S).ravel()
        self._squares += _squares(marks)
        self._differences += _squares(marks[:, 1:], marks[:, :-1])
        for upper, lower in ((self._last, marks[:1]), (marks[:-1], marks[1:])):
            if len(upper):
                self._differences += _squares(lower, upper)
                self._differences += _squares(lower[:, 1:], upper[:, :-1]) + _squares(lower[:, :-1], upper[:, 1:])
        self._sides[start : start + n_rows] = marks[:, _BORDER]
        for place, row in enumerate(range(self._shape[0])[n] for n in _BORDER):
            if start <= row < start + n_rows:
                self._ends[place] = marks[row - start]
        self._last = marks[-1:].copy()

    @property
    def detected(self) -> int:
        """Sum of all marks."""
        return int(self._rows.sum())

    def variance(self, share: float) -> float:
        """Variance of the share of detected pairs, as `labcdp.contrast.neighbour_uncertainty.variance_of_neighbours`.

        With a the marks, p the pairs of each pixel and U the share, its sums of products of a - U p are opened: those
        of a and a are sums of integers, and those with p follow from sums over rows and columns and from the border.
        """
        geometry = _geometry(self._shape)
        near = self._near() - 2 * share * self._near_mixed(geometry) + share**2 * geometry.near
        lines = _lines(self._rows - share * geometry.rows, self._columns - share * geometry.columns) - near
        squares = geometry.n_pairs**2
        return max(
            lines / (squares - geometry.lines), near / (squares - geometry.near), share * (1 - share) / geometry.n_pairs
        )

    def _near(self) -> float:
        """Sum of products with the neighbours from the sums of squares and of squared differences.

        2 a b = a^2 + b^2 - (a - b)^2; each of the four pairs of neighbours counts twice, and the squares of a border
        less often than those inside.
        """
        ends, sides = self._ends[[0, 2]], self._sides[:, [0, 2]]
        border = float(np.square(ends).sum() + np.square(sides).sum())
        corners = float(np.square(ends[:, [0, -1]]).sum())
        return 9 * self._squares - 3 * border + corners - self._differences

    def _near_mixed(self, geometry: _Geometry) -> float:
        """Sum of the products of each pixel's marks with its own and its neighbours' pairs."""
        inner = slice(1, -2)
        return float(
            18 * self._rows.sum()
            + (self._ends * (geometry.around[_BORDER] - 18.0)).sum()
            + (self._sides[inner] * (geometry.around[inner][:, _BORDER] - 18.0)).sum()
        )


class _Geometry:
    """What of the variance depends on the size of the image alone.

    Parameters
    ----------
    shape : (int, int)
        Height and width.
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        import cv2

        height, width = shape
        self.rows, self.columns = np.full(height, 2.0 * width - 1), np.full(width, 2.0 * height - 1)
        self.rows[-1], self.columns[-1] = width - 1, height - 1
        ones = np.full(shape, 2, np.uint8)
        ones[:, -1] -= 1
        ones[-1] -= 1
        #: Pairs of a pixel and of its neighbours, summed: 18 but at the border.
        self.around = np.asarray(cv2.boxFilter(ones, -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT))
        self.n_pairs = float(self.rows.sum())
        self.near = float((self.around * ones.astype(float)).sum())
        self.lines = _lines(self.rows, self.columns) - self.near


@lru_cache(maxsize=2)
def _geometry(shape: tuple[int, int]) -> _Geometry:
    """Geometry of a size, kept for the next frame."""
    return _Geometry(shape)


def _lines(rows: NDArray[np.float64], columns: NDArray[np.float64]) -> float:
    """Sum of products over pairs of pixels in the same or an adjacent row, and in the same or an adjacent column."""
    return float(sum(sums @ sums + 2 * (sums[1:] @ sums[:-1]) for sums in (rows, columns)))


def _squares(one: NDArray[np.uint8], other: NDArray[np.uint8] | None = None) -> float:
    """Sum of the squares of an array, or of its difference to another one."""
    import cv2

    return float(cv2.norm(one, cv2.NORM_L2SQR) if other is None else cv2.norm(one, other, cv2.NORM_L2SQR))
