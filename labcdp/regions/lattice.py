"""Patches that make a chart: equal quadrilaterals at equal distances, seen from anywhere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from .corners import At, homography, projected

_Array: TypeAlias = NDArray[np.float64]

#: Sides of a chart's patches differ by this factor at most, and their directions by this cosine: perspective.
_FACTOR, _COSINE = 2.0, 0.9

#: How far a neighbour may be from where it should be, in sides of a patch and in parts of the distance.
_ASIDE, _STRETCH = 0.35, 0.2

#: Most distances to the next patch along a row or column: one or two may be missing between.
_FARTHEST = 3

#: How far from the fitted chart a patch may be, in sides, and how much larger or smaller, in parts.
_OFF, _LARGER = 0.12, 0.2

#: Parts of the patches that must fit, and of the chart's places that must be taken.
_FITTING, _TAKEN = 0.75, 0.5

_FEWEST = 3

#: How often a patch may be part of what is no chart.
_TRIES = 4


@dataclass(frozen=True, eq=False)
class Patch:
    """A uniform quadrilateral.

    Parameters
    ----------
    corners : ndarray of float, shape (4, 2)
        From the upper left one clockwise as the image is seen.
    level : float
        Median of its values.
    """

    corners: _Array
    level: float

    @property
    def centre(self) -> _Array:
        """Mean of the corners."""
        return np.asarray(self.corners.mean(axis=0))

    @property
    def sides(self) -> _Array:
        """Columns: from left to right, and from top to bottom."""
        a, b, c, d = self.corners
        return np.column_stack([(b - a + c - d) / 2, (d - a + c - b) / 2])


def largest_lattice(patches: Sequence[Patch]) -> dict[At, Patch]:
    """Return the chart with the most patches, by row and column; empty if there is none."""
    centres = np.array([patch.centre for patch in patches]).reshape(-1, 2)
    sides = np.array([patch.sides for patch in patches]).reshape(-1, 2, 2)
    best: dict[At, int] = {}
    # Another patch of the same set may see better how far it is to the next, but not many need to be asked.
    in_vain = np.zeros(len(patches), dtype=int)
    for seed in range(len(patches)):
        if seed in best.values() or in_vain[seed] >= _TRIES:
            continue
        alike = _alike(sides, seed)
        if alike.sum() <= max(len(best), _FEWEST - 1):
            continue
        grown = _grown(seed, centres, sides, alike)
        found = _fitting(grown, centres, sides)
        if len(found) > len(best):
            best = found
        else:
            in_vain[list(grown.values())] += 1
    return {at: patches[best[at]] for at in sorted(best)}


def places_between(chart: Mapping[At, Patch]) -> dict[At, _Array]:
    """Return corners, shape (4, 2), for places without a patch between two others of a row or a column."""
    at = np.array(list(chart))
    first = at.min(axis=0)
    taken = np.zeros(np.ptp(at, axis=0) + 1, dtype=np.bool_)
    taken[tuple((at - first).T)] = True
    after = np.maximum.accumulate
    # With patches before and after in the column (axis 0) or row (axis 1).
    columns, rows = (after(taken, axis) & np.flip(after(np.flip(taken, axis), axis), axis) for axis in (0, 1))
    missing = np.argwhere((rows | columns) & ~taken) + first
    corners = np.array([patch.corners for patch in chart.values()])
    grids = [_Grid(at[:, ::-1].astype(np.float64), corners[:, corner]) for corner in range(4)]
    places = np.stack([grid.places(missing[:, ::-1].astype(np.float64)) for grid in grids], axis=1)
    return {(int(i), int(j)): place for (i, j), place in zip(missing, places, strict=True)}


def _alike(sides: _Array, seed: int) -> NDArray[np.bool_]:
    lengths = np.linalg.norm(sides, axis=1)
    ratio = lengths / lengths[seed]
    cosine = (sides * sides[seed]).sum(axis=1) / (lengths * lengths[seed])
    return np.asarray(((ratio < _FACTOR) & (ratio > 1 / _FACTOR) & (cosine > _COSINE)).all(axis=1))


def _grown(seed: int, centres: _Array, sides: _Array, alike: NDArray[np.bool_]) -> dict[At, int]:
    """Go from patch to patch along rows and columns, by distances in sides of the patch one is at."""
    steps = []
    for axis in (0, 1):
        places = _seen_from(seed, centres, sides)
        beside = np.abs(places[alike & (np.abs(places[:, 1 - axis]) < _ASIDE), axis])
        steps.append(float(beside[beside > 0.9].min(initial=np.inf)))
    at_of, edge = {seed: (0, 0)}, [seed]
    found: dict[At, int] = {(0, 0): seed}
    while edge:
        patch = edge.pop(0)
        places = _seen_from(patch, centres, sides)
        for axis in (0, 1):
            if not np.isfinite(steps[axis]):
                continue
            count = np.rint(places[:, axis] / steps[axis]).astype(int)
            right = np.abs(places[:, axis] - count * steps[axis]) < _STRETCH * np.abs(count) * steps[axis]
            right &= alike & (np.abs(places[:, 1 - axis]) < _ASIDE) & (np.abs(count) <= _FARTHEST)
            for other in np.flatnonzero(right):
                i, j = at_of[patch]
                at = (i, j + int(count[other])) if axis == 0 else (i + int(count[other]), j)
                if int(other) not in at_of and at not in found:
                    at_of[int(other)], found[at] = at, int(other)
                    edge.append(int(other))
    return found


def _seen_from(patch: int, centres: _Array, sides: _Array) -> _Array:
    """Return all centres in sides of a patch, from its centre."""
    return np.asarray((centres - centres[patch]) @ np.linalg.inv(sides[patch]).T)


def _fitting(found: dict[At, int], centres: _Array, sides: _Array) -> dict[At, int]:
    """Return the patches that lie on a plane grid as it is seen from somewhere; none if too few do."""
    if len(found) < _FEWEST:
        return {}
    at = np.array(list(found), dtype=np.float64)[:, ::-1]
    chosen = np.array(list(found.values()))
    grid = _Grid(at, centres[chosen])
    lengths = np.linalg.norm(sides[chosen], axis=1)
    off = np.linalg.norm(grid.places(at) - centres[chosen], axis=1) / lengths.min(axis=1)
    # A patch keeps its part of the distance to the next one, however far it is.
    parts = lengths / grid.steps(at, lengths)
    right = (off < _OFF) & (np.abs(parts / np.median(parts, axis=0) - 1) < _LARGER).all(axis=1)
    kept = {place: patch for (place, patch), fits in zip(found.items(), right, strict=True) if fits}
    size = np.ptp(at[right], axis=0) + 1 if len(kept) else np.array([1, 1])
    # Any three patches off a line fit some grid.
    fewest = _FEWEST if size.min() == 1 else _FEWEST + 1
    enough = len(kept) >= max(fewest, _FITTING * len(found)) and len(kept) >= _TAKEN * size.prod()
    return kept if enough else {}


class _Grid:
    """Where the places of a grid are seen, by least squares: a homography, or along a single line a polynomial."""

    def __init__(self, at: _Array, centres: _Array) -> None:
        self._spread = np.ptp(at, axis=0) > 0
        self._homography = self._spread.all() and len(at) > 4
        if self._homography:
            self._matrix: _Array = homography(at, centres)
        else:
            self._bent = len(at) > 4
            self._matrix = np.asarray(np.linalg.lstsq(self._terms(at), centres, rcond=None)[0], dtype=np.float64)

    def places(self, at: _Array) -> _Array:
        if self._homography:
            return projected(self._matrix, at)
        return np.asarray(self._terms(at) @ self._matrix)

    def steps(self, at: _Array, otherwise: _Array) -> _Array:
        """Return the distance to the next place along rows and along columns; along a single row, for both."""
        ahead = [self.places(at + shift / 2) - self.places(at - shift / 2) for shift in np.eye(2)]
        steps = np.column_stack([np.linalg.norm(step, axis=1) for step in ahead])
        if not self._spread.all():
            steps[:, ~self._spread] = steps[:, self._spread]
        return np.where(steps > 0, steps, otherwise)

    def _terms(self, at: _Array) -> _Array:
        terms = [np.ones(len(at)), *at.T[self._spread]]
        if self._bent:
            terms += [column**2 for column in at.T[self._spread]]
        return np.column_stack(terms)
