"""CDP between two regions at many contrasts, from how often each value occurs: for the frames of a video."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..contrast import Distribution, Epsilon
from ..contrast.interval import AskedContrast
from ..contrast.pairs import RELATIVE_TOLERANCE

_Array = NDArray[np.float64]


class Tally(NamedTuple):
    """Shares of all pairs of pixels for k contrasts.

    Parameters
    ----------
    below, inside, above : ndarray of float, shape (k,)
        Pairs below, in and above the interval; of those that are below, undefined ones are a part.
    per_bright, per_dark : ndarray of float, shape (k, n)
        Share of the pairs of each distinct value of a region that are inside.
    """

    below: _Array
    inside: _Array
    above: _Array
    per_bright: _Array
    per_dark: _Array


@dataclass(frozen=True, eq=False)
class ManyContrasts:
    """Contrasts that are looked for together, as `labcdp.contrast.cdp_range` does one by one.

    Parameters
    ----------
    low, high : ndarray of float, shape (k,)
        Ends of the intervals as factors of the dark value; -1 and inf where they are open.
    """

    low: _Array
    high: _Array

    @classmethod
    def of(cls, contrasts: Sequence[float], epsilon: Epsilon) -> ManyContrasts:
        """Take contrasts and their tolerance; raises InputError as `labcdp.contrast.cdp`."""
        return _many(tuple(contrasts), epsilon)

    def tally(self, bright: Distribution, dark: Distribution) -> Tally:
        """Count pairs; values and tolerance are treated as by `labcdp.contrast.cdp`."""
        pairs = bright.total * dark.total
        enter, leave = self._places(bright, dark, self.low, False), self._places(bright, dark, self.high, True)
        below, up_to = bright.cumulative[enter], bright.cumulative[leave]
        inside = up_to - below
        # Each dark value enters at its first bright value inside and leaves after its last one.
        n = bright.values.size + 1
        offsets = n * np.arange(len(self.low))[:, None]
        weights = np.broadcast_to(dark.weights, enter.shape).ravel()
        size = n * len(self.low)
        flow = np.bincount((enter + offsets).ravel(), weights, size) - np.bincount(
            (leave + offsets).ravel(), weights, size
        )
        per_bright = np.cumsum(flow.reshape(-1, n)[:, :-1], axis=1) / dark.total
        return Tally(
            below @ dark.weights / pairs,
            inside @ dark.weights / pairs,
            (bright.total - up_to) @ dark.weights / pairs,
            per_bright,
            inside / bright.total,
        )

    def inside(self, bright: Distribution, dark: Distribution) -> _Array:
        """CDP alone, shape (k,)."""
        enter, leave = self._places(bright, dark, self.low, False), self._places(bright, dark, self.high, True)
        counts = bright.cumulative[leave] - bright.cumulative[enter]
        return np.asarray(counts @ dark.weights / (bright.total * dark.total))

    @staticmethod
    def _places(bright: Distribution, dark: Distribution, factors: _Array, upper: bool) -> NDArray[np.intp]:
        """Count, for each contrast and dark value, the distinct bright values up to the end of the interval."""
        lit = np.maximum(dark.values, 0)
        with np.errstate(invalid="ignore", over="ignore"):
            limits = factors[:, None] * lit
        open_ends = np.isinf(factors) if upper else factors < 0
        if open_ends.any():
            # Without an upper end every bright value counts; without a lower one only undefined pairs are below.
            limits[open_ends] = np.inf if upper else np.where(dark.values > 0, -np.inf, 0.0)
        places: NDArray[np.intp] = np.searchsorted(bright.values, limits, side="right")
        return places


@lru_cache(maxsize=64)
def _many(contrasts: tuple[float, ...], epsilon: Epsilon) -> ManyContrasts:
    """Compute ends of intervals, kept for the next frame: they are exact fractions, which take their time."""
    asked = [AskedContrast(contrast, epsilon, "weber") for contrast in contrasts]
    low = [-1.0 if one.low is None else float(1 + one.low) * (1 - RELATIVE_TOLERANCE) for one in asked]
    high = [np.inf if one.high is None else float(1 + one.high) * (1 + RELATIVE_TOLERANCE) for one in asked]
    return ManyContrasts(np.array(low), np.array(high))
