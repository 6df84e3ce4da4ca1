"""The part of a frame in which a region is looked for, in the size of its template."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import ceil, floor

import numpy as np
from numpy.typing import NDArray

from .geometry import Matrix, local_scale, scaling, shift, transform
from .template import Template, smooth


@dataclass(frozen=True, eq=False)
class View:
    """Part of a frame.

    Parameters
    ----------
    sharp : ndarray of uint8, shape (h, w)
        The part, in another size; beyond the image its last pixels are repeated.
    from_image : ndarray of float, shape (3, 3)
        Image pixels to the view's pixels.
    image_shape : (int, int)
        Height and width of the frame.
    """

    sharp: NDArray[np.uint8]
    from_image: Matrix
    image_shape: tuple[int, int]

    @cached_property
    def values(self) -> NDArray[np.float32]:
        """The view smoothed as templates are."""
        return smooth(self.sharp.astype(np.float32))

    @cached_property
    def bounds(self) -> tuple[float, float, float, float]:
        """Left, top, right and bottom end of the image in the view."""
        height, width = self.image_shape
        (left, top), (right, bottom) = transform(self.from_image, np.array([(0, 0), (width, height)]))
        return float(left), float(top), float(right), float(bottom)


def view_around(grey: NDArray[np.uint8], template: Template, to_image: Matrix, reach_px: float) -> View | None:
    """View of where a template should be by `to_image`, with `reach_px` pixels of the frame around; None if outside.

    The view has the size the template would have: a target that comes nearer is reduced more.
    """
    height, width = template.shape
    corners = transform(to_image, np.array([(0, 0), (width, 0), (width, height), (0, height)], dtype=float))
    scale = local_scale(to_image, (width / 2, height / 2))
    if not np.isfinite(corners).all() or not np.isfinite(scale):
        return None
    low, high = corners.min(axis=0) - reach_px, corners.max(axis=0) + reach_px
    return view_of(grey, (float(low[0]), float(low[1]), float(high[0]), float(high[1])), 1 / scale)


def view_of(grey: NDArray[np.uint8], box: tuple[float, float, float, float], reduction: float) -> View | None:
    """View of a `box` (left, top, right, bottom) of the frame, `reduction` view pixels for each; None if outside."""
    import cv2

    height, width = grey.shape
    left, top = max(floor(box[0]), 0), max(floor(box[1]), 0)
    right, bottom = min(ceil(box[2]), width), min(ceil(box[3]), height)
    if right - left < 3 or bottom - top < 3:
        return None
    part = grey[top:bottom, left:right]
    size = max(round(reduction * (right - left)), 3), max(round(reduction * (bottom - top)), 3)
    how = cv2.INTER_AREA if reduction < 1 else cv2.INTER_LINEAR
    sharp = part if size == part.shape[::-1] else cv2.resize(part, size, interpolation=how)
    factors = size[0] / (right - left), size[1] / (bottom - top)
    return View(np.ascontiguousarray(sharp), scaling(*factors) @ shift(-left, -top), (height, width))
