"""Nearest-neighbour contrast detection probability, for images with a pattern of single pixels."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import isfinite
from operator import index
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.errors import InputError
from ...core.roi import clipped_rectangle
from ..arrays import check_exact, image_array
from ..contrast import ContrastDefinition, Epsilon, TargetContrast
from ..pairs import RELATIVE_TOLERANCE
from ..result import DetectionProbability, NeighbourCdp, asked_contrasts, joined
from .marks import MarkSums, result_of_counts

#: Rows compared at once, to limit temporary memory.
_ROWS = 64


@overload
def cdp_neighbours(
    image: ArrayLike, contrast: float, epsilon: Epsilon = ..., *, definition: ContrastDefinition = ...
) -> DetectionProbability[float]: ...
@overload
def cdp_neighbours(
    image: ArrayLike,
    contrast: Sequence[float] | NDArray[Any],
    epsilon: Epsilon = ...,
    *,
    definition: ContrastDefinition = ...,
) -> DetectionProbability[NDArray[np.float64]]: ...
def cdp_neighbours(
    image: ArrayLike, contrast: ArrayLike, epsilon: Epsilon = 0.5, *, definition: ContrastDefinition = "weber"
) -> DetectionProbability[Any]:
    """Contrast detection probability of each pixel against its right and its lower neighbour.

    Parameters
    ----------
    image : array_like of int or float, shape (height, width)
        At least two pixels in one linear unit, best cd/m^2; for example a checkerboard with squares of one pixel.
    contrast, epsilon, definition
        As for `cdp`; contrast may be an array.

    Returns
    -------
    DetectionProbability

    Raises
    ------
    InputError
        If contrast or epsilon is out of range, or the image is not of two dimensions, is masked, holds fewer than two
        pixels, values that are not finite or not integers or floats, or none above 0.

    Notes
    -----
    The larger value of a pair is compared with the smaller one (L. Ebbert, Implementierung von CDP, 2018), so no
    contrast is below 0; ends, tolerance and values of 0 and below are treated as by `cdp`. The standard error accounts
    for the dependence of pairs with common pixels, and of rows and columns with a pattern (see
    `MarkSums.variance`). It is nan for fewer than 8 rows or columns.
    """
    asked, shape = asked_contrasts(contrast, epsilon, definition)
    values = _usable(image_array(image))
    return joined([_cdp_of(values, one) for one in asked], asked, shape, epsilon, definition, _pairs(values))


def cdp_neighbours_range(
    image: ArrayLike, contrasts: Iterable[float], epsilon: Epsilon = 0.5, *, definition: ContrastDefinition = "weber"
) -> tuple[NeighbourCdp, ...]:
    """Nearest-neighbour contrast detection probability at several contrasts, as one record each.

    Parameters
    ----------
    image, epsilon, definition
        As for `cdp_neighbours`.
    contrasts : iterable of float
        Contrasts; for equal steps see `contrast_range`.

    Returns
    -------
    tuple of NeighbourCdp
        One for each contrast.

    Raises
    ------
    InputError
        As `cdp_neighbours`.
    """
    asked = [TargetContrast(contrast, epsilon, definition) for contrast in contrasts]
    values = _usable(image_array(image))
    return tuple(_cdp_of(values, one) for one in asked)


def cdp_rectangle(
    image: ArrayLike,
    corner1: tuple[int, int],
    corner2: tuple[int, int],
    contrast: float | Sequence[float] | NDArray[Any],
    epsilon: Epsilon = 0.5,
    *,
    definition: ContrastDefinition = "weber",
) -> DetectionProbability[Any]:
    """Nearest-neighbour contrast detection probability inside a rectangle.

    Parameters
    ----------
    image : array_like of int or float, shape (height, width)
        Only the part inside the rectangle must be finite.
    corner1, corner2 : (int, int)
        Opposite corner pixels (x, y), x to the right and y down from (0, 0), in any order. Both are included. The
        rectangle is clipped to the image.
    contrast, epsilon, definition
        As for `cdp`.

    Returns
    -------
    DetectionProbability
        As from `cdp_neighbours`.

    Raises
    ------
    InputError
        As `cdp_neighbours`; and if a corner is not a pair of integers, or the rectangle lies outside the image.
    """
    pixels = image_array(image)
    height, width = pixels.shape
    try:
        (xa, ya), (xb, yb) = (tuple(map(index, corner)) for corner in (corner1, corner2))
    except (TypeError, ValueError) as error:
        raise InputError(f"corners are {corner1} and {corner2}: give two pixels (x, y) as integers") from error
    left, top, right, bottom = clipped_rectangle((xa, ya, xb, yb), width, height)
    return cdp_neighbours(pixels[top : bottom + 1, left : right + 1], contrast, epsilon, definition=definition)


def _usable(image: NDArray[np.generic]) -> NDArray[np.float64]:
    if image.size < 2:
        raise InputError(f"the image holds {image.size} pixels: give at least two, or there is no neighbour")
    if image.dtype.kind in "iu":
        check_exact(image, "image")
    values = image.astype(np.float64, copy=False)
    finite = np.isfinite(values)
    if not finite.all():
        raise InputError(
            f"the image holds {np.count_nonzero(~finite)} values that are not finite: correct them or crop the image"
        )
    if values.max() <= 0:
        raise InputError("the image holds no value above 0, so no contrast is defined: check exposure and black level")
    return values


def _cdp_of(values: NDArray[np.float64], asked: TargetContrast) -> NeighbourCdp:
    height, pairs = values.shape[0], _pairs(values)
    counts = np.zeros(3, dtype=np.int64)
    detected = np.zeros(values.shape, dtype=np.int8)  # pairs of each pixel with its right and its lower neighbour
    for start in range(0, height, _ROWS):
        block = values[start : start + _ROWS + 1]
        rows, marks = block[:_ROWS], detected[start : start + _ROWS]
        counts += _compare(rows[:, :-1], rows[:, 1:], asked, marks[:, :-1])
        counts += _compare(block[:-1], block[1:], asked, marks[: len(block) - 1])
    return result_of_counts(asked, pairs, counts.tolist(), MarkSums.of(detected))


def _pairs(values: NDArray[np.float64]) -> int:
    height, width = map(int, values.shape)
    return height * (width - 1) + (height - 1) * width


def _compare(
    first: NDArray[np.float64], second: NDArray[np.float64], asked: TargetContrast, marks: NDArray[np.int8]
) -> tuple[int, int, int]:
    """Add the detected pairs to `marks`; count the undefined ones, those below, and those up to the upper end."""
    larger, smaller = np.maximum(first, second), np.maximum(np.minimum(first, second), 0)
    undefined = larger <= 0
    below, up_to = undefined, np.ones_like(undefined)
    low, high = asked.ratios
    with np.errstate(over="ignore"):
        if isfinite(low):
            below = larger <= smaller * (low * (1 - RELATIVE_TOLERANCE))
        if isfinite(high):
            up_to = larger <= smaller * (high * (1 + RELATIVE_TOLERANCE))
    marks += up_to & ~below
    return int(np.count_nonzero(undefined)), int(np.count_nonzero(below)), int(np.count_nonzero(up_to))
