"""Images as detection takes them: one value a pixel, and 8 bits of it where OpenCV wants them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError

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
