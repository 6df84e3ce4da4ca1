"""CDP from pixel to pixel of 8-bit frames, at the speed of a video."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import nan, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..contrast import Epsilon, NeighbourCdp
from ..contrast.interval import AskedContrast
from ..contrast.neighbour_uncertainty import FEWEST_LINES
from ..contrast.pairs import RELATIVE_TOLERANCE
from ..contrast.uncertainty import confidence_interval
from ..errors import InputError

#: Contrasts at once: each has two ends, and a class has one byte.
_MOST_CONTRASTS = 120
#: Up to so many classes are counted one by one, which is then faster than all at once.
_FEW_PLACES = 7
#: Pixels of a strip.
_STRIP = 2**19


class NeighbourTables:
    """CDP from pixel to pixel where the light of a pixel follows from its DN alone.

    There are 2^16 pairs of DN, so that it is known beforehand between which of all ends of the intervals the contrast
    of a pair lies: one look-up a pair, whatever the number of contrasts. All sums are those of integers; results are
    those of `labcdp.contrast.cdp_neighbours_range` to the rounding of its floats.

    Parameters
    ----------
    light : ndarray of float, shape (256,)
        Light by DN.
    contrasts : sequence of float
        Contrasts, up to 120.
    epsilon : float or DetectionInterval
        Their tolerance.

    Raises
    ------
    InputError
        If a contrast or the tolerance is out of range, there are too many, or a light is not finite.
    """

    def __init__(self, light: NDArray[np.floating[Any]], contrasts: Sequence[float], epsilon: Epsilon) -> None:
        if len(contrasts) > _MOST_CONTRASTS:
            raise InputError(f"{len(contrasts)} contrasts are given: give up to {_MOST_CONTRASTS}")
        if not np.isfinite(light).all():
            raise InputError("the light of a DN is not finite: check calibration or camera specification")
        self._asked = [AskedContrast(contrast, epsilon, "weber") for contrast in contrasts]
        self._lit = np.asarray(light, dtype=float) > 0
        ends = [
            (
                0.0 if one.low is None else float(1 + one.low) * (1 - RELATIVE_TOLERANCE),
                np.inf if one.high is None else float(1 + one.high) * (1 + RELATIVE_TOLERANCE),
            )
            for one in self._asked
        ]
        # Class 0 is that of pairs without light; a pair of class c exceeds the first c - 1 ends.
        finite = sorted({end for pair in ends for end in pair if 0 < end < np.inf})
        place = {0.0: 0, **{end: n for n, end in enumerate(finite, start=1)}, np.inf: len(finite) + 1}
        self._classes = [(place[low] + 1, place[high]) for low, high in ends]
        self._table = _class_table(np.asarray(light, dtype=float), finite)
        #: Classes below which pairs are counted.
        self._places = sorted({1, *(low for low, _ in self._classes), *(high + 1 for _, high in self._classes)})
        self._local = threading.local()
        self._n_bins = next(n for n in (64, 128, 256) if n > len(finite) + 1)
        self._turns = np.arange(0, 256, self._n_bins, dtype=np.uint8)

    def evaluate(self, dn: NDArray[np.uint8]) -> tuple[NeighbourCdp, ...]:
        """Evaluate a frame.

        Parameters
        ----------
        dn : ndarray of uint8, shape (height, width)
            The frame.

        Returns
        -------
        tuple of NeighbourCdp
            One for each contrast.

        Raises
        ------
        InputError
            If it has fewer than two pixels, or none with light.
        """
        if dn.size < 2:
            raise InputError(f"the image holds {dn.size} pixels: give at least two, or there is no neighbour")
        shape = (dn.shape[0], dn.shape[1])
        kept = self._kept(shape)
        below = dict.fromkeys(self._places, 0)
        for rows in _strips(shape):
            for place, count in self._classify(dn, rows, kept).items():
                below[place] += count
        n_pairs = kept.right.size + kept.below.size
        if below[1] == n_pairs:
            raise InputError(
                "the image holds no value above 0, so no contrast is defined: check exposure and black level"
            )
        return tuple(
            self._result(asked, low, high, below, kept)
            for asked, (low, high) in zip(self._asked, self._classes, strict=True)
        )

    def _kept(self, shape: tuple[int, int]) -> _Buffers:
        """Memory of this thread, used again for each frame: to get it anew takes as long as all the rest."""
        found = getattr(self._local, "buffers", None)
        if found is None or found.marks.shape != shape:
            found = self._local.buffers = _Buffers.of(shape)
        return found

    def _classify(self, dn: NDArray[np.uint8], rows: slice, kept: _Buffers) -> dict[int, int]:
        """Find the classes of the pairs that begin in some rows, and how many lie below each class asked for."""
        import cv2

        below = dict.fromkeys(self._places, 0)
        height = dn.shape[0]
        with_next = slice(rows.start, min(rows.stop, height - 1))
        for first, second, classes in (
            (dn[rows, :-1], dn[rows, 1:], kept.right[rows]),
            (dn[with_next], dn[with_next.start + 1 : with_next.stop + 1], kept.below[with_next]),
        ):
            if classes.size:
                pairs = cv2.merge([first, second]).view("<u2")[..., 0]
                cv2.LUT(pairs, self._table, classes)
                for place, count in self._counted(classes).items():
                    below[place] += count
        return below

    def _counted(self, classes: NDArray[np.uint8]) -> dict[int, int]:
        """Count the pairs below each class asked for."""
        import cv2

        if len(self._places) <= _FEW_PLACES:
            return {place: cv2.countNonZero(cv2.compare(classes, place, cv2.CMP_LT)) for place in self._places}
        # Most pairs are of one class: a processor counts several bins in turn much faster than one.
        spread = classes + np.resize(self._turns, classes.shape[1])
        counts = cv2.calcHist([spread], [0], None, [256], [0, 256]).reshape(-1, self._n_bins).sum(axis=0, dtype=float)
        summed = np.concatenate([[0], np.cumsum(counts)])
        return {place: round(summed[place]) for place in self._places}

    def _result(
        self,
        asked: AskedContrast,
        low: int,
        high: int,
        below: Mapping[int, int],
        kept: _Buffers,
    ) -> NeighbourCdp:
        pairs, n_below, up_to = kept.right.size + kept.below.size, below[low], below[high + 1]
        cdp = (up_to - n_below) / pairs
        variance = nan
        if min(kept.marks.shape) >= FEWEST_LINES:
            variance = _variance(_Sums.of(kept, low, high), cdp) if 0 < cdp < 1 else 0.0
        return NeighbourCdp(
            cdp=cdp,
            standard_error=sqrt(variance),
            confidence_interval=confidence_interval(cdp, variance, pairs / 4),
            contrast=asked.contrast,
            epsilon=asked.epsilon,
            definition=asked.definition,
            interval=asked.interval,
            below=n_below / pairs,
            above=(pairs - up_to) / pairs,
            undefined=below[1] / pairs,
            pairs=pairs,
        )


def _class_table(light: NDArray[np.float64], ends: Sequence[float]) -> NDArray[np.uint8]:
    """Class of each pair of DN, by 256 times the second plus the first: 0 without light, else 1 and the ends below."""
    larger, smaller = np.maximum.outer(light, light), np.maximum(np.minimum.outer(light, light), 0)
    table = np.where(larger > 0, 1, 0).astype(np.uint8)
    for end in ends:
        with np.errstate(over="ignore"):
            table += larger > smaller * end
    return table.ravel()


class _Geometry:
    """What of the variance depends on the size of the image alone.

    Parameters
    ----------
    shape : (int, int)
        Height and width.
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        height, width = shape
        self.rows, self.columns = np.full(height, 2.0 * width - 1), np.full(width, 2.0 * height - 1)
        self.rows[-1], self.columns[-1] = width - 1, height - 1
        #: Pairs of a pixel and of its neighbours, summed: 18 but at the border.
        ones = np.full(shape, 2, np.uint8)
        ones[:, -1] -= 1
        ones[-1] -= 1
        self.around = _around(ones)
        self.n_pairs = float(self.rows.sum())
        self.near = float((self.around * ones.astype(float)).sum())
        self.lines = _lines(self.rows, self.columns) - self.near


@lru_cache(maxsize=2)
def _geometry(shape: tuple[int, int]) -> _Geometry:
    """Geometry of a size, kept for the next frame."""
    return _Geometry(shape)


def _around(values: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Sum over each pixel and its eight neighbours."""
    import cv2

    return np.asarray(cv2.boxFilter(values, -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT))


@dataclass(frozen=True, eq=False)
class _Buffers:
    """Memory for the classes of the pairs with the right and with the lower neighbour, and for marks."""

    right: NDArray[np.uint8]
    below: NDArray[np.uint8]
    marks: NDArray[np.uint8]

    @classmethod
    def of(cls, shape: tuple[int, int]) -> _Buffers:
        height, width = shape
        sizes = (height, width - 1), (height - 1, width), shape
        return cls(*(np.zeros(size, np.uint8) for size in sizes))


def _strips(shape: tuple[int, int]) -> Iterator[slice]:
    """Rows that fit the processor's cache together with what is made of them."""
    height, width = shape
    rows = max(_STRIP // width, 2)
    return (slice(start, min(start + rows, height)) for start in range(0, height, rows))


@dataclass(frozen=True, eq=False)
class _Sums:
    """Sums of the marks of a contrast: the detected pairs, 0 to 2, of each pixel with its right and lower neighbour.

    Parameters
    ----------
    marks : ndarray of uint8, shape (height, width)
        The marks.
    rows, columns : ndarray of float
        Their sums.
    near : float
        Sum of the products of each pixel's marks with its own and its eight neighbours'.
    """

    marks: NDArray[np.uint8]
    rows: NDArray[np.float64]
    columns: NDArray[np.float64]
    near: float

    @classmethod
    def of(cls, kept: _Buffers, low: int, high: int) -> _Sums:
        """Mark the pairs whose class is `low` to `high`."""
        import cv2

        marks = kept.marks
        height, width = marks.shape
        rows, columns = np.empty(height), np.zeros(width)
        squares = differences = 0.0
        for strip in _strips((height, width)):
            part = marks[strip]
            _mark(part, kept.right[strip], kept.below[strip], low, high)
            rows[strip] = cv2.reduce(part, 1, cv2.REDUCE_SUM, dtype=cv2.CV_32S).ravel()
            columns += cv2.reduce(part, 0, cv2.REDUCE_SUM, dtype=cv2.CV_32S).ravel()
            squares += float(cv2.norm(part, cv2.NORM_L2SQR))
            # With the last row of the strip before.
            upper = marks[max(strip.start - 1, 0) : strip.stop - 1]
            lower = part if strip.start else part[1:]
            differences += sum(
                float(cv2.norm(one, other, cv2.NORM_L2SQR))
                for one, other in (
                    (part[:, 1:], part[:, :-1]),
                    (lower, upper),
                    (lower[:, 1:], upper[:, :-1]),
                    (lower[:, :-1], upper[:, 1:]),
                )
                if one.size
            )
        return cls(marks, rows, columns, _near(marks, squares, differences))


def _mark(marks: NDArray[np.uint8], right: NDArray[np.uint8], below: NDArray[np.uint8], low: int, high: int) -> None:
    import cv2

    marks[:, -1] = 0
    # 255 is -1.
    np.negative(cv2.inRange(right, low, high), out=marks[:, :-1])
    if len(below):
        part = marks[: len(below)]
        np.subtract(part, cv2.inRange(below, low, high), out=part)


def _variance(sums: _Sums, share: float) -> float:
    """Variance as by `labcdp.contrast.neighbour_uncertainty.variance_of_neighbours`.

    With a the marks, p the pairs of each pixel and U the share, its sums of products of a - U p are opened: those of
    a and a are sums of integers, and those with p follow from sums over rows and columns and from the border.
    """
    geometry = _geometry((sums.marks.shape[0], sums.marks.shape[1]))
    mixed = _near_mixed(sums.marks, float(sums.rows.sum()), geometry)
    near = sums.near - 2 * share * mixed + share**2 * geometry.near
    lines = _lines(sums.rows - share * geometry.rows, sums.columns - share * geometry.columns) - near
    squares = geometry.n_pairs**2
    return max(
        lines / (squares - geometry.lines), near / (squares - geometry.near), share * (1 - share) / geometry.n_pairs
    )


def _near(marks: NDArray[np.uint8], squares: float, differences: float) -> float:
    """Sum of products with the neighbours from the sums of squares and of squared differences.

    2 a b = a^2 + b^2 - (a - b)^2; each of the four pairs of neighbours counts twice, and the squares of a border less
    often than those inside.
    """
    border = [float(np.square(line, dtype=float).sum()) for line in (marks[0], marks[-1], marks[:, 0], marks[:, -1])]
    corners = sum(float(marks[y, x]) ** 2 for y in (0, -1) for x in (0, -1))
    return 9 * squares - 3 * sum(border) + corners - differences


def _near_mixed(marks: NDArray[np.uint8], total: float, geometry: _Geometry) -> float:
    """Sum of the products of each pixel's marks with its own and its neighbours' pairs."""
    summed = 18 * total
    lines = [0, -2, -1]
    for row in lines:
        summed += float(np.dot(marks[row].astype(float), geometry.around[row] - 18.0))
    for column in lines:
        off = geometry.around[1:-2, column] - 18.0
        summed += float(np.dot(marks[1:-2, column].astype(float), off))
    return summed


def _lines(rows: NDArray[np.float64], columns: NDArray[np.float64]) -> float:
    """Sum of products over pairs of pixels in the same or an adjacent row, and in the same or an adjacent column."""
    return float(sum(sums @ sums + 2 * (sums[1:] @ sums[:-1]) for sums in (rows, columns)))
