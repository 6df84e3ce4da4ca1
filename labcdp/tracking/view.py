"""The part of a frame in which a region is looked for, in the size of its template."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import ceil, floor, isfinite

import numpy as np
from numpy.typing import NDArray

from .geometry import Matrix, local_scale, moved
from .template import Template, smooth


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
    def to_image(self) -> Matrix:
        """The view's pixels to image pixels."""
        (across, down), (x, y) = self.factors, self.corner
        return np.array([[1 / across, 0.0, x], [0.0, 1 / down, y], [0.0, 0.0, 1.0]])

    @cached_property
    def sharp(self) -> NDArray[np.uint8]:
        """The view in whole DN, shape (h, w)."""
        return np.rint(self.pixels).astype(np.uint8)

    @cached_property
    def values(self) -> NDArray[np.float32]:
        """The view smoothed as templates are."""
        return smooth(self.pixels)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Left, top, right and bottom end of the image in the view."""
        (across, down), (x, y) = self.factors, self.corner
        height, width = self.image_shape
        return -across * x, -down * y, across * (width - x), down * (height - y)


def view_around(grey: NDArray[np.uint8], template: Template, to_image: Matrix, reach_px: float) -> View | None:
    """View of where a template should be by `to_image`, with `reach_px` pixels of the frame around; None if outside.

    The view has the size the template would have: a target that comes nearer is reduced more.
    """
    height, width = template.shape
    corners = [moved(to_image, x, y) for x, y in ((0, 0), (width, 0), (width, height), (0, height))]
    scale = local_scale(to_image, (width / 2, height / 2))
    if not all(isfinite(x) and isfinite(y) for x, y in corners) or not isfinite(scale):
        return None
    xs, ys = zip(*corners, strict=True)
    box = min(xs) - reach_px, min(ys) - reach_px, max(xs) + reach_px, max(ys) + reach_px
    return view_of(grey, box, 1 / scale)


def view_of(grey: NDArray[np.uint8], box: tuple[float, float, float, float], reduction: float) -> View | None:
    """View of a `box` (left, top, right, bottom) of the frame, `reduction` view pixels for each; None if outside."""
    import cv2

    from .view_kernel import reduced

    height, width = grey.shape
    left, top = max(floor(box[0]), 0), max(floor(box[1]), 0)
    right, bottom = min(ceil(box[2]), width), min(ceil(box[3]), height)
    if right - left < 3 or bottom - top < 3:
        return None
    rows, columns = max(round(reduction * (bottom - top)), 3), max(round(reduction * (right - left)), 3)
    if rows <= bottom - top and columns <= right - left:
        pixels = reduced(grey, left, top, right, bottom, (rows, columns))
    else:
        part = grey[top:bottom, left:right].astype(np.float32)
        pixels = np.asarray(cv2.resize(part, (columns, rows), interpolation=cv2.INTER_LINEAR))
    return View(pixels, (columns / (right - left), rows / (bottom - top)), (left, top), (height, width))
