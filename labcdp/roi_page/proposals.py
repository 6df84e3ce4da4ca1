"""Regions found automatically, for a person to confirm."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..regions import PolygonShape, Shape
from .page_image import PageImage

Method = Literal["checkerboard", "step-chart", "superpixels"]
METHODS: tuple[Method, ...] = get_args(Method)

#: What a person calls them.
METHOD_NAMES: dict[Method, str] = {
    "checkerboard": "Checkerboard",
    "step-chart": "Step chart",
    "superpixels": "Superpixels",
}
#: More proposals than this nobody confirms one by one.
MOST_PROPOSALS = 2000
#: Superpixels along the longer side of an image, if nothing else is asked for.
_ALONG = 24


def default_size_px(image: PageImage) -> int:
    """Side of superpixels that suits an image, in its pixels."""
    return max(8, round(max(image.size) / _ALONG))


def propose(image: PageImage, method: Method, size_px: int | None = None) -> tuple[Shape, ...]:
    """Find regions in an image.

    Parameters
    ----------
    image : PageImage
        Where.
    method : {'checkerboard', 'step-chart', 'superpixels'}
        What to look for.
    size_px : int or None
        Side of superpixels in pixels of the image; None for a size that suits the image.

    Returns
    -------
    tuple of Shape
        At least one.

    Raises
    ------
    InputError
        If nothing is found, or the size is out of range.
    """
    light = np.asarray(image.luminance.luminance_cd_m2)
    if method == "superpixels":
        return _superpixels(image, light, default_size_px(image) if size_px is None else size_px)
    from ..regions import detect_checkerboard, detect_step_chart

    found = detect_checkerboard(light) if method == "checkerboard" else detect_step_chart(light)
    return tuple(_enlarged(shape, image.luminance.step) for shape in found)


def _superpixels(image: PageImage, light: NDArray[Any], size_px: int) -> tuple[Shape, ...]:
    from ..regions.superpixels import superpixel_labels

    step = image.luminance.step
    width, height = image.size
    expected = width * height / max(size_px, 1) ** 2
    if expected > MOST_PROPOSALS:
        least = int(np.ceil(np.sqrt(width * height / MOST_PROPOSALS)))
        raise InputError(
            f"superpixels of {size_px} pixels would be about {expected:.0f} proposals: give a size of at least {least}"
        )
    labels = superpixel_labels(light, max(1, round(size_px / step)))
    return tuple(PolygonShape(f"superpixel {at + 1}", corners) for at, corners in enumerate(outlines(labels, step)))


def outlines(labels: NDArray[np.int32], step: int = 1) -> list[tuple[tuple[float, float], ...]]:
    """Return a polygon around each label that holds exactly the centres of its pixels.

    Parameters
    ----------
    labels : ndarray of int, shape (height, width)
        0 to n - 1; the pixels of each are connected along rows and columns.
    step : int
        Pixels of the image, along each side, that one label stands for.

    Returns
    -------
    list of tuple of (float, float)
        Corners (x, y) for each label, a quarter of a pixel within its edges: so no polygon touches itself where two of
        its pixels meet at a corner. What a label surrounds completely is in its polygon too.
    """
    import shapely

    height, width = labels.shape
    starts = np.flatnonzero(np.diff(labels, axis=1, prepend=-1).ravel())
    ends = np.append(starts[1:], height * width)
    rows = starts // width
    ends = np.minimum(ends, (rows + 1) * width)
    of_run = labels.ravel()[starts]
    # All pixels of a row that follow each other with one label, as a box.
    edges = (starts - rows * width, rows, ends - rows * width, rows + 1)
    boxes = shapely.box(*(step * edge for edge in edges))
    order = np.argsort(of_run, kind="stable")
    groups = np.split(boxes[order], np.flatnonzero(np.diff(of_run[order])) + 1)
    result = []
    for group in groups:
        area: Any = shapely.Polygon(shapely.union_all(group).exterior)
        inner: Any = area.buffer(-0.25, join_style="mitre")
        result.append(tuple((round(x, 2), round(y, 2)) for x, y in inner.exterior.coords[:-1]))
    return result


def _enlarged(shape: Shape, step: int) -> Shape:
    """Shape of a map, in pixels of the image."""
    if step == 1:
        return shape
    if isinstance(shape, PolygonShape):
        return replace(shape, corners=tuple((step * x, step * y) for x, y in shape.corners))
    lengths = {f.name: step * getattr(shape, f.name) for f in fields(shape) if f.name in _LENGTHS}
    return replace(shape, **lengths)


_LENGTHS = ("x", "y", "width", "height", "gap")
