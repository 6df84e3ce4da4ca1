"""Patches that make a chart: equal quadrilaterals at equal distances, seen from anywhere."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from .corners import homography, projected

_Array: TypeAlias = NDArray[np.float64]
#: Row and column of a patch; any patch of the chart may be (0, 0).
At: TypeAlias = tuple[int, int]

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


def sides_of(corners: _Array) -> _Array:
    """Return the sides of quadrilaterals, in columns from left to right and from top to bottom; shape (n, 2, 2)."""
    a, b, c, d = np.moveaxis(corners, 1, 0)
    return np.stack([(b - a + c - d) / 2, (d - a + c - b) / 2], axis=-1)


def largest_lattice(corners: _Array) -> dict[At, int]:
    """Return the chart with the most patches, by row and column; empty if there is none.

    Parameters
    ----------
    corners : ndarray of float, shape (n, 4, 2)
        Of uniform quadrilaterals, from the upper left one clockwise as the image is seen.
    """
    centres, sides = corners.mean(axis=1), sides_of(corners)
    best: dict[At, int] = {}
    # Another patch of the same set may see better how far it is to the next, but not many need to be asked.
    in_vain = np.zeros(len(corners), dtype=int)
    for seed in range(len(corners)):
        if seed in best.values() or in_vain[seed] >= _TRIES:
            continue
        alike = _alike(sides, seed)
        if alike.sum() <= max(len(best), _FEWEST - 1):
            continue
        grown = _grown(seed, centres, sides, alike)
        fitting = _fitting(grown, centres, sides)
        if len(fitting) > len(best):
            best = fitting
        else:
            in_vain[list(grown)] += 1
    return dict(sorted(best.items()))


def places_between(chart: Mapping[At, int], corners: _Array) -> dict[At, _Array]:
    """Return corners, shape (4, 2), for places without a patch between two others of a row or a column."""
    at = np.array(list(chart))
    first = at.min(axis=0)
    taken = np.zeros(np.ptp(at, axis=0) + 1, dtype=np.bool_)
    taken[tuple((at - first).T)] = True
    after = np.maximum.accumulate
    # With patches before and after in the column (axis 0) or row (axis 1).
    columns, rows = (after(taken, axis) & np.flip(after(np.flip(taken, axis), axis), axis) for axis in (0, 1))
    missing = np.argwhere((rows | columns) & ~taken) + first
    patch_corners = np.moveaxis(corners[list(chart.values())], 1, 0)
    places = np.stack([_Grid(at[:, ::-1], ends).places(missing[:, ::-1]) for ends in patch_corners], axis=1)
    return {(int(i), int(j)): corners_at for (i, j), corners_at in zip(missing, places, strict=True)}


def _alike(sides: _Array, seed: int) -> NDArray[np.bool_]:
    lengths = np.linalg.norm(sides, axis=1)
    ratio = lengths / lengths[seed]
    cosine = (sides * sides[seed]).sum(axis=1) / (lengths * lengths[seed])
    return np.asarray(((ratio < _FACTOR) & (ratio > 1 / _FACTOR) & (cosine > _COSINE)).all(axis=1))


def _grown(seed: int, centres: _Array, sides: _Array, alike: NDArray[np.bool_]) -> dict[int, At]:
    """Walk from patch to patch along rows and columns, with distances in sides of the current patch."""
    places = np.abs(_seen_from(seed, centres, sides))
    beside = [places[alike & (places[:, 1 - axis] < _ASIDE) & (places[:, axis] > 0.9), axis] for axis in (0, 1)]
    steps = [float(distances.min(initial=np.inf)) for distances in beside]
    at_of_patch: dict[int, At] = {seed: (0, 0)}
    # Those that are found join the patches that are looked at.
    for patch in (queue := [seed]):
        places = _seen_from(patch, centres, sides)
        for axis in (0, 1):
            if not np.isfinite(steps[axis]):
                continue
            count = np.rint(places[:, axis] / steps[axis]).astype(int)
            right = np.abs(places[:, axis] - count * steps[axis]) < _STRETCH * np.abs(count) * steps[axis]
            right &= alike & (np.abs(places[:, 1 - axis]) < _ASIDE) & (np.abs(count) <= _FARTHEST)
            for other in np.flatnonzero(right).tolist():
                i, j = at_of_patch[patch]
                at = (i, j + int(count[other])) if axis == 0 else (i + int(count[other]), j)
                if other not in at_of_patch and at not in at_of_patch.values():
                    at_of_patch[other] = at
                    queue.append(other)
    return at_of_patch


def _seen_from(patch: int, centres: _Array, sides: _Array) -> _Array:
    """Return all centres relative to a patch's centre, in its sides."""
    return np.asarray((centres - centres[patch]) @ np.linalg.inv(sides[patch]).T)


def _fitting(at_of_patch: Mapping[int, At], centres: _Array, sides: _Array) -> dict[At, int]:
    """Return the patches that lie on a plane grid as it is seen from somewhere; none if too few do."""
    if len(at_of_patch) < _FEWEST:
        return {}
    at, chosen = np.array(list(at_of_patch.values()))[:, ::-1], np.array(list(at_of_patch))
    grid = _Grid(at, centres[chosen])
    lengths = np.linalg.norm(sides[chosen], axis=1)
    off = np.linalg.norm(grid.places(at) - centres[chosen], axis=1) / lengths.min(axis=1)
    # A patch keeps its part of the distance to the next one, however far it is.
    parts = lengths / grid.steps(at, lengths)
    right = (off < _OFF) & (np.abs(parts / np.median(parts, axis=0) - 1) < _LARGER).all(axis=1)
    kept = {cell: patch for (patch, cell), fits in zip(at_of_patch.items(), right, strict=True) if fits}
    size = np.ptp(at[right], axis=0) + 1 if kept else np.array([1, 1])
    # Any three patches off a line fit some grid.
    fewest = _FEWEST if size.min() == 1 else _FEWEST + 1
    enough = len(kept) >= max(fewest, _FITTING * len(at_of_patch)) and len(kept) >= _TAKEN * size.prod()
    return kept if enough else {}


class _Grid:
    """Where the places of a grid are seen, by least squares: a homography, or along a single line a polynomial."""

    def __init__(self, at: NDArray[np.int64], centres: _Array) -> None:
        self._spread = np.ptp(at, axis=0) > 0
        self._is_plane = self._spread.all() and len(at) > 4
        self._powers = (1, 2) if len(at) > 4 else (1,)
        matrix = homography(at.astype(np.float64), centres) if self._is_plane else None
        self._matrix: NDArray[Any] = np.linalg.lstsq(self._terms(at), centres)[0] if matrix is None else matrix

    def places(self, at: NDArray[np.number]) -> _Array:
        return projected(self._matrix, at) if self._is_plane else np.asarray(self._terms(at) @ self._matrix)

    def steps(self, at: NDArray[np.int64], otherwise: _Array) -> _Array:
        """Return the distance to the next place along rows and along columns; along a single row, for both."""
        ahead = [self.places(at + shift / 2) - self.places(at - shift / 2) for shift in np.eye(2)]
        steps = np.column_stack([np.linalg.norm(step, axis=1) for step in ahead])
        if not self._spread.all():
            steps[:, ~self._spread] = steps[:, self._spread]
        return np.where(steps > 0, steps, otherwise)

    def _terms(self, at: NDArray[np.number]) -> _Array:
        along = at[:, self._spread]
        return np.column_stack([np.ones(len(at)), *(along**power for power in self._powers)])
