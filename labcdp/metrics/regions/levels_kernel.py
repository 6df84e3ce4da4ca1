"""Histogram of pixels by luminance, compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...core.computer.compiled import compiled

_Array = NDArray[np.float64]


@compiled
def light_by_level(
    dn: NDArray[np.uint8], light: _Array, mask: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], _Array, bool]:
    """Count pixels by DN, and find the luminance of each DN.

    Parameters
    ----------
    dn : ndarray of uint8, shape (height, width)
        The pixels.
    light : ndarray of float, shape (height, width)
        Their luminance, in any unit.
    mask : ndarray of bool, shape (height, width)
        Mask of the pixels to count.

    Returns
    -------
    (ndarray of int, shape (256,), ndarray of float, shape (256,), bool)
        Numbers of pixels; luminance, 0 for DN without a pixel; and whether all pixels of a DN have the same finite
        luminance.
    """
    counts = np.zeros(256, dtype=np.int64)
    of_level = np.zeros(256)
    for y in range(dn.shape[0]):
        for x in range(dn.shape[1]):
            if mask[y, x]:
                level, value = dn[y, x], light[y, x]
                if counts[level] == 0:
                    of_level[level] = value
                if of_level[level] != value or not np.isfinite(value):
                    return counts, of_level, False
                counts[level] += 1
    return counts, of_level, True
