"""Writing of ImageJ's files of regions; see `imagej` for what ImageJ counts."""

from __future__ import annotations

import struct
import zipfile
from collections.abc import Sequence
from io import BytesIO
from math import cos, radians, sin
from typing import TYPE_CHECKING

from ..core.errors import InputError
from .shapes import EllipseShape, PolygonShape, RectangleShape, Shape

if TYPE_CHECKING:
    from roifile import ImagejRoi

#: Whole coordinates that the file's 16 bits can hold.
_LOWEST, _HIGHEST = -5000, 60535


def imagej_file(shapes: Sequence[Shape], several: bool) -> bytes:
    """Write shapes as ImageJ does, as a .zip if `several`; the rectangles of grids become regions of their own.

    Raises
    ------
    InputError
        If one region does not fit into ImageJ's range, or there are several for a .roi file.
    """
    single = [part for shape in shapes for part in _parts(shape)]
    if not several:
        if len(single) > 1:
            raise InputError(f"a .roi file holds one region, these are {len(single)}: give a name in .zip or .json")
        return _imagej(single[0])
    buffer = BytesIO()
    taken: set[str] = set()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for shape in single:
            entry = _entry_name(shape.name, taken)
            # A date of its own, so that the same regions make the same file.
            archive.writestr(zipfile.ZipInfo(f"{entry}.roi", (1980, 1, 1, 0, 0, 0)), _imagej(shape))
    return buffer.getvalue()


def _parts(shape: Shape) -> tuple[Shape, ...]:
    if shape.kind != "grid":
        return (shape,)
    boxes = [(roi.name, *roi.bounds) for roi in shape.rois()]
    return tuple(RectangleShape(name, x0, y0, x1 - x0, y1 - y0) for name, x0, y0, x1, y1 in boxes)


def _entry_name(name: str, taken: set[str]) -> str:
    """Return a name for a file in a .zip that no other has; a slash would make a folder."""
    base = name.replace("/", "_").replace("\\", "_")
    entry, number = base, 1
    while entry.lower() in taken:
        number += 1
        entry = f"{base}-{number}"
    taken.add(entry.lower())
    return entry


def _imagej(shape: Shape) -> bytes:
    """Write one region; raises InputError where ImageJ's range does not hold it."""
    from roifile import ROI_OPTIONS, ROI_SUBTYPE, ROI_TYPE, ImagejRoi

    (region,) = shape.rois()
    x0, y0, x1, y1 = region.bounds
    if min(x0, y0) < _LOWEST or max(x1, y1) > _HIGHEST:
        raise InputError(
            f"region {shape.name!r} spans x {x0:g} to {x1:g}, y {y0:g} to {y1:g}: ImageJ holds coordinates from "
            f"{_LOWEST} to {_HIGHEST}"
        )
    if isinstance(shape, PolygonShape) or (isinstance(shape, RectangleShape | EllipseShape) and shape.angle_deg != 0):
        written = _corners(region.corners)
        if not isinstance(shape, PolygonShape):
            written.roitype = ROI_TYPE.FREEHAND
            written.subtype = ROI_SUBTYPE.ELLIPSE if isinstance(shape, EllipseShape) else ROI_SUBTYPE.ROTATED_RECT
            _write_turned(written, shape)
    else:
        assert isinstance(shape, RectangleShape | EllipseShape)
        written = ImagejRoi()
        written.roitype = ROI_TYPE.OVAL if isinstance(shape, EllipseShape) else ROI_TYPE.RECT
        box = (shape.x, shape.y, shape.width, shape.height)
        written.left, written.top, written.right, written.bottom = (round(v) for v in (x0, y0, x1, y1))
        if not all(v.is_integer() for v in box):
            written.options = ROI_OPTIONS.SUB_PIXEL_RESOLUTION
            written.xd, written.yd, written.widthd, written.heightd = box
    # The file counts UTF-16 units, and characters beyond the first 65536 have two.
    written.name = "".join(c if ord(c) < 2**16 else "\ufffd" for c in shape.name)
    data: bytes = written.tobytes()
    return data


def _corners(corners: Sequence[tuple[float, float]]) -> ImagejRoi:
    """Make a polygon, of whole coordinates if it has such, else of additional 32-bit floats."""
    import numpy as np
    from roifile import ROI_OPTIONS, ROI_TYPE, ImagejRoi

    exact = np.array(corners)
    whole = np.rint(exact).astype(np.int32)
    left, top = whole.min(axis=0)
    right, bottom = whole.max(axis=0)
    written = ImagejRoi()
    written.roitype = ROI_TYPE.POLYGON
    written.left, written.top, written.right, written.bottom = int(left), int(top), int(right), int(bottom)
    written.integer_coordinates = whole - (left, top)
    written.n_coordinates = len(whole)
    if not (whole == exact).all():
        written.options = ROI_OPTIONS.SUB_PIXEL_RESOLUTION
        written.subpixel_coordinates = exact.astype(np.float32)
    return written


def _write_turned(written: ImagejRoi, shape: RectangleShape | EllipseShape) -> None:
    """Fill in axis and other size; an ellipse's axis is its longer one."""
    along, across, angle = shape.width, shape.height, radians(shape.angle_deg)
    if isinstance(shape, EllipseShape):
        if across > along:
            along, across, angle = across, along, angle + radians(90)
        parameter = across / along
    else:
        parameter = across
    x, y = shape.x + shape.width / 2, shape.y + shape.height / 2
    dx, dy = along / 2 * cos(angle), along / 2 * sin(angle)
    written.x1, written.y1, written.x2, written.y2 = x - dx, y - dy, x + dx, y + dy
    fields = struct.unpack(">BBh", struct.pack(">f", parameter))
    written.arrow_style_or_aspect_ratio, written.arrow_head_size, written.rounded_rect_arc_size = fields
