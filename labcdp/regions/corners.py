"""The inner corners of a checkerboard: which are real, and where those around them are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError

FloatImage: TypeAlias = NDArray[np.float32]
#: Row and column of a corner; any corner of the board may be (0, 0).
At: TypeAlias = tuple[int, int]
#: Places of corners, (x, y) with the centre of the upper left pixel at (0.5, 0.5).
Corners: TypeAlias = dict[At, NDArray[np.float64]]

#: Furthest a corner that is proposed may be from where all others put it, in sides of a square; how many of these are
#: looked at in turn.
_OUTLIER, _DOUBTED = 0.15, 8


def real_corners(corners: Mapping[At, NDArray[np.float64]], image: FloatImage) -> Corners:
    """Return the corners at which light and dark squares meet as the pattern wants, as far as they hang together.

    Parameters
    ----------
    corners : mapping of (int, int) to ndarray of float, shape (2,)
        What a detector proposes.
    image : ndarray of float32, shape (height, width)
        Smoothed a little.
    """
    from scipy.ndimage import label

    strength = {}
    for at, corner in corners.items():
        sides = _around(at, corners)
        strength[at] = 0.0 if sides is None else _saddle(at, corner, *sides, image)
    # The pattern is light where the majority says so.
    sign = np.sign(sum(strength.values()))
    at = np.array(list(corners)) - np.min(list(corners), axis=0)
    kept = np.zeros(at.max(axis=0) + 1, dtype=np.bool_)
    kept[tuple(at.T)] = [strength[one] * sign > 0 for one in corners]
    groups = label(kept)[0][tuple(at.T)]
    largest = np.argmax(np.bincount(groups, minlength=2)[1:]) + 1
    return {one: corners[one] for one, group in sorted(zip(corners, groups, strict=True)) if group == largest}


def without_outliers(corners: Corners) -> Corners:
    """Leave out corners that are not where all others put them, the farthest one first: a detector may be wrong."""
    corners = dict(corners)
    while len(corners) > _DOUBTED // 2:
        lattice = Lattice(corners)
        doubted = sorted(corners, key=lambda at: -lattice.off(at, corners[at], corners))[:_DOUBTED]
        others = {at: {other: place for other, place in corners.items() if other != at} for at in doubted}
        off = {at: Lattice(others[at]).off(at, corners[at], corners) for at in doubted}
        worst = max(off, key=lambda at: off[at])
        if off[worst] <= _OUTLIER:
            break
        del corners[worst]
    return corners


def refined(place: NDArray[np.float64], side_px: float, image: FloatImage) -> NDArray[np.float64]:
    """Return the corner nearest to `place`, found within a quarter of a square."""
    import cv2

    window = int(np.clip(side_px / 4, 2, 12))
    start = (place - 0.5).astype(np.float32).reshape(1, 1, 2)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 0.005)
    end: NDArray[np.float32] = cv2.cornerSubPix(image, start, (window, window), (-1, -1), stop)
    return end.reshape(2).astype(np.float64) + 0.5


class Lattice:
    """The plane of a board: says where corners are that were not seen.

    A homography through all corners known, moved by what those next to the corner deviate from it: a lens bends lines.

    Parameters
    ----------
    corners : mapping of (int, int) to ndarray of float, shape (2,)
        At least four corners that are not on one line.
    """

    def __init__(self, corners: Mapping[At, NDArray[np.float64]]) -> None:
        self._at = np.array([(j, i) for i, j in corners], dtype=np.float64)
        places = np.array(list(corners.values()))
        self._matrix = homography(self._at, places)
        self._deviations = places - projected(self._matrix, self._at)

    def place(self, at: At) -> NDArray[np.float64]:
        """Return where a corner should be; nan if the board gives no plane."""
        i, j = at
        distance = np.abs(self._at - (j, i)).max(axis=1)
        near = distance <= distance.min() + 1
        place: NDArray[np.float64] = projected(self._matrix, np.array([[j, i]], dtype=np.float64))[0]
        return np.asarray(place + self._deviations[near].mean(axis=0))

    def off(self, at: At, corner: NDArray[np.float64], corners: Mapping[At, NDArray[np.float64]]) -> float:
        """Return how far a corner is from where it should be, in sides of the smallest square there."""
        sides = _around(at, corners)
        side_px = min(map(float, np.linalg.norm(sides, axis=1))) if sides is not None else 0.0
        distance = float(np.linalg.norm(self.place(at) - corner))
        return distance / side_px if side_px > 0 and np.isfinite(distance) else 0.0


def homography(at: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the matrix that projects a plane as it was seen; nan if the places give none."""
    import cv2

    found = cv2.findHomography(at, places)[0]
    return np.full((3, 3), np.nan) if found is None else np.asarray(found)


def projected(matrix: NDArray[np.float64], at: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where points of a plane, shape (n, 2), are seen."""
    x, y, w = matrix @ np.column_stack([at, np.ones(len(at))]).T
    return np.column_stack([x / w, y / w])


def _around(
    at: At, corners: Mapping[At, NDArray[np.float64]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return the sides of the squares at a corner along columns and rows, or None where no neighbour is known."""
    sides = []
    for i, j in ((0, 1), (1, 0)):
        near = {sign: (at[0] + sign * i, at[1] + sign * j) for sign in (1, -1)}
        steps = [sign * (corners[other] - corners[at]) for sign, other in near.items() if other in corners]
        if steps:
            sides.append(np.mean(steps, axis=0))
    return (sides[0], sides[1]) if len(sides) == 2 else None


def sampled(image: FloatImage, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values at places (..., 2), between pixels linearly; nan outside the image."""
    from scipy.ndimage import map_coordinates

    at = np.moveaxis(places[..., ::-1] - 0.5, -1, 0)
    return np.asarray(map_coordinates(image, at, np.float64, order=1, cval=np.nan))


def _saddle(
    at: At, corner: NDArray[np.float64], along: NDArray[np.float64], down: NDArray[np.float64], image: FloatImage
) -> float:
    """Return +1 or -1 where two light squares meet two dark ones, by which of them are light; 0 where they do not."""
    # Within each of the four squares: 3 x 3 places from 0.2 to 0.5 sides off the corner.
    near = np.array([0.2, 0.35, 0.5])
    a, b = (v.ravel()[:, None] for v in np.meshgrid(near, near))
    squares = [sampled(image, corner + x * a * along + y * b * down) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    values = np.array(squares)
    if np.isnan(values).any():
        return 0.0
    means, spread = values.mean(axis=1), values.std(axis=1).max()
    step = (means[0] + means[2] - means[1] - means[3]) / 2
    uneven = max(abs(means[0] - means[2]), abs(means[1] - means[3]))
    if abs(step) <= 1.5 * uneven or abs(step) <= 2 * spread:
        return 0.0
    return float(np.sign(step) * (1 if sum(at) % 2 == 0 else -1))


#: Smaller images hold no target.
_SMALLEST_PX = 24

_TINY = float(np.finfo(np.float32).tiny)


def grey_values(grey: NDArray[Any]) -> NDArray[np.float32]:
    """Return the values of an image as finite numbers; pixels without a value get the median.

    Raises
    ------
    InputError
        If it is no 2-D image of at least 24 x 24 pixels, or holds no value.
    """
    grey = np.asarray(grey)
    if grey.ndim != 2 or min(grey.shape) < _SMALLEST_PX:
        raise InputError(
            f"detection needs a grey image of at least {_SMALLEST_PX} x {_SMALLEST_PX} pixels, got the shape "
            f"{grey.shape}"
        )
    values = grey.astype(np.float32)
    finite = np.isfinite(values)
    if not finite.any():
        raise InputError("no pixel of the image has a value: nothing can be detected in it")
    return values if finite.all() else np.where(finite, values, np.median(values[finite])).astype(np.float32)


def stretched(values: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return 8 bits of an image, its darkest and brightest 0.5 % cut off."""
    low, high = (float(limit) for limit in np.percentile(values, (0.5, 99.5)))
    if high <= low:
        low, high = float(values.min()), float(values.max())
    return _in_8_bits((values - low) / max(high - low, _TINY))


def locally_stretched(values: NDArray[np.float32], size_px: float) -> NDArray[np.uint8]:
    """Return 8 bits of an image, each pixel relative to mean and spread within about `size_px` around it."""
    import cv2

    mean = cv2.GaussianBlur(values, (0, 0), size_px)
    spread = np.sqrt(np.maximum(np.asarray(cv2.GaussianBlur((values - mean) ** 2, (0, 0), size_px)), 0))
    floor = 0.05 * float(spread.max())
    return _in_8_bits(0.5 + (values - mean) / (5 * np.maximum(spread, max(floor, _TINY))))


def _in_8_bits(unit: NDArray[np.floating[Any]]) -> NDArray[np.uint8]:
    return np.asarray(np.rint(255 * np.clip(unit, 0, 1)), dtype=np.uint8)
