"""Arrays that metrics take: checked, or refused with a reason."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError

#: Largest integer below which float64 holds every integer.
_LARGEST_INTEGER = 2**53
#: Largest light: the fourth power of more, in sums of pixels, would leave float64.
_LARGEST_LIGHT = 1e60


def check_exact(integers: NDArray[Any], name: str) -> tuple[int, int]:
    """Return the smallest and the largest of an array of integers, at least one.

    Raises
    ------
    InputError
        If one is beyond 2^53, which float64 would round.
    """
    lowest, highest = int(integers.min()), int(integers.max())
    if max(-lowest, highest) > _LARGEST_INTEGER:
        raise InputError(f"{name} spans {lowest} to {highest}: give integers up to 2^53, or floating-point numbers")
    return lowest, highest


def numeric_array(values: ArrayLike, name: str) -> NDArray[Any]:
    """Return an array of integers or floats of at most 64 bit.

    Raises
    ------
    InputError
        If the values are anything else, or a masked array, whose mask would silently be dropped.
    """
    if isinstance(values, np.ma.MaskedArray):
        raise InputError(f"{name} is a masked array: give its valid pixels with .compressed()")
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise InputError(f"{name} is not an array: {error}") from error
    if array.dtype.kind not in "iuf" or array.dtype.itemsize > 8:
        raise InputError(f"{name} has type {array.dtype}: give integers or floats of at most 64 bit")
    return array


def light_array(values: ArrayLike, name: str) -> NDArray[np.float64]:
    """Return light as an array of float64; values that are not finite are kept.

    Raises
    ------
    InputError
        If it is no array of numbers, or masked, or a finite value is so large that its powers would overflow.
    """
    light = numeric_array(values, name).astype(np.float64)
    largest = float(np.abs(light).max(initial=0.0, where=np.isfinite(light)))
    if largest > _LARGEST_LIGHT:
        raise InputError(f"{name} reaches {largest:.3g}: give light up to {_LARGEST_LIGHT:g}")
    return light


def image_array(image: ArrayLike) -> NDArray[Any]:
    """Return an image as an array of integers or floats of two dimensions.

    Raises
    ------
    InputError
        If it has another number of dimensions, is masked, or is not of integers or floats of at most 64 bit.
    """
    array = numeric_array(image, "image")
    if array.ndim != 2:
        raise InputError(f"the image has {array.ndim} dimensions: give one of shape (height, width)")
    return array


def mask_array(mask: ArrayLike, shape: tuple[int, ...], name: str) -> NDArray[np.bool_]:
    """Return a mask of an image as a boolean array.

    Raises
    ------
    InputError
        If it is not boolean, not of the image's `shape`, or marks no pixel.
    """
    array = np.asarray(mask)
    if array.dtype != np.bool_ or array.shape != shape:
        raise InputError(
            f"{name} has type {array.dtype} and shape {array.shape}: give booleans of the image's shape {shape}"
        )
    if not array.any():
        raise InputError(f"{name} marks no pixel: mark at least one")
    return array


def window_of(mask: NDArray[np.bool_]) -> tuple[slice, slice]:
    """Bounding box of a mask, as slices of rows and columns."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
