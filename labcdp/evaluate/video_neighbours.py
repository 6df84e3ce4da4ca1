"""CDP from pixel to pixel of 8-bit frames, at the speed of a video."""

from __future__ import annotations

from collections.abc import Sequence
from math import nan, sqrt
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..contrast import Epsilon, NeighbourCdp
from ..contrast.interval import AskedContrast
from ..contrast.neighbour_uncertainty import FEWEST_LINES
from ..contrast.pairs import RELATIVE_TOLERANCE
from ..contrast.uncertainty import confidence_interval
from ..errors import InputError
from .video_marks import MarkSums

#: Contrasts at once: each has two ends, and a class has one byte.
_MOST_CONTRASTS = 120
#: Up to so many ends of intervals are compared one by one, which is then faster than all at once.
_FEW_ENDS = 2
#: Up to so many classes are counted one by one, which is then faster than all at once.
_FEW_PLACES = 7
#: Pixels of a strip: all that is made of it fits the processor's cache.
_STRIP = 2**18

_Planes = Sequence[NDArray[np.uint8]]


class NeighbourTables:
    """CDP from pixel to pixel where the light of a pixel follows from its DN alone.

    There are 2^16 pairs of DN, so that it is known beforehand between which of all ends of the intervals the contrast
    of a pair lies: one look-up a pair, whatever the number of contrasts. For few ends it is quicker to look up, for
    each pixel, how light the lighter one of a pair may be. All sums are those of integers; results are
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
        intervals = [
            (
                0.0 if one.low is None else float(1 + one.low) * (1 - RELATIVE_TOLERANCE),
                np.inf if one.high is None else float(1 + one.high) * (1 + RELATIVE_TOLERANCE),
            )
            for one in self._asked
        ]
        # Place 0 is exceeded by all pairs with light, the last one by none, and those between by what exceeds an end.
        ends = sorted({end for pair in intervals for end in pair if 0 < end < np.inf})
        place = {0.0: 0, **{end: n for n, end in enumerate(ends, start=1)}, np.inf: len(ends) + 1}
        self._n_places = len(place)
        self._intervals = [(place[low], place[high]) for low, high in intervals]
        values = np.asarray(light, dtype=float)
        few = _Limits.of(values, ends) if len(ends) <= _FEW_ENDS else None
        self._comparison: _Comparison = _Classes(values, ends) if few is None else few

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
        height, width = dn.shape
        told = min(height, width) >= FEWEST_LINES
        sums = [MarkSums((height, width)) for _ in self._asked] if told else []
        exceeding = np.zeros(self._n_places, np.int64)
        n_rows = max(_STRIP // width, 2)
        marks = np.zeros((n_rows, width), np.uint8)
        for start in range(0, height, n_rows):
            planes = self._comparison.planes(dn[start : start + n_rows + 1])
            part = marks[: min(n_rows, height - start)]
            # Pairs with the right neighbour, then those with the lower one, which the last row does not have.
            beside, lower = part[:, :-1], part[: len(planes[0]) - 1]
            found = [
                (marked, self._comparison.compared(*([plane[at] for plane in planes] for at in pair)))
                for marked, pair in (
                    (beside, (np.s_[:n_rows, :-1], np.s_[:n_rows, 1:])),
                    (lower, (np.s_[:-1], np.s_[1:])),
                )
                if marked.size
            ]
            exceeding += sum(compared.exceeding() for _, compared in found)
            for one, (low, high) in zip(sums, self._intervals, strict=False):
                for marked, compared in found:
                    compared.mark(low, high, marked)
                one.add(start, part)
                part[:] = 0
        n_pairs = height * (width - 1) + (height - 1) * width
        if exceeding[0] == 0:
            raise InputError(
                "the image holds no value above 0, so no contrast is defined: check exposure and black level"
            )
        n_exceeding = exceeding.tolist()
        return tuple(
            _result(asked, n_pairs, n_exceeding[0], (n_exceeding[low], n_exceeding[high]), sums[n] if told else None)
            for n, (asked, (low, high)) in enumerate(zip(self._asked, self._intervals, strict=True))
        )


def _result(
    asked: AskedContrast, n_pairs: int, n_lit: int, exceeding: tuple[int, int], sums: MarkSums | None
) -> NeighbourCdp:
    """Return the result of a contrast from the pairs with light and those that exceed its ends."""
    cdp = (exceeding[0] - exceeding[1]) / n_pairs
    variance = nan
    if sums is not None:
        variance = sums.variance(cdp) if 0 < cdp < 1 else 0.0
    return NeighbourCdp(
        cdp=cdp,
        standard_error=sqrt(variance),
        confidence_interval=confidence_interval(cdp, variance, n_pairs / 4),
        contrast=asked.contrast,
        epsilon=asked.epsilon,
        definition=asked.definition,
        interval=asked.interval,
        below=(n_pairs - exceeding[0]) / n_pairs,
        above=exceeding[1] / n_pairs,
        undefined=(n_pairs - n_lit) / n_pairs,
        pairs=n_pairs,
    )


class _Compared(Protocol):
    """Pairs of pixels compared with the ends of all intervals."""

    def exceeding(self) -> NDArray[np.int64]:
        """Count the pairs that exceed each place."""
        ...

    def mark(self, low: int, high: int, marks: NDArray[np.uint8]) -> None:
        """Add 1 to the marks of the pairs that exceed the place `low` and not the place `high`."""
        ...


class _Comparison(Protocol):
    """A way to compare pairs of pixels with the ends of all intervals."""

    def planes(self, dn: NDArray[np.uint8]) -> _Planes:
        """Return what is needed of each pixel."""
        ...

    def compared(self, first: _Planes, second: _Planes) -> _Compared:
        """Compare pixels, at least one, with as many others."""
        ...


class _Classes:
    """Looks up how many places a pair exceeds."""

    def __init__(self, light: NDArray[np.float64], ends: Sequence[float]) -> None:
        larger, smaller = np.maximum.outer(light, light), np.maximum(np.minimum.outer(light, light), 0)
        table = (larger > 0).astype(np.uint8)
        for end in ends:
            with np.errstate(over="ignore"):
                table += larger > smaller * end
        # Of a pair, the second pixel is the higher byte.
        self._table = table.ravel()
        self._n_places = len(ends) + 2

    def planes(self, dn: NDArray[np.uint8]) -> _Planes:
        return (dn,)

    def compared(self, first: _Planes, second: _Planes) -> _Compared:
        import cv2

        pairs = cv2.merge([first[0], second[0]]).view("<u2")[..., 0]
        return _ClassesOfPairs(np.asarray(cv2.LUT(pairs, self._table)), self._n_places)


class _ClassesOfPairs:
    """How many places each pair exceeds, as an image."""

    def __init__(self, classes: NDArray[np.uint8], n_places: int) -> None:
        self._classes, self._n_places = classes, n_places

    def exceeding(self) -> NDArray[np.int64]:
        import cv2

        if self._n_places <= _FEW_PLACES:
            compared = (cv2.compare(self._classes, place, cv2.CMP_GT) for place in range(self._n_places))
            return np.array([*map(cv2.countNonZero, compared)], np.int64)
        # Most pairs are of one class: a processor counts several bins in turn much faster than one.
        n_bins = next(n for n in (64, 128, 256) if n > self._n_places)
        turns = np.resize(np.arange(0, 256, n_bins, dtype=np.uint8), self._classes.shape[1])
        counts = cv2.calcHist([self._classes + turns], [0], None, [256], [0, 256]).reshape(-1, n_bins)
        down_to = counts.sum(axis=0, dtype=float)[::-1].cumsum()[::-1]
        exceeding: NDArray[np.int64] = np.rint(down_to[1 : self._n_places + 1]).astype(np.int64)
        return exceeding

    def mark(self, low: int, high: int, marks: NDArray[np.uint8]) -> None:
        import cv2

        # 255 is -1.
        np.subtract(marks, cv2.inRange(self._classes, low + 1, high), out=marks)


class _Limits:
    """Compares the lighter pixel of a pair with the limit that each end sets for it by the darker one.

    The lighter a pixel, the higher its limit: that of the darker one is the lower one.

    Parameters
    ----------
    levels : ndarray of uint8, shape (256,), or None
        Place of the light of each DN among all lights; None if it is the DN.
    limits : ndarray of uint8, shape (n, 256)
        Highest level that does not exceed an end.
    dark : int
        Highest level without light, -1 for none.
    """

    def __init__(self, levels: NDArray[np.uint8] | None, limits: NDArray[np.uint8], dark: int) -> None:
        self._levels, self._limits, self._dark = levels, limits, dark

    @classmethod
    def of(cls, light: NDArray[np.float64], ends: Sequence[float]) -> _Limits | None:
        """None if even the lowest level exceeds an end."""
        values, levels = np.unique(light, return_inverse=True)
        with np.errstate(over="ignore"):
            products = np.multiply.outer(np.array(ends), np.maximum(values, 0))
        limits = np.searchsorted(values, products, side="right") - 1
        if (limits < 0).any():
            return None
        rises = bool((levels == np.arange(256)).all())
        return cls(
            None if rises else levels.astype(np.uint8),
            limits[:, levels].astype(np.uint8),
            int(np.searchsorted(values, 0, side="right")) - 1,
        )

    def planes(self, dn: NDArray[np.uint8]) -> _Planes:
        import cv2

        levels = dn if self._levels is None else np.asarray(cv2.LUT(dn, self._levels))
        return [levels, *(np.asarray(cv2.LUT(dn, limit)) for limit in self._limits)]

    def compared(self, first: _Planes, second: _Planes) -> _Compared:
        lighter = np.maximum(first[0], second[0])
        lit = lighter > self._dark
        limits = (np.minimum(one, other) for one, other in zip(first[1:], second[1:], strict=True))
        return _ExceedingPairs([lit, *(lighter > limit for limit in limits)])


class _ExceedingPairs:
    """Which pairs exceed each place but the last."""

    def __init__(self, exceeds: list[NDArray[np.bool_]]) -> None:
        self._exceeds = exceeds

    def exceeding(self) -> NDArray[np.int64]:
        return np.array([*map(np.count_nonzero, self._exceeds), 0], np.int64)

    def mark(self, low: int, high: int, marks: NDArray[np.uint8]) -> None:
        np.add(marks, self._exceeds[low].view(np.uint8), out=marks)
        if high < len(self._exceeds):
            # What exceeds the upper place also exceeds the lower one.
            np.subtract(marks, self._exceeds[high].view(np.uint8), out=marks)
