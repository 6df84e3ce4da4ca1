"""The part of a frame in which a region is looked for, in the size of its template."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import ceil, floor, isfinite

import numpy as np
from numpy.typing import NDArray

from .geometry import Matrix, local_scale
from .place_kernel import box_of
from .template import Template, smooth
from .view_kernel import reduced


@dataclass(frozen=True, eq=False)
class View:
    """Part of a frame.

    Parameters
    ----------
    pixels : ndarray of float32, shape (h, w)
        The part, in another size; beyond the image its last pixels are repeated.
    factors : (float, float)
        Pixels of the view for each of the image, along x and y.
    corner : (int, int)
        Where it begins in the image, x and y.
    image_shape : (int, int)
        Height and width of the frame.
    """

    pixels: NDArray[np.float32]
    factors: tuple[float, float]
    corner: tuple[int, int]
    image_shape: tuple[int, int]

    @cached_property
    def from_image(self) -> Matrix:
        """Image pixels to the view's pixels."""
        (across, down), (x, y) = self.factors, self.corner
        return np.array([[across, 0.0, -across * x], [0.0, down, -down * y], [0.0, 0.0, 1.0]])

    @cached_property
    def sharp(self) -> NDArray[np.uint8]:
        """The view in whole DN, shape (h, w)."""
        return np.rint(self.pixels).astype(np.uint8)

    @cached_property
    def values(self) -> NDArray[np.float32]:
        """The view smoothed as templates are."""
        return smooth(self.pixels)


def view_around(grey: NDArray[np.uint8], template: Template, to_image: Matrix, reach_px: float) -> View | None:
    """View of where a template should be by `to_image`, with `reach_px` pixels of the frame around; None if outside.

    The view has the size the template would have: a target that comes nearer is reduced more.
    """
    height, width = template.shape
    left, top, right, bottom = box_of(to_image, width, height)
    scale = local_scale(to_image, (width / 2, height / 2))
    if not isfinite(left) or not isfinite(scale):
        return None
    return view_of(grey, (left - reach_px, top - reach_px, right + reach_px, bottom + reach_px), 1 / scale)


def view_of(grey: NDArray[np.uint8], box: tuple[float, float, float, float], reduction: float) -> View | None:
    """View of a `box` (left, top, right, bottom) of the frame, `reduction` view pixels for each; None if outside."""
    height, width = grey.shape
    left, top = max(floor(box[0]), 0), max(floor(box[1]), 0)
    right, bottom = min(ceil(box[2]), width), min(ceil(box[3]), height)
    if right - left < 3 or bottom - top < 3:
        return None
    rows, columns = max(round(reduction * (bottom - top)), 3), max(round(reduction * (right - left)), 3)
    if rows <= bottom - top and columns <= right - left:
        pixels = reduced(grey, left, top, right, bottom, (rows, columns))
    else:
        import cv2

        part = grey[top:bottom, left:right].astype(np.float32)
        pixels = np.asarray(cv2.resize(part, (columns, rows), interpolation=cv2.INTER_LINEAR))
    return View(pixels, (columns / (right - left), rows / (bottom - top)), (left, top), (height, width))
