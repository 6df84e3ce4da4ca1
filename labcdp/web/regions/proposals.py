"""Regions found automatically, for the user to confirm."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields, replace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...regions import PolygonShape, Shape
from .page_image import PageImage

Method = Literal["checkerboard", "step-chart", "superpixels"]
METHODS: tuple[Method, ...] = get_args(Method)

#: Names of the methods for the user.
METHOD_NAMES: dict[Method, str] = {
    "checkerboard": "Checkerboard",
    "step-chart": "Step chart",
    "superpixels": "Superpixels",
}
#: Most proposals: more are impractical to confirm one by one.
MOST_PROPOSALS = 2000
#: Default number of superpixels along the longer side of an image.
_ALONG = 24


def default_size_px(image: PageImage) -> int:
    """Default side of superpixels for an image, in pixels."""
    return max(8, round(max(image.size) / _ALONG))


def propose(image: PageImage, method: Method, size_px: int | None = None) -> tuple[Shape, ...]:
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
    tuple of Shape
        At least one.

    Raises
    ------
    InputError
        If nothing is found, or more than `MOST_PROPOSALS`, or the size is out of range.
    """
    from ...regions import detect_checkerboard, detect_step_chart

    light, step = np.asarray(image.luminance.luminance_cd_m2), image.luminance.step
    found: Iterable[Shape]
    if method == "superpixels":
        asked_px = default_size_px(image) if size_px is None else size_px
        found = _superpixels(light, max(1, round(asked_px / step)))
    else:
        found = detect_checkerboard(light) if method == "checkerboard" else detect_step_chart(light)
    return tuple(_enlarged(shape, step) for shape in found)


def _superpixels(light: NDArray[Any], size_px: int) -> tuple[Shape, ...]:
    from ...regions.proposals import propose_regions

    found = propose_regions(light, size_px)
    if not found:
        raise InputError("no uniform area is as large as half a superpixel: give a smaller size, or draw the regions")
    if len(found) > MOST_PROPOSALS:
        raise InputError(
            f"{len(found)} regions were found, more than the limit of {MOST_PROPOSALS}: give a larger size of "
            "superpixels"
        )
    return found


def _enlarged(shape: Shape, step: int) -> Shape:
    """Shape of a map, in pixels of the image."""
    if step == 1:
        return shape
    if isinstance(shape, PolygonShape):
        return replace(shape, corners=tuple((step * x, step * y) for x, y in shape.corners))
    lengths = {f.name: step * getattr(shape, f.name) for f in fields(shape) if f.name in _LENGTHS}
    return replace(shape, **lengths)


_LENGTHS = ("x", "y", "width", "height", "gap")
