"""Nearest-neighbour CDP of 8-bit frames, at the speed of a video."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import inf, nan, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.frame import Frame
from ...metrics import Epsilon, NeighbourCdp
from ...metrics.contrast import TargetContrast
from ...metrics.neighbours import FEWEST_LINES
from ...metrics.pairs import RELATIVE_TOLERANCE
from ...metrics.uncertainty import confidence_interval
from ..picture.conversion import PictureConversion

#: Contrasts at once: each has two ends, and a class has one byte.
_MOST_CONTRASTS = 120

_Array = NDArray[np.float64]


def light_by_dn(frame: Frame, conversion: PictureConversion) -> NDArray[np.floating[Any]] | None:
    """Light of each DN of frames such as this one.

    Frames of all DN, each at many places, are converted to see it: vignetting, flat field or dark pattern make the
    light depend on the position, veiling glare on the rest of the picture.

    Parameters
    ----------
    frame : Frame
        One of the frames.
    conversion : PictureConversion
        Their conversion.

    Returns
    -------
    ndarray of float, shape (256,), or None
        None for frames of more than 8 bits or with a colour filter, or if more than the DN decides.

    Raises
    ------
    CalibrationError
        If the conversion is not for such frames.
    """
    if frame.dn.dtype != np.uint8 or frame.colour_filter is not None or frame.dn.size < 512:
        return None
    tables = []
    for highest in (255, 63):
        # Values where they have nothing to do with rows and columns.
        dn = np.random.default_rng(0).permutation(np.resize(np.arange(highest + 1, dtype=np.uint8), frame.dn.size))
        dn = dn.reshape(frame.shape)
        light = conversion.convert(frame.with_pixels(dn)).luminance_cd_m2
        table = np.zeros(highest + 1, light.dtype)
        table[dn] = light
        if not np.array_equal(table[dn], light):
            return None
        tables.append(table)
    return tables[0] if np.array_equal(tables[0][: tables[1].size], tables[1]) else None


class NeighbourTables:
    """Nearest-neighbour CDP where the light of a pixel follows from its DN alone.

    There are 2^16 pairs of DN, so that it is known beforehand between which of all ends of the intervals the contrast
    of a pair lies: one look-up a pair, whatever the number of contrasts, and none where neighbours differ less than
    any contrast asks for. All sums are those of integers; results are those of
    `labcdp.metrics.cdp_neighbours_range` to the rounding of its floats.

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
        self._asked = [TargetContrast(contrast, epsilon, "weber") for contrast in contrasts]
        intervals = [
            (
                0.0 if one.low is None else float(1 + one.low) * (1 - RELATIVE_TOLERANCE),
                inf if one.high is None else float(1 + one.high) * (1 + RELATIVE_TOLERANCE),
            )
            for one in self._asked
        ]
        # A pair has the class of how many of these ends its ratio exceeds; one with light exceeds 0, none infinity.
        ends = [0.0, *sorted({end for pair in intervals for end in pair if 0 < end < inf}), inf]
        self._ends = np.array([[ends.index(end) for end in pair] for pair in intervals], np.uint8)
        values = np.asarray(light, dtype=float)
        larger, smaller = np.maximum.outer(values, values), np.maximum(np.minimum.outer(values, values), 0)
        classes = (larger > 0).astype(np.uint8)
        for end in ends[1:-1]:
            with np.errstate(over="ignore"):
                classes += larger > smaller * end
        self._classes, self._alike = classes.ravel(), _alike(classes)

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
        from .neighbours_kernel import Pairs, Sums, sum_marks

        if dn.size < 2:
            raise InputError(f"the image holds {dn.size} pixels: give at least two, or there is no neighbour")
        # Neighbours are the same ones in a column and in a row.
        image = np.ascontiguousarray(dn if dn.shape[1] > 1 else dn.T)
        (height, width), n = image.shape, len(self._asked)
        of_contrast = np.zeros((3, n), np.int64)
        rows, columns = np.zeros((n, height), np.int64), np.zeros((n, width), np.uint32)
        sums = Sums(np.zeros(1, np.int64), of_contrast[0], of_contrast[1], of_contrast[2], rows, columns)
        sum_marks(image, Pairs(self._classes, self._alike, self._ends), sums)
        if sums.lit[0] == 0:
            raise InputError(
                "the image holds no value above 0, so no contrast is defined: check exposure and black level"
            )
        n_pairs, lit, found = height * (width - 1) + (height - 1) * width, int(sums.lit[0]), []
        for place, asked in enumerate(self._asked):
            inside, above = int(sums.rows[place].sum()), int(sums.above[place])
            cdp, variance = inside / n_pairs, nan
            if min(height, width) >= FEWEST_LINES:
                variance = _variance(cdp, *(one[place] for one in sums[2:])) if 0 < cdp < 1 else 0.0
            found.append(
                NeighbourCdp(
                    cdp=cdp,
                    standard_error=sqrt(variance),
                    confidence_interval=confidence_interval(cdp, variance, n_pairs / 4),
                    contrast=asked.contrast,
                    epsilon=asked.epsilon,
                    definition=asked.definition,
                    interval=asked.interval,
                    below=(n_pairs - inside - above) / n_pairs,
                    above=above / n_pairs,
                    undefined=(n_pairs - lit) / n_pairs,
                    pairs=n_pairs,
                )
            )
        return tuple(found)


def _alike(classes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """By DN, the least difference at which a pair of this DN or more is of another class than one of DN 255."""
    apart = np.full(256, 255)
    for dn in range(256):
        other = np.flatnonzero(classes[dn, dn:] != classes[-1, -1])
        apart[dn] = other[0] if other.size else 255
    least: NDArray[np.uint8] = np.minimum.accumulate(apart[::-1])[::-1].astype(np.uint8)
    return least


def _variance(share: float, near: int, mixed: int, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> float:
    """Variance of the share of detected pairs, as `labcdp.metrics.neighbours.variance_of_neighbours`.

    With a the marks, p the pairs of each pixel and U the share, its sums of products of a - U p are opened: those of a
    and a, and of a and p, are sums of integers.
    """
    all_near, all_rows, all_columns = _all_pairs(rows.size, columns.size)
    squares, n_pairs = all_rows.sum() ** 2, all_rows.sum()
    near_sum = near - 2 * share * mixed + share**2 * all_near
    lines = _lines(rows - share * all_rows, columns - share * all_columns) - near_sum
    all_lines = _lines(all_rows, all_columns) - all_near
    return float(max(lines / (squares - all_lines), near_sum / (squares - all_near), share * (1 - share) / n_pairs))


@lru_cache(maxsize=2)
def _all_pairs(height: int, width: int) -> tuple[float, _Array, _Array]:
    """Sum of the products of the pairs of each pixel and its neighbours, and sums of pairs of rows and columns."""
    rows, columns = np.full(height, 2.0 * width - 1), np.full(width, 2.0 * height - 1)
    rows[-1], columns[-1] = width - 1, height - 1
    pairs = np.full((height, width), 2.0)
    pairs[:, -1] -= 1
    pairs[-1] -= 1
    padded = np.pad(pairs, 1)
    around = sum(padded[y : y + height, x : x + width] for y in range(3) for x in range(3))
    return float((pairs * around).sum()), rows, columns


def _lines(rows: _Array, columns: _Array) -> float:
    """Sum of products over pairs of pixels in the same or an adjacent row, and in the same or an adjacent column."""
    return float(sum(sums @ sums + 2 * (sums[1:] @ sums[:-1]) for sums in (rows, columns)))
