"""The inner corners of a checkerboard: checks of detected ones, and positions of those around them."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError

FloatImage: TypeAlias = NDArray[np.float32]
#: Places of corners by row and column, shape (rows, columns, 2): (x, y) with the centre of the upper left pixel at
#: (0.5, 0.5); nan where none is known.
Corners: TypeAlias = NDArray[np.float64]

#: Furthest a corner that is proposed may be from where all others put it, in sides of a square; how many of these are
#: looked at in turn.
_OUTLIER, _DOUBTED = 0.15, 8


def known(corners: Corners) -> NDArray[np.bool_]:
    """Return which corners are known, shape (rows, columns)."""
    return np.isfinite(corners[..., 0])


def real_corners(corners: Corners, image: FloatImage) -> Corners:
    """Return the corners at which light and dark squares meet as the pattern wants, as far as they hang together.

    Parameters
    ----------
    corners : ndarray of float, shape (rows, columns, 2)
        Corners that a detector proposes.
    image : ndarray of float32, shape (height, width)
        Smoothed a little.
    """
    from scipy.ndimage import label

    light = _saddles(corners, image)
    # The pattern is light where the majority says so.
    groups, _ = label(light * np.sign(light.sum()) > 0)
    largest = np.argmax(np.bincount(groups.ravel(), minlength=2)[1:]) + 1
    return np.where((groups == largest)[..., None], corners, np.nan)


def without_outliers(corners: Corners) -> Corners:
    """Leave out corners that are not where all others put them, the farthest one first: a detector may be wrong."""
    corners = corners.copy()
    while known(corners).sum() > _DOUBTED // 2:
        far = np.argsort(-_deviations(corners, expected(corners)), axis=None, kind="stable")[:_DOUBTED]
        off = {}
        for at in zip(*np.unravel_index(far, corners.shape[:2]), strict=True):
            others = corners.copy()
            others[at] = np.nan
            off[at] = _deviations(corners, expected(others))[at]
        worst = max(off, key=lambda at: off[at])
        if off[worst] <= _OUTLIER:
            break
        corners[worst] = np.nan
    return corners


def expected(corners: Corners) -> Corners:
    """Return where each corner should be, also those next to known ones; nan if the board gives no plane.

    A homography through all corners known, moved by what those next to the corner deviate from it: a lens bends lines.
    """
    import cv2

    where = known(corners)
    at, places = (np.argwhere(cells)[:, ::-1].astype(np.float64) for cells in (where, np.ones_like(where)))
    plane = projected(homography(at, corners[where]), places).reshape(corners.shape)
    deviations = np.where(where[..., None], corners - plane, 0.0)

    def near(size: int) -> NDArray[np.float64]:
        """Mean deviation of the known corners in a square around each place."""
        how: dict[str, Any] = {"normalize": False, "borderType": cv2.BORDER_CONSTANT}
        total, count = (
            cv2.boxFilter(values, -1, (size, size), **how) for values in (deviations, where.astype(np.float64))
        )
        return np.asarray(total / np.maximum(count, 1)[..., None])

    # A corner that is not known is one step further from the others.
    return np.asarray(plane + np.where(where[..., None], near(3), near(5)))


def _deviations(corners: Corners, places: Corners) -> NDArray[np.float64]:
    """Return how far corners are from where they should be, in sides of the smallest square there; 0 if unknown."""
    side_px = np.linalg.norm(_sides(corners), axis=-1).min(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        off = np.linalg.norm(places - corners, axis=-1) / side_px
    return np.asarray(np.nan_to_num(off, posinf=0.0))


def homography(at: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the matrix that projects a plane as it was seen; nan if the places give none."""
    import cv2

    matrix = cv2.findHomography(at, places)[0]
    return np.full((3, 3), np.nan) if matrix is None else np.asarray(matrix)


def projected(matrix: NDArray[np.float64], at: NDArray[Any]) -> NDArray[np.float64]:
    """Return where points of a plane, shape (n, 2), are seen."""
    x, y, w = matrix @ np.column_stack([at, np.ones(len(at))]).T
    return np.column_stack([x / w, y / w])


def _sides(corners: Corners) -> NDArray[np.float64]:
    """Return the mean sides of the squares at each corner along rows and columns, shape (2, rows, columns, 2)."""
    sides = []
    for axis in (1, 0):
        steps = np.moveaxis(np.diff(corners, axis=axis, prepend=np.nan, append=np.nan), axis, 0)
        before, after = steps[:-1], steps[1:]
        either = np.where(np.isnan(before), after, before)
        both = np.isfinite(before) & np.isfinite(after)
        sides.append(np.moveaxis(np.where(both, (before + after) / 2, either), 0, axis))
    return np.array(sides)


def sampled(image: FloatImage, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values at places (..., 2), between pixels linearly; nan outside the image, and for no place."""
    from scipy.ndimage import map_coordinates

    at = np.moveaxis(places[..., ::-1] - 0.5, -1, 0)
    return np.asarray(map_coordinates(image, np.nan_to_num(at, nan=-9.0), np.float64, order=1, cval=np.nan))


def _saddles(corners: Corners, image: FloatImage) -> NDArray[np.float64]:
    """Return +1 or -1 where two light squares meet two dark ones, depending on which are light; 0 elsewhere."""
    along, down = (sides[..., None, :] for sides in _sides(corners))
    # Within each of the four squares: 3 x 3 places from 0.2 to 0.5 sides off the corner.
    near = np.array([0.2, 0.35, 0.5])
    a, b = (v.ravel()[:, None] for v in np.meshgrid(near, near))
    middle = corners[..., None, :]
    around = [middle + x * a * along + y * b * down for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    values = sampled(image, np.array(around))
    means, spread = values.mean(axis=-1), values.std(axis=-1).max(axis=0)
    step = (means[0] + means[2] - means[1] - means[3]) / 2
    uneven = np.maximum(np.abs(means[0] - means[2]), np.abs(means[1] - means[3]))
    clear = np.abs(step) > np.maximum(1.5 * uneven, 2 * spread)
    return np.where(clear, np.sign(step) * (1 - 2 * odd_places(step.shape)), 0.0)


def odd_places(shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Return which places of a board have an odd sum of row and column."""
    return np.asarray(np.indices(shape).sum(axis=0) % 2 == 1)


#: Smaller images hold no target; larger ones are reduced to so many pixels along their longer side.
_SMALLEST_PX, LONGEST_PX = 24, 1600

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


def reduced(values: FloatImage) -> tuple[FloatImage, float]:
    """Return an image in which targets are searched, and its scale."""
    import cv2

    scale = min(1.0, LONGEST_PX / max(values.shape))
    if scale == 1:
        return values, scale
    return np.asarray(cv2.resize(values, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)), scale


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
