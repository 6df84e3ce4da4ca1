"""Editing of shapes: drag, add and remove corners, move; and regions found automatically, for the user to confirm."""

from __future__ import annotations

from cmath import rect
from dataclasses import replace
from math import isfinite, radians
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...regions import EllipseShape, ImageSize, PolygonShape, RectangleShape, Shape
from .page_image import PageImage

Corner = tuple[float, float]

#: Decimals of corner coordinates in pixels: finer than a mouse, and files stay readable.
_DECIMALS = 2
_ROUNDING_PX = 1e-6
_BOXES: dict[str, type[RectangleShape | EllipseShape]] = {"rectangle": RectangleShape, "ellipse": EllipseShape}


def box_shape(kind: str, name: str, start: Corner, end: Corner, size: ImageSize) -> Shape:
    """Make a rectangle or an ellipse from two opposite corners of its box.

    Parameters
    ----------
    kind : {'rectangle', 'ellipse'}
        Kind of shape.
    name : str
        Its name.
    start, end : (float, float)
        Opposite corners (x, y) in pixels, in any order; they are clipped to the image and snapped to pixel edges.
    size : (int, int)
        Width and height of the image.

    Raises
    ------
    InputError
        If the kind is another, or the box is empty.
    """
    (xa, ya), (xb, yb) = (_to_edge(inside(corner, size)) for corner in (start, end))
    if xa == xb or ya == yb:
        raise InputError("the box holds no pixel: drag from one corner to the opposite one, or zoom in")
    x, y, width, height = min(xa, xb), min(ya, yb), abs(xb - xa), abs(yb - ya)
    if kind not in _BOXES:
        raise InputError(f"kind of a box is {kind!r}: give 'rectangle' or 'ellipse'")
    return _BOXES[kind](name, x, y, width, height)


def polygon_shape(name: str, corners: tuple[Corner, ...], size: ImageSize) -> PolygonShape:
    """Make a polygon; corners are clipped to the image, and consecutive duplicates dropped.

    Raises
    ------
    InputError
        If there are fewer than three different corners.
    """
    moved = [_rounded(inside(corner, size)) for corner in corners]
    kept = [corner for at, corner in enumerate(moved) if at == 0 or corner != moved[at - 1]]
    if kept and kept[-1] == kept[0]:
        # Closed by a second click on the first corner.
        kept.pop()
    if len(kept) < 3:
        raise InputError("a polygon has at least 3 corners: click more of them before you close it")
    return PolygonShape(name, tuple(kept))


def handles(shape: Shape) -> tuple[Corner, ...]:
    """Return the draggable corners (x, y), in order: those of a polygon, or of the box of another shape."""
    if isinstance(shape, PolygonShape):
        return shape.corners
    (box,) = RectangleShape(shape.name, shape.x, shape.y, shape.width, shape.height, shape.angle_deg).rois()
    return box.corners


def with_handle(shape: Shape, at: int, to: Corner, size: ImageSize) -> Shape:
    """Return the shape with a corner moved; the opposite corner of a box stays fixed.

    Parameters
    ----------
    shape : Shape
        The shape.
    at : int
        Index in its `handles`.
    to : (float, float)
        New position, in pixels; clipped to the image.
    size : (int, int)
        Width and height of the image.

    Raises
    ------
    InputError
        If there is no such corner, or the shape would be empty.
    """
    corners = _corners(shape, at)
    target = inside(to, size)
    if isinstance(shape, PolygonShape):
        return replace(shape, corners=(*corners[:at], _rounded(target), *corners[at + 1 :]))
    # Upright boxes stay on pixel edges.
    target = _to_edge(target) if shape.angle_deg == 0 else target
    opposite = corners[(at + 2) % 4]
    across = complex(target[0] - opposite[0], target[1] - opposite[1]) * rect(1, radians(-shape.angle_deg))
    width, height = (round(abs(side), _DECIMALS) for side in (across.real, across.imag))
    if not (width > 0 and height > 0):
        raise InputError(f"nothing would be left of region {shape.name!r}: keep its corners apart")
    x, y = (target[0] + opposite[0] - width) / 2, (target[1] + opposite[1] - height) / 2
    return replace(shape, x=round(x, _DECIMALS), y=round(y, _DECIMALS), width=width, height=height)


def moved(shape: Shape, by: Corner, size: ImageSize) -> Shape:
    """Return the shape moved by (x, y) pixels, no further than the edge of the image; upright boxes by whole pixels."""
    xs, ys = zip(*(corner for roi in shape.rois() for corner in roi.corners), strict=True)
    # Computed corners may be outside by a rounding error after the move.
    exact = isinstance(shape, PolygonShape) or (isinstance(shape, RectangleShape) and shape.angle_deg == 0)
    slack = 0.0 if exact else _ROUNDING_PX
    dx = min(max(_finite(by[0]), slack - min(xs)), size[0] - max(xs) - slack)
    dy = min(max(_finite(by[1]), slack - min(ys)), size[1] - max(ys) - slack)
    if isinstance(shape, PolygonShape):
        dx, dy = _rounded((dx, dy))
        return replace(shape, corners=tuple(_rounded((x + dx, y + dy)) for x, y in shape.corners))
    if shape.angle_deg == 0:
        # Round towards zero, so that the step does not leave the image.
        dx, dy = float(int(dx)), float(int(dy))
    return replace(shape, x=shape.x + dx, y=shape.y + dy)


def with_corner(shape: Shape, after: int, at: Corner, size: ImageSize) -> Shape:
    """Return a polygon with one more corner, behind corner number `after`.

    Raises
    ------
    InputError
        If the shape is not a polygon or has no such corner.
    """
    corners, new = _corners(_polygon(shape), after), _rounded(inside(at, size))
    return replace(_polygon(shape), corners=(*corners[: after + 1], new, *corners[after + 1 :]))


def without_corner(shape: Shape, at: int) -> Shape:
    """Return a polygon without one of its corners.

    Raises
    ------
    InputError
        If the shape is not a polygon, has no such corner, or has only three corners.
    """
    corners = _corners(_polygon(shape), at)
    if len(corners) == 3:
        raise InputError(f"region {shape.name!r} has only 3 corners left: keep them, or delete the region")
    return replace(_polygon(shape), corners=corners[:at] + corners[at + 1 :])


def inside(corner: Corner, size: ImageSize) -> Corner:
    """Clip a corner to an image of `size` (width, height); raises InputError."""
    x, y = (_finite(value) for value in corner)
    return min(max(x, 0.0), float(size[0])), min(max(y, 0.0), float(size[1]))


def _polygon(shape: Shape) -> PolygonShape:
    if not isinstance(shape, PolygonShape):
        raise InputError(f"region {shape.name!r} is not a polygon: only polygons can gain or lose corners")
    return shape


def _corners(shape: Shape, at: int) -> tuple[Corner, ...]:
    """Return the draggable corners, of which number `at` is one; raises InputError."""
    corners = handles(shape)
    if not 0 <= at < len(corners):
        raise InputError(f"region {shape.name!r} has no corner {at}: it has {len(corners)}")
    return corners


def _rounded(corner: Corner) -> Corner:
    return round(corner[0], _DECIMALS), round(corner[1], _DECIMALS)


def _to_edge(corner: Corner) -> Corner:
    return float(round(corner[0])), float(round(corner[1]))


def _finite(value: float) -> float:
    if not isfinite(value):
        raise InputError(f"a coordinate is {value}: give finite numbers of pixels")
    return float(value)


Method = Literal["checkerboard", "step-chart", "superpixels"]

#: Names of the methods for the user.
METHOD_NAMES: dict[Method, str] = {method: method.replace("-", " ").capitalize() for method in get_args(Method)}
#: Most proposals: more are impractical to confirm one by one.
MOST_PROPOSALS = 2000
#: Default number of superpixels along the longer side of an image.
_ALONG = 24


def default_size_px(image: PageImage) -> int:
    """Default side of superpixels for an image, in pixels."""
    return max(8, round(max(image.size) / _ALONG))


def propose(image: PageImage, method: Method, size_px: int | None = None) -> tuple[PolygonShape, ...]:
    """Find regions in an image.

    Parameters
    ----------
    image : PageImage
        The image.
    method : {'checkerboard', 'step-chart', 'superpixels'}
        Kind of regions to find.
    size_px : int or None
        Side of superpixels in pixels of the image; None for the default.

    Returns
    -------
    tuple of PolygonShape
        At least one.

    Raises
    ------
    InputError
        If nothing is found, or more than `MOST_PROPOSALS`, or the size is out of range.
    """
    from ...regions import detect_checkerboard, detect_step_chart

    light, step = np.asarray(image.luminance.luminance_cd_m2), image.luminance.step
    if method == "superpixels":
        asked_px = default_size_px(image) if size_px is None else size_px
        shapes = _superpixels(light, max(1, round(asked_px / step)))
    else:
        shapes = detect_checkerboard(light) if method == "checkerboard" else detect_step_chart(light)
    # In pixels of the image, not of the map.
    return tuple(replace(shape, corners=tuple((step * x, step * y) for x, y in shape.corners)) for shape in shapes)


def _superpixels(light: NDArray[Any], size_px: int) -> tuple[PolygonShape, ...]:
    from ...regions.proposals import propose_regions

    shapes = propose_regions(light, size_px)
    if not shapes:
        raise InputError("no uniform area is as large as half a superpixel: give a smaller size, or draw the regions")
    if len(shapes) > MOST_PROPOSALS:
        raise InputError(
            f"{len(shapes)} regions were found, more than the limit of {MOST_PROPOSALS}: give a larger size of "
            "superpixels"
        )
    return shapes
