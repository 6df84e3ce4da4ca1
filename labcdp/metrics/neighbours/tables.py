"""Nearest-neighbour CDP of 8-bit images, at the speed of a video."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ..contrast import Epsilon, checked_contrast, detected_ratios
from ..pixel_pairs import RELATIVE_TOLERANCE
from ..result import Cdp
from .cdp import MarkSums, cdp_from_counts

#: Contrasts at once: each has two ends, and a class has one byte.
MOST_CONTRASTS = 120


class NeighbourTables:
    """Nearest-neighbour CDP where the light of a pixel follows from its DN alone.

    There are 2^16 pairs of DN, so that it is known beforehand between which of all ends of the intervals the contrast
    of a pair lies: one look-up a pair, whatever the number of contrasts, and none where neighbours differ less than
    any contrast asks for. All sums are those of integers; results are those of
    `cdp_neighbours` to the rounding of its floats.

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
        if len(contrasts) > MOST_CONTRASTS:
            raise InputError(f"{len(contrasts)} contrasts are given: give up to {MOST_CONTRASTS}")
        if not np.isfinite(light).all():
            raise InputError("the light of a DN is not finite: check calibration or camera specification")
        self._contrasts, self._epsilon = [checked_contrast(contrast, epsilon) for contrast in contrasts], epsilon
        intervals = [
            (max(low * (1 - RELATIVE_TOLERANCE), 0.0), high * (1 + RELATIVE_TOLERANCE))
            for low, high in (detected_ratios(contrast, epsilon) for contrast in self._contrasts)
        ]
        # Place 0 is exceeded by all pairs with light, the last one by none, and those between by what exceeds an end.
        ends = sorted({end for pair in intervals for end in pair if 0 < end < np.inf})
        index = {0.0: 0, **{end: n for n, end in enumerate(ends, start=1)}, np.inf: len(ends) + 1}
        self._n_places = len(index)
        self._intervals = np.array([(index[low], index[high]) for low, high in intervals], np.uint8)
        classes = _classes(np.asarray(light, dtype=float), ends)
        self._classes, self._alike = classes.ravel(), _alike(classes)

    def evaluate(self, dn: NDArray[np.uint8]) -> Cdp[NDArray[np.float64]]:
        """Evaluate a frame.

        Parameters
        ----------
        dn : ndarray of uint8, shape (height, width)
            The frame.

        Returns
        -------
        Cdp
            Of all contrasts.

        Raises
        ------
        InputError
            If it has fewer than two pixels, or none with light.
        """
        from .tables_kernel import Pairs, Sums, sum_marks

        if dn.size < 2:
            raise InputError(f"the image holds {dn.size} pixels: give at least two, or there is no neighbour")
        # Neighbours are the same ones in a column and in a row.
        image = np.ascontiguousarray(dn if dn.shape[1] > 1 else dn.T)
        height, width = image.shape
        n = len(self._contrasts)
        shapes = ((self._n_places,), (n,), (n, height), (n, width), (n, height, 3))
        types = (np.int64, np.int64, np.int64, np.uint32, np.uint8)
        sums = Sums(*(np.zeros(shape, dtype) for shape, dtype in zip(shapes, types, strict=True)))
        sum_marks(image, Pairs(self._classes, self._alike, self._intervals), sums)
        if sums.counts[0] == 0:
            raise InputError(
                "the image holds no value above 0, so no contrast is defined: check exposure and black level"
            )
        n_pairs = height * (width - 1) + (height - 1) * width
        n_lit, *_ = exceeding = sums.counts.tolist()
        counts = [
            (n_pairs - n_lit, n_pairs - exceeding[low], n_pairs - exceeding[high])
            for low, high in self._intervals.tolist()
        ]
        marks = map(MarkSums, sums.near.tolist(), sums.rows, sums.columns, sums.sides)
        return cdp_from_counts(self._contrasts, self._epsilon, "weber", n_pairs, counts, list(marks))


def neighbour_tables(
    light: NDArray[np.floating[Any]], contrasts: tuple[float, ...], epsilon: Epsilon
) -> NeighbourTables:
    """Return tables as `NeighbourTables`, those of the frame before if they are the same."""
    return _kept(light.tobytes(), light.dtype.str, contrasts, epsilon)


@lru_cache(maxsize=4)
def _kept(light: bytes, dtype: str, contrasts: tuple[float, ...], epsilon: Epsilon) -> NeighbourTables:
    return NeighbourTables(np.frombuffer(light, dtype), contrasts, epsilon)


def _classes(light: NDArray[np.float64], ends: Sequence[float]) -> NDArray[np.uint8]:
    """Count the class limits that each pair of DN exceeds, shape (256, 256)."""
    larger, smaller = np.maximum.outer(light, light), np.maximum(np.minimum.outer(light, light), 0)
    classes = (larger > 0).astype(np.uint8)
    for end in ends:
        with np.errstate(over="ignore"):
            classes += larger > smaller * end
    return classes


def _alike(classes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """By DN, the least difference at which a pair of this DN or more is of another class than one of DN 255."""
    apart = np.full(256, 255)
    for dn in range(256):
        other = np.flatnonzero(classes[dn, dn:] != classes[-1, -1])
        apart[dn] = other[0] if other.size else 255
    least: NDArray[np.uint8] = np.minimum.accumulate(apart[::-1])[::-1].astype(np.uint8)
    return least
