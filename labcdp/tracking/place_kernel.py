"""Where a template is in an image and how its shape changed, compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..compiled import compiled
from .matrix_kernel import invert, multiply


@compiled
def box_of(to_image: NDArray[np.float64], width: float, height: float) -> tuple[float, float, float, float]:
    """Left, top, right and bottom end of a template of `width` x `height` pixels in the image; nan if not finite.

    Parameters
    ----------
    to_image : ndarray of float64, shape (3, 3)
        Template pixels to image pixels.
    """
    left = top = np.inf
    right = bottom = -np.inf
    for corner in range(4):
        u, v = width * (corner % 2), height * (corner // 2)
        w = to_image[2, 0] * u + to_image[2, 1] * v + to_image[2, 2]
        x = (to_image[0, 0] * u + to_image[0, 1] * v + to_image[0, 2]) / w
        y = (to_image[1, 0] * u + to_image[1, 1] * v + to_image[1, 2]) / w
        if not (np.isfinite(x) and np.isfinite(y)):
            return np.nan, np.nan, np.nan, np.nan
        left, top, right, bottom = min(left, x), min(top, y), max(right, x), max(bottom, y)
    return left, top, right, bottom


@compiled
def shape_change(
    before: NDArray[np.float64], after: NDArray[np.float64], to_centred: NDArray[np.float64]
) -> tuple[float, float, float, float]:
    """How the shape of a template changed, wherever it went.

    Parameters
    ----------
    before, after : ndarray of float64, shape (3, 3)
        Template pixels to image pixels.
    to_centred : ndarray of float64, shape (3, 3)
        Template pixels to coordinates of -1 to 1 along its longer side.

    Returns
    -------
    longest, shortest : float
        Largest and smallest factor by which lengths grew; nan if there are none.
    turned : float
        Angle by which it was turned, in rad.
    tilted : float
        Perspective over half its size.
    """
    first, second, change = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    invert(before, first)
    multiply(to_centred, first, second)
    multiply(second, after, first)
    invert(to_centred, second)
    multiply(first, second, change)
    whole = change[2, 2]
    if whole == 0:
        return np.nan, np.nan, np.nan, np.nan
    g, h = change[2, 0] / whole, change[2, 1] / whole
    # Where it went does not matter, but how its shape changed.
    x, y = change[0, 2] / whole, change[1, 2] / whole
    a, b = change[0, 0] / whole - x * g, change[0, 1] / whole - x * h
    c, d = change[1, 0] / whole - y * g, change[1, 1] / whole - y * h
    # Singular values of a 2 x 2 matrix.
    plain, mirrored = np.hypot(a + d, c - b), np.hypot(a - d, b + c)
    return (plain + mirrored) / 2, abs(plain - mirrored) / 2, np.arctan2(c - b, a + d), max(abs(g), abs(h))
