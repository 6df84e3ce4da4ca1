"""Where a checkerboard may begin: corners at which brightness has a saddle, in squares of 3 x 3."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np
from numpy.typing import NDArray

from .corners import Corners, FloatImage

_Array = NDArray[np.float64]

#: Most saddles that are looked at, and least strength in parts of the strongest ones.
_MOST, _LEAST = 2000, 0.15

#: How many seeds are given for one image, and how many saddles are asked.
_SEEDS, _ASKED = 4, 60

#: Nearest saddles of which four may be neighbours, and eight a seed.
_NEAREST, _AROUND = 6, 40

#: How far a corner may be from where two others say, in sides.
_OFF = 0.25

#: Rows and columns of a seed, and in which of them light and dark lie as in its middle.
_AT = tuple(product((-1, 0, 1), (-1, 0, 1)))
_SIGNS = np.array([1 if (i + j) % 2 == 0 else -1 for i, j in _AT])


def seeds(image: FloatImage) -> Iterator[Corners]:
    """Give sets of 3 x 3 corners, the strongest first.

    Parameters
    ----------
    image : ndarray of float32, shape (height, width)
        Smoothed, and evenly bright.
    """
    places, axes = _saddles(image)
    given = asked = 0
    # Where one seed was, no other is needed.
    covered = np.zeros(len(places), dtype=np.bool_)
    for middle in range(len(places)):
        if covered[middle]:
            continue
        asked += 1
        if asked > _ASKED:
            return
        found = _seed(middle, places, axes)
        if found is None:
            continue
        covered[list(found.values())] = True
        yield {at: places[index] for at, index in found.items()}
        given += 1
        if given == _SEEDS:
            return


def _saddles(image: FloatImage) -> tuple[_Array, _Array]:
    """Return places, shape (n, 2), and the angle of the brighter axis of each, in radians; the strongest first."""
    import cv2

    xx, yy = (cv2.Sobel(image, cv2.CV_32F, dx, dy, ksize=5) for dx, dy in ((2, 0), (0, 2)))
    xy = cv2.Sobel(image, cv2.CV_32F, 1, 1, ksize=5)
    # The product of the curvatures is negative where they have opposite signs.
    strength = np.maximum(xy * xy - xx * yy, 0)
    peaks = (strength == cv2.dilate(strength, np.ones((7, 7), np.uint8))) & (strength > 0)
    row, column = np.nonzero(peaks)
    values = strength[row, column]
    if values.size == 0:
        return np.empty((0, 2)), np.empty(0)
    order = np.argsort(-values)[:_MOST]
    strong = values[order[min(len(order) - 1, 20)]]
    order = order[values[order] > _LEAST * strong]
    row, column = row[order], column[order]
    axes = 0.5 * np.arctan2(2 * xy[row, column], xx[row, column] - yy[row, column])
    return np.column_stack([column + 0.5, row + 0.5]), axes.astype(np.float64)


def _seed(middle: int, places: _Array, axes: _Array) -> dict[tuple[int, int], int] | None:
    """Return a saddle with its eight neighbours, or None where they do not lie as on a board."""
    distance = np.linalg.norm(places - places[middle], axis=1)
    around = np.argsort(distance)[:_AROUND]
    off = places[around] - places[middle]
    # Next to each other, light and dark change places: the axes stand upright on each other.
    alike = np.cos(2 * (axes[around] - axes[middle]))
    near = [n for n in np.flatnonzero(alike < -0.5) if distance[around[n]] > 3][:_NEAREST]
    for first, second in product(near, near):
        a, b = off[first], off[second]
        length = np.linalg.norm(a), np.linalg.norm(b)
        # Columns to the right of rows that run down, at an angle of 30 degrees at least.
        if a[0] * b[1] - a[1] * b[0] < 0.5 * length[0] * length[1] or not 0.4 < length[0] / length[1] < 2.5:
            continue
        wanted = np.array([j * a + i * b for i, j in _AT])
        away = np.linalg.norm(off[None] - wanted[:, None], axis=2)
        nearest = away.argmin(axis=1)
        right = (alike[nearest] * _SIGNS > 0.5) & (away.min(axis=1) < _OFF * min(length))
        if right.all() and len(set(nearest.tolist())) == len(_AT):
            return {at: int(around[n]) for at, n in zip(_AT, nearest, strict=True)}
    return None
