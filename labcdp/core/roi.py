"""Regions of interest: named rectangles and polygons in pixel coordinates."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import ceil, floor, isfinite
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from .errors import InputError
from .result import html_table


@dataclass(frozen=True)
class Roi:
    """A named region, given by the corners of a simple polygon.

    A pixel belongs to the region if its centre does. The centre of the upper left pixel of an image is at
    (0.5, 0.5), so the rectangle with corners (0, 0) and (w, h) holds exactly w x h pixels.

    Parameters
    ----------
    name : str
        What messages and tables call the region.
    corners : tuple of (float, float)
        At least three (x, y) corners in pixels, x to the right, y down, in order around the region.

    Raises
    ------
    InputError
        If there are fewer than three corners or one is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp import Roi
    >>> road = Roi.rectangle("road", x=1, y=0, width=2, height=2)
    >>> road.select(np.arange(12).reshape(3, 4)).tolist()
    [1, 2, 5, 6]
    """

    name: str
    corners: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        corners = tuple((float(x), float(y)) for x, y in self.corners)
        if len(corners) < 3:
            raise InputError(f"region {self.name!r} has {len(corners)} corners: give at least 3")
        if not all(isfinite(v) for corner in corners for v in corner):
            raise InputError(f"region {self.name!r} has a corner that is not a finite number")
        object.__setattr__(self, "corners", corners)

    @classmethod
    def rectangle(cls, name: str, x: float, y: float, width: float, height: float) -> Roi:
        """Make the region of `width` x `height` pixels whose upper left corner is (`x`, `y`).

        Raises
        ------
        InputError
            If width or height is not positive.
        """
        if not (width > 0 and height > 0):
            raise InputError(f"region {name!r} is {width} x {height} pixels: give a width and height above 0")
        return cls(name, ((x, y), (x + width, y), (x + width, y + height), (x, y + height)))

    def _repr_html_(self) -> str:
        """Table for notebooks."""
        return regions_table([self])

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Smallest x, smallest y, largest x, largest y of the corners."""
        xs, ys = zip(*self.corners, strict=True)
        return min(xs), min(ys), max(xs), max(ys)

    @property
    def centre(self) -> tuple[float, float]:
        """Middle (x, y) of the bounding rectangle."""
        x0, y0, x1, y1 = self.bounds
        return (x0 + x1) / 2, (y0 + y1) / 2

    @property
    def area(self) -> float:
        """Area of the polygon in square pixels; near the number of its pixels, if it does not cross itself."""
        x, y = np.array(self.corners).T
        # From the first corner: far from the origin the products would lose digits.
        x, y = x - x[0], y - y[0]
        return abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2

    def moved(self, dx: float, dy: float) -> Roi:
        """Return the region `dx` pixels further right and `dy` further down."""
        return Roi(self.name, tuple((x + dx, y + dy) for x, y in self.corners))

    def divided(self, step: int) -> Roi:
        """Region in pixels of a map, each of which stands for `step` x `step` pixels of the image."""
        return self if step == 1 else Roi(self.name, tuple((x / step, y / step) for x, y in self.corners))

    def window(self, shape: tuple[int, int]) -> tuple[slice, slice]:
        """Rows and columns of an image of `shape` (height, width) that hold the whole region.

        Raises
        ------
        InputError
            If the region does not lie inside the image.
        """
        height, width = shape
        x0, y0, x1, y1 = self.bounds
        if x0 < 0 or y0 < 0 or x1 > width or y1 > height:
            raise InputError(
                f"region {self.name!r} spans x {x0:g} to {x1:g}, y {y0:g} to {y1:g}, but the image is "
                f"{width} x {height} pixels: move it inside"
            )
        return slice(floor(y0), ceil(y1)), slice(floor(x0), ceil(x1))

    def mask(self, shape: tuple[int, int]) -> NDArray[np.bool_]:
        """Mask of the region's pixels in its `window` of an image of `shape` (height, width).

        Raises
        ------
        InputError
            If the region lies outside the image or holds no pixel.
        """
        rows, columns = self.window(shape)
        x = np.arange(columns.start, columns.stop) + 0.5
        y = np.arange(rows.start, rows.stop) + 0.5
        # Even-odd rule: a pixel is inside if its horizontal ray to the right crosses an odd number of edges. Only the
        # rows that an edge spans are looked at, so that many corners cost little.
        closed = np.array((*self.corners, self.corners[0])).T
        (xa, ya), (xb, yb) = closed[:, :-1], closed[:, 1:]
        first = np.searchsorted(y, np.minimum(ya, yb))
        count = np.searchsorted(y, np.maximum(ya, yb)) - first
        edge = np.repeat(np.arange(xa.size), count)
        row = np.arange(edge.size) - np.repeat(np.cumsum(count) - count, count) + first[edge]
        ya, xa = ya[edge], xa[edge]
        crossing = xa + (y[row] - ya) * (xb[edge] - xa) / (yb[edge] - ya)
        # Along all rows in one line, the pixels between one crossing and the next are outside and inside in turn: each
        # row has an even number of crossings.
        turns = np.empty(row.size + 2, np.intp)
        turns[0], turns[-1] = 0, y.size * x.size
        turns[1:-1] = np.sort(row * x.size + np.searchsorted(x, crossing))
        lengths = turns[1:] - turns[:-1]
        inside = np.repeat(np.arange(lengths.size) % 2 == 1, lengths).reshape(y.size, x.size)
        if not inside.any():
            raise InputError(f"region {self.name!r} holds no pixel: make it larger")
        return inside

    def select(self, image: NDArray[Any]) -> NDArray[Any]:
        """Values of the region's pixels, shape (n,), from a 2-D image; raises InputError as `mask`."""
        if image.ndim != 2:
            raise InputError(f"an image has 2 dimensions, got {image.ndim}")
        shape = (image.shape[0], image.shape[1])
        window = image[self.window(shape)]
        mask = self.mask(shape)
        values: NDArray[Any] = window.ravel() if mask.all() else window[mask]
        return values


#: Corner pixels x0, y0, x1, y1 of a rectangle, both in.
Rectangle: TypeAlias = tuple[int, int, int, int]


def clipped_rectangle(corners: Rectangle, width: int, height: int) -> Rectangle:
    """Left, top, right and bottom pixel of the part of a rectangle that lies in an image.

    Raises
    ------
    InputError
        If it lies outside.
    """
    xa, ya, xb, yb = corners
    left, right, top, bottom = max(min(xa, xb), 0), max(xa, xb), max(min(ya, yb), 0), max(ya, yb)
    right, bottom = min(right, width - 1), min(bottom, height - 1)
    if left > right or top > bottom:
        place = f"rectangle from {(xa, ya)} to {(xb, yb)}"
        raise InputError(f"{place} lies outside the image of {width} x {height} pixels: move it inside")
    return left, top, right, bottom


def regions_table(rois: Iterable[Roi], caption: str = "") -> str:
    """Return regions as an HTML table for notebooks."""
    rows = [(roi.name, f"{roi.area:.0f}", ", ".join(f"{edge:.4g}" for edge in roi.bounds)) for roi in rois]
    return html_table(("region", "area in pixels", "left, top, right, bottom"), rows, caption)
