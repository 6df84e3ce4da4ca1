"""The search window of a region in a frame, at the scale of its template."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import ceil, floor, isfinite

import numpy as np
from numpy.typing import NDArray

from .geometry import Matrix, box_of, local_scale, shift
from .sight import Sight, smooth
from .template import Template

_FROM_CORNER, _TO_CORNER = shift(-0.5, -0.5), shift(0.5, 0.5)


@dataclass(frozen=True, eq=False)
class View:
    """Part of a frame.

    Parameters
    ----------
    values : ndarray of float32, shape (h, w)
        The part, in another size, smoothed as templates are.
    factors : (float, float)
        Pixels of the view for each of the image, along x and y.
    corner : (int, int)
        Where it begins in the image, x and y.
    image_shape : (int, int)
        Height and width of the frame.
    """

    values: NDArray[np.float32]
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

    def under(self, to_image: Matrix, shape: tuple[int, int]) -> NDArray[np.float32]:
        """Values under each pixel of a template of `shape` that lies at `to_image`, interpolated, shape (n,)."""
        return self.sampled(self.from_image @ to_image, shape[::-1])[0]

    def sampled(self, place: Matrix, size: tuple[int, int]) -> tuple[NDArray[np.float32], NDArray[np.bool_] | None]:
        """Values under the pixels of a template of `size` at a place in the view, and which lie in the image.

        None if all do.
        """
        import cv2

        # OpenCV has the middle of the first pixel at 0, we have its corner there.
        centres = _FROM_CORNER @ place @ _TO_CORNER
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        seen = cv2.warpPerspective(self.values, centres, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(seen, dtype=np.float32).ravel(), self._inside(place, size)

    def _inside(self, place: Matrix, size: tuple[int, int]) -> NDArray[np.bool_] | None:
        left, top, right, bottom = self._bounds
        box = box_of(place, *size)
        # A line from one corner to another that passes behind the camera is rare, but its ends may look right.
        a, b, c = place[2].tolist()
        nearest = c + min(a * size[0], 0) + min(b * size[1], 0)
        if nearest > 0 and box[0] > left and box[1] > top and box[2] < right and box[3] < bottom:
            return None
        u, v = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
        x, y, w = np.tensordot(place, np.stack((u, v, np.ones_like(u))), 1)
        inside = (w > 0) & (left * w < x) & (x < right * w) & (top * w < y) & (y < bottom * w)
        return np.asarray(inside.ravel())

    @property
    def _bounds(self) -> tuple[float, float, float, float]:
        """Left, top, right and bottom end of the image in the view."""
        (across, down), (x, y), (height, width) = self.factors, self.corner, self.image_shape
        return -across * x, -down * y, across * (width - x), down * (height - y)


def view_around(sight: Sight, template: Template, to_image: Matrix, reach_px: float) -> View | None:
    """View of where a template should be by `to_image`, with `reach_px` pixels of the frame around; None if outside.

    The view has the size the template would have: a target that comes nearer is reduced more.
    """
    height, width = template.shape
    box = box_of(to_image, width, height)
    scale = local_scale(to_image, (width / 2, height / 2))
    if not isfinite(box[0]) or not isfinite(scale):
        return None
    left, top = max(floor(box[0] - reach_px), 0), max(floor(box[1] - reach_px), 0)
    right, bottom = min(ceil(box[2] + reach_px), sight.shape[1]), min(ceil(box[3] + reach_px), sight.shape[0])
    if right - left < 3 or bottom - top < 3:
        return None
    rows, columns = max(round((bottom - top) / scale), 3), max(round((right - left) / scale), 3)
    values = smooth(sight.reduced(left, top, right, bottom, (columns, rows)))
    return View(values, (columns / (right - left), rows / (bottom - top)), (left, top), sight.shape)
