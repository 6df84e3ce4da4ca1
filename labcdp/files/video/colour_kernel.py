"""From Y', Cb and Cr to luminance, pixel by pixel: twice as fast as whole frames in steps."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.computer import compiled


@compiled
def luminance_of_ycbcr(
    luma: NDArray[Any],
    blue: NDArray[Any],
    red: NDArray[Any],
    group: tuple[int, int],
    parts: NDArray[np.float32],
    light: NDArray[np.float32],
    clips_from: int,
) -> tuple[NDArray[np.uint16], NDArray[np.bool_]]:
    """Luminance of Y', Cb and Cr, and whether a colour is at its end.

    `parts` have, by value, Y', what Cr adds to red and green, and what Cb adds to green and blue; `light` the parts of
    whole red, green and blue in the luminance. Colours clip from a value of `clips_from`. A `group` of so many rows and
    columns has one Cb and Cr.
    """
    height, width = luma.shape
    down, across = group
    luminance, clipped = np.empty((height, width), np.uint16), np.empty((height, width), np.bool_)
    half, none, top = np.float32(0.5), np.float32(0), np.float32(light.shape[1] - 1)
    for y in range(height):
        # One division for each row and each Cb: they take longer than all else.
        of_row = y // down
        for column in range(blue.shape[1]):
            cb, cr = blue[of_row, column], red[of_row, column]
            to_red, to_green, to_blue = parts[1, cr], parts[2, cr] + parts[3, cb], parts[4, cb]
            for x in range(column * across, min((column + 1) * across, width)):
                grey = parts[0, luma[y, x]] + half
                r = np.int64(min(max(grey + to_red, none), top))
                g = np.int64(min(max(grey + to_green, none), top))
                b = np.int64(min(max(grey + to_blue, none), top))
                total = light[0, r] + light[1, g] + light[2, b] + half
                luminance[y, x] = np.uint16(min(total, np.float32(65535)))
                clipped[y, x] = max(r, g, b) >= clips_from
    return luminance, clipped
