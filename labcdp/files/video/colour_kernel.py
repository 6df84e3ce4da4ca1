"""From Y', Cb and Cr to luminance, pixel by pixel: twice as fast as whole frames in steps."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.computer import compiled


@compiled
def luminance_of_ycbcr(
    luma: NDArray[Any], blue: NDArray[Any], red: NDArray[Any], parts: NDArray[np.float32], light: NDArray[np.float32]
) -> tuple[NDArray[np.uint16], NDArray[np.bool_]]:
    """Luminance of Y', Cb and Cr, and whether a colour is at its end.

    `parts` have, by value, Y', what Cr adds to red and green, and what Cb adds to green and blue; `light` the parts of
    whole red, green and blue in the luminance. Of several pixels with one Cb and Cr all have the same.
    """
    height, width = luma.shape
    down, across = -(-height // blue.shape[0]), -(-width // blue.shape[1])
    luminance, clipped = np.empty((height, width), np.uint16), np.empty((height, width), np.bool_)
    half, none, top = np.float32(0.5), np.float32(0), np.float32(light.shape[1] - 1)
    for y in range(height):
        for x in range(width):
            grey = parts[0, luma[y, x]] + half
            cb, cr = blue[y // down, x // across], red[y // down, x // across]
            r = np.int64(min(max(grey + parts[1, cr], none), top))
            g = np.int64(min(max(grey + (parts[2, cr] + parts[3, cb]), none), top))
            b = np.int64(min(max(grey + parts[4, cb], none), top))
            total = light[0, r] + light[1, g] + light[2, b] + half
            luminance[y, x] = np.uint16(min(total, np.float32(65535)))
            clipped[y, x] = max(r, g, b) == light.shape[1] - 1
    return luminance, clipped
