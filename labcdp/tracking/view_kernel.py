"""Images reduced, smoothed and looked up between their pixels, compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..compiled import compiled


@compiled
def reduced(
    grey: NDArray[np.uint8], left: int, top: int, right: int, bottom: int, shape: tuple[int, int]
) -> NDArray[np.float32]:
    """Means of the parts of a window of a frame that come to lie under each pixel of a smaller image of `shape`.

    Parameters
    ----------
    grey : ndarray of uint8, shape (height, width)
        The frame, contiguous.
    left, top, right, bottom : int
        The window, in pixels of the frame.
    shape : (int, int)
        Rows and columns, no more than those of the window.
    """
    rows, columns = shape
    small = np.zeros(shape, np.float32)
    high, wide = (bottom - top) / rows, (right - left) / columns
    line = np.empty(right - left, np.float32)
    # Of each column the pixels under it, and how much of each lies there.
    taps = int(np.ceil(wide)) + 1
    under = np.empty((taps, columns), np.uint32)
    shares = np.empty((taps, columns), np.float32)
    for tap in range(taps):
        for column in range(columns):
            x = int(column * wide) + tap
            covered = min(x + 1.0, (column + 1) * wide) - max(float(x), column * wide)
            under[tap, column] = min(x, line.size - 1)
            shares[tap, column] = max(covered, 0.0) / (high * wide)
    for row in range(rows):
        start, stop = row * high, (row + 1) * high
        for x in range(line.size):
            line[x] = np.float32(0)
        for y in range(int(start), min(int(np.ceil(stop)), bottom - top)):
            share = np.float32(min(y + 1.0, stop) - max(float(y), start))
            pixels = grey[top + y, left:right]
            for x in range(line.size):
                line[x] += share * np.float32(pixels[x])
        reduced_row = small[row]
        for tap in range(taps):
            share_of, pixel_of = shares[tap], under[tap]
            for column in range(columns):
                reduced_row[column] += share_of[column] * line[pixel_of[column]]
    return small


@compiled
def smoothed(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Image smoothed by 1 2 1 along both axes, mirrored at its outer pixels; shape (h, w)."""
    height, width = image.shape
    result = np.empty_like(image)
    line = np.empty(width, np.float32)
    second, last_but_one = min(1, width - 1), max(width - 2, 0)
    part = np.float32(1 / 16)
    for row in range(height):
        here, above = image[row], image[row - 1 if row > 0 else min(1, height - 1)]
        below = image[row + 1 if row < height - 1 else max(row - 1, 0)]
        for x in range(width):
            line[x] = here[x] + here[x] + above[x] + below[x]
        result[row, 0] = (line[0] + line[second]) * (part + part)
        result[row, -1] = (line[-1] + line[last_but_one]) * (part + part)
        for x in range(1, width - 1):
            result[row, x] = (line[x - 1] + line[x] + line[x] + line[x + 1]) * part
    return result


@compiled
def between(image: NDArray[np.float32], x: float, y: float) -> float:
    """Value of an image of at least 2 x 2 pixels, bilinear between their middles; beyond these the last ones go on.

    The corner of the first pixel is at (0, 0). Where a coordinate is not a number, it is the first pixel's.
    """
    # The last pixels but one are the last ones from whose right and below there is another.
    width, height = image.shape[1] - 2, image.shape[0] - 2
    x = min(x - 0.5, width + 1.0) if x > 0.5 else 0.0
    y = min(y - 0.5, height + 1.0) if y > 0.5 else 0.0
    left, top = min(int(x), width), min(int(y), height)
    across, down = np.float32(x - left), np.float32(y - top)
    first, second = image[top], image[top + 1]
    upper = first[left] + across * (first[left + 1] - first[left])
    lower = second[left] + across * (second[left + 1] - second[left])
    value: float = upper + down * (lower - upper)
    return value


@compiled
def patch_around(image: NDArray[np.float32], x: float, y: float, scale: float, side: int) -> NDArray[np.uint8]:
    """Colour image of `side` pixels along both axes that has (`x`, `y`) in its middle, `scale` of its pixels for each.

    The three colours are alike: the filters of OpenCV 5 fail on grey images.
    """
    patch = np.empty((side, side, 3), np.uint8)
    for row in range(side):
        for column in range(side):
            value = between(
                image, x + (column + 0.5 - side / 2) / scale, y + (row + 0.5 - side / 2) / scale
            )  # fmt: skip
            for colour in range(3):
                patch[row, column, colour] = np.uint8(value + 0.5)
    return patch
