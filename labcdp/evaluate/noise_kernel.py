"""Passes over the pixels of a region for the correlation of their noise, compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..compiled import compiled

_Array = NDArray[np.float64]


@compiled
def centred(image: _Array, mask: NDArray[np.bool_]) -> tuple[_Array, bool]:
    """Image less the mean of its pixels in a mask.

    Parameters
    ----------
    image : ndarray of float, shape (height, width)
        The image, in any unit.
    mask : ndarray of bool, shape (height, width)
        The pixels that count, at least one.

    Returns
    -------
    (ndarray of float, shape (height, width), bool)
        In the same unit, 0 outside the mask; and whether the pixels are not all equal.
    """
    height, width = image.shape
    total, n = 0.0, 0
    lowest, highest = np.inf, -np.inf
    for y in range(height):
        for x in range(width):
            inside = mask[y, x]
            value = image[y, x]
            total += value if inside else 0.0
            n += inside
            lowest = min(lowest, value if inside else np.inf)
            highest = max(highest, value if inside else -np.inf)
    mean = total / n
    level = np.empty((height, width))
    for y in range(height):
        for x in range(width):
            level[y, x] = image[y, x] - mean if mask[y, x] else 0.0
    return level, lowest < highest


@compiled
def in_blocks(level: _Array, mask: NDArray[np.bool_], side: int) -> tuple[_Array, NDArray[np.bool_]]:
    """Means of square blocks, times the root of their pixels, so that independent pixels keep their variance.

    Parameters
    ----------
    level : ndarray of float, shape (height, width)
        The image, 0 outside the mask.
    mask : ndarray of bool, shape (height, width)
        Its pixels that count.
    side : int
        Rows and columns of a block.

    Returns
    -------
    (ndarray of float, ndarray of bool), shape (rows, columns)
        In the unit of the image, 0 for a block that does not count; and which do: whole ones, as others would show an
        even change of light in another height.
    """
    height, width = level.shape
    means = np.empty(((height + side - 1) // side, (width + side - 1) // side))
    inside = np.empty(means.shape, np.bool_)
    for row in range(means.shape[0]):
        for column in range(means.shape[1]):
            total, n = 0.0, 0
            for y in range(row * side, min((row + 1) * side, height)):
                for x in range(column * side, min((column + 1) * side, width)):
                    total += level[y, x]
                    n += mask[y, x]
            inside[row, column] = n == side * side
            means[row, column] = total / side if inside[row, column] else 0.0
    return means, inside


@compiled
def sums_along_axes(level: _Array) -> tuple[float, _Array, _Array]:
    """Sum of the squares of an image, its sums along y and its sums along x.

    Parameters
    ----------
    level : ndarray of float, shape (height, width)
        The image, 0 where it does not count.

    Returns
    -------
    (float, ndarray of float, shape (width,), ndarray of float, shape (height,))
        The first in the square of the unit of the image.
    """
    height, width = level.shape
    square = 0.0
    columns, rows = np.zeros(width), np.zeros(height)
    for y in range(height):
        row = 0.0
        for x in range(width):
            value = level[y, x]
            row += value
            square += value * value
            columns[x] += value
        rows[y] = row
    return square, columns, rows


@compiled
def with_surfaces(level: _Array, down: _Array, right: _Array) -> _Array:
    """Sum the products of an image with surfaces that are products of a line along y and one along x.

    Parameters
    ----------
    level : ndarray of float, shape (height, width)
        The image, 0 where it does not count.
    down, right : ndarray of float, shape (k, height) and (k, width)
        The lines, without a unit.

    Returns
    -------
    ndarray of float, shape (k, k)
        By the line along y and the line along x, in the unit of the image.
    """
    count = down.shape[0]
    sums = np.zeros((count, count))
    for y in range(level.shape[0]):
        for j in range(count):
            along_row = 0.0
            for x in range(level.shape[1]):
                along_row += level[y, x] * right[j, x]
            for i in range(count):
                sums[i, j] += down[i, y] * along_row
    return sums


@compiled
def less_surface(level: _Array, mask: NDArray[np.bool_], down: _Array, right: _Array, factors: _Array) -> _Array:
    """Image less a sum of surfaces that are products of a line along y and one along x.

    Parameters
    ----------
    level : ndarray of float, shape (height, width)
        The image.
    mask : ndarray of bool, shape (height, width)
        Its pixels that count.
    down, right : ndarray of float, shape (k, height) and (k, width)
        The lines, without a unit.
    factors : ndarray of float, shape (k, k)
        Of the surfaces, by the line along y and the line along x, in the unit of the image.

    Returns
    -------
    ndarray of float, shape (height, width)
        In the unit of the image, 0 outside the mask.
    """
    height, width = level.shape
    rest = level.copy()
    for y in range(height):
        for j in range(right.shape[0]):
            factor = 0.0
            for i in range(down.shape[0]):
                factor += down[i, y] * factors[i, j]
            if factor != 0:
                for x in range(width):
                    rest[y, x] -= factor * right[j, x]
        for x in range(width):
            if not mask[y, x]:
                rest[y, x] = 0.0
    return rest
