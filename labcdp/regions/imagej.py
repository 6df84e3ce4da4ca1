"""ImageJ's and Fiji's files of regions, read and written: .roi with one, .zip with any number.

ImageJ counts the edges of pixels and not their centres, as labcdp does: the rectangle (10, 20, 5, 4) begins at the
left edge of column 10 and holds 5 x 4 pixels. Ovals, polygons and combinations hold the pixels whose centres they hold.
"""

from __future__ import annotations

import logging
import re
import struct
import zipfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from io import BytesIO
from math import atan2, cos, degrees, hypot, isfinite, radians, sin

import numpy as np
from roifile import ROI_OPTIONS, ROI_SUBTYPE, ROI_TYPE, ImagejRoi

from ..core.disk.files import damage_reported, quoted
from ..core.errors import InputError
from .geometry import in_one_line, is_simple
from .shapes import MOST_REGIONS, CompositeShape, EllipseShape, GridShape, PolygonShape, RectangleShape, Shape

_log = logging.getLogger(__name__)

#: More bytes of one region (100 000 corners have 1.2 million), or of all regions in a .zip, are refused as a
#: decompression bomb.
_MOST_BYTES_OF_REGION = 4 * 2**20
_MOST_BYTES = 64 * 2**20
#: Most parts and holes of one region.
_MOST_RINGS = 1000
#: Kinds of ImageJ regions without an area.
_LINES = {
    ROI_TYPE.LINE: "line", ROI_TYPE.FREELINE: "freehand line", ROI_TYPE.POLYLINE: "segmented line",
    ROI_TYPE.NOROI: "empty selection", ROI_TYPE.ANGLE: "angle", ROI_TYPE.POINT: "point",
}  # fmt: skip
_NO_REGION = {ROI_SUBTYPE.TEXT: "text", ROI_SUBTYPE.ARROW: "arrow", ROI_SUBTYPE.IMAGE: "image"}

#: Whole coordinates that the file's 16 bits can hold.
_LOWEST, _HIGHEST = -5000, 60535


def parse_imagej(data: bytes, name: str) -> tuple[Shape, ...]:
    """Read an ImageJ file.

    Parameters
    ----------
    data : bytes
        The file.
    name : str
        Name for a single region without a name of its own.

    Raises
    ------
    InputError
        Naming the region, if all are damaged or have no area, or the file is larger than a region file can be. Single
        ones are left out, with a message.
    """
    if data[:4] == b"Iout":
        return (_shape(data, name),)
    entries, shapes, errors = [], [], []
    for entry, content in _entries(data):
        try:
            shapes.append(_shape(content, entry))
            entries.append(entry)
        except InputError as error:
            errors.append(error)
    if not shapes:
        raise errors[0]
    for problem in errors:
        _log.warning("a region is left out: %s", problem)
    # ImageJ's list shows the names of the entries, which differ; a name in a region may be left from its copy.
    times = Counter(shape.name for shape in shapes)
    return tuple(
        replace(shape, name=_clean(entry) or shape.name) if times[shape.name] > 1 else shape
        for shape, entry in zip(shapes, entries, strict=True)
    )


def _entries(data: bytes) -> Iterator[tuple[str, bytes]]:
    """Give name and content of each region in a .zip."""
    left = _MOST_BYTES
    damage = damage_reported("its .zip archive cannot be read", ": save it again in ImageJ")
    with damage, zipfile.ZipFile(BytesIO(data)) as archive:
        names = [name for name in archive.namelist() if name.lower().endswith(".roi") and "__MACOSX" not in name]
        if len(names) > MOST_REGIONS:
            raise InputError(f"it holds {len(names)} regions: give at most {MOST_REGIONS}")
        if not names:
            raise InputError("it holds no .roi file: save the regions in ImageJ's ROI Manager (More > Save)")
        for name in names:
            with archive.open(name) as file:
                content = file.read(min(_MOST_BYTES_OF_REGION, left) + 1)
            left -= len(content)
            if len(content) > _MOST_BYTES_OF_REGION or left < 0:
                raise InputError(
                    f"{quoted(name)} unpacks to more than {_MOST_BYTES_OF_REGION // 2**20} MiB, or all to more "
                    f"than {_MOST_BYTES // 2**20} MiB: these are not regions"
                )
            yield name[: -len(".roi")], content


def _shape(data: bytes, entry: str) -> Shape:
    """Read one region."""
    where = f"ImageJ region {quoted(entry)}"
    _require_name(data, where)
    with damage_reported(f"{where} cannot be read", ": save it again in ImageJ, or draw it as a polygon"):
        read = ImagejRoi.frombytes(data)
        name = _clean(read.name) or _clean(entry)
        return _shape_for_kind(read, name, f"ImageJ region {quoted(name)}")


def _shape_for_kind(read: ImagejRoi, name: str, where: str) -> Shape:
    kind = read.roitype
    if what := _NO_REGION.get(read.subtype) or _LINES.get(kind):
        raise InputError(f"{where} is of the kind {what}, which has no area: leave it out, or draw an area")
    if kind is ROI_TYPE.UNKNOWN or read.subtype is ROI_SUBTYPE.UNKNOWN:
        raise InputError(f"{where} is of the unknown kind {kind.value}, {read.subtype.value}: draw it as a polygon")
    if read.shape_roi_size > 0:
        return CompositeShape(name, in_one_line(_rings(read, where)))
    if kind in (ROI_TYPE.RECT, ROI_TYPE.OVAL):
        if kind == ROI_TYPE.RECT and read.rounded_rect_arc_size > 0:
            raise InputError(f"{where} is a rectangle with rounded corners: draw it as a polygon")
        box = (read.left, read.top, read.right - read.left, read.bottom - read.top)
        if read.subpixelrect:
            box = (read.xd, read.yd, read.widthd, read.heightd)
        return (RectangleShape if kind == ROI_TYPE.RECT else EllipseShape)(name, *box)
    if kind == ROI_TYPE.FREEHAND and read.subtype:
        return _turned(read, name)
    if read.options & ROI_OPTIONS.SPLINE_FIT:
        raise InputError(f"{where} is a fitted spline: make it a polygon (Edit > Selection > Interpolate)")
    corners = tuple((float(x), float(y)) for x, y in read.coordinates())
    if len(corners) < 3:
        raise InputError(f"{where} has {len(corners)} corners: draw it again")
    # The wand and freehand lines touch and cross themselves; ImageJ fills them by the even-odd rule.
    return (PolygonShape if kind == ROI_TYPE.POLYGON or is_simple(corners) else CompositeShape)(name, corners)


def _require_name(data: bytes, where: str) -> None:
    """Refuse a region whose name is not in the file; its second header says where it is (RoiDecoder.java)."""
    second = int.from_bytes(data[60:64], "big")
    if 0 < second <= len(data) - 24:
        offset, length = struct.unpack_from(">II", data, second + 16)
        if offset and length and offset + 2 * length > len(data):
            raise InputError(
                f"{where} is damaged: its name reaches to byte {offset + 2 * length}, it has {len(data)}: save it "
                "again in ImageJ"
            )


def _turned(read: ImagejRoi, name: str) -> Shape:
    """Read a rotated rectangle or ellipse: the middles of two opposite sides, or the ends of the long axis."""
    dx, dy = read.x2 - read.x1, read.y2 - read.y1
    width = hypot(dx, dy)
    # One float in the place of three fields of arrows and rounded rectangles.
    fields = read.arrow_style_or_aspect_ratio, read.arrow_head_size, read.rounded_rect_arc_size
    (height,) = struct.unpack(">f", struct.pack(">BBh", *fields))
    shape: type[EllipseShape | RectangleShape] = RectangleShape
    if read.subtype == ROI_SUBTYPE.ELLIPSE:
        shape, height = EllipseShape, height * width
    x, y = (read.x1 + read.x2 - width) / 2, (read.y1 + read.y2 - height) / 2
    return shape(name, x, y, width, height, degrees(atan2(dy, dx)))


def _rings(read: ImagejRoi, where: str) -> list[list[tuple[float, float]]]:
    try:
        coordinates = read.coordinates(multi=True)
    except NotImplementedError as error:
        # Segments SEG_QUADTO and SEG_CUBICTO of java.awt.geom.PathIterator.
        raise InputError(
            f"{where} is a composite selection with curves, which labcdp does not read: make it a polygon "
            "(Edit > Selection > Interpolate)"
        ) from error
    paths = [[(float(x), float(y)) for x, y in ring] for ring in coordinates]
    rings = [ring for ring in (path[:-1] if path and path[0] == path[-1] else path for path in paths) if len(ring) > 2]
    if not rings or len(rings) > _MOST_RINGS or not all(isfinite(v) for ring in rings for point in ring for v in point):
        raise InputError(f"{where} has {len(rings)} parts that can be used: give 1 to {_MOST_RINGS}")
    return rings


def _clean(name: str) -> str:
    return " ".join("".join(c if c.isprintable() else " " for c in name).split())


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
            # A slash would make a folder, and a name of two files would be lost.
            base = re.sub(r"[/\\]", "_", shape.name)
            names = (base, *(f"{base}-{number}" for number in range(2, len(single) + 2)))
            entry = next(name for name in names if name.lower() not in taken)
            taken.add(entry.lower())
            # A date of its own, so that the same regions make the same file.
            archive.writestr(zipfile.ZipInfo(f"{entry}.roi", (1980, 1, 1, 0, 0, 0)), _imagej(shape))
    return buffer.getvalue()


def _parts(shape: Shape) -> tuple[Shape, ...]:
    if shape.kind != "grid":
        return (shape,)
    boxes = [(roi.name, *roi.bounds) for roi in shape.rois()]
    return tuple(RectangleShape(name, x0, y0, x1 - x0, y1 - y0) for name, x0, y0, x1, y1 in boxes)


def _imagej(shape: Shape) -> bytes:
    """Write one region; raises InputError where ImageJ's range does not hold it."""
    (region,) = shape.rois()
    x0, y0, x1, y1 = region.bounds
    if min(x0, y0) < _LOWEST or max(x1, y1) > _HIGHEST:
        raise InputError(
            f"region {shape.name!r} spans x {x0:g} to {x1:g}, y {y0:g} to {y1:g}: ImageJ holds coordinates from "
            f"{_LOWEST} to {_HIGHEST}"
        )
    if isinstance(shape, PolygonShape) or shape.angle_deg != 0:
        exact = np.array(region.corners, dtype=np.float64)
        whole = np.rint(exact).astype(np.int32)
        # Of whole coordinates if it has such, else of additional 32-bit floats.
        written = ImagejRoi.frompoints(whole if (whole == exact).all() else exact)
        written.roitype = ROI_TYPE.POLYGON
        written.options &= ROI_OPTIONS.SUB_PIXEL_RESOLUTION
        if not isinstance(shape, PolygonShape):
            _write_turned(written, shape)
    else:
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


def _write_turned(written: ImagejRoi, shape: RectangleShape | EllipseShape | GridShape) -> None:
    """Fill in axis and other size; an ellipse's axis is its longer one."""
    along, across, angle = shape.width, shape.height, radians(shape.angle_deg)
    written.roitype, written.subtype, parameter = ROI_TYPE.FREEHAND, ROI_SUBTYPE.ROTATED_RECT, across
    if isinstance(shape, EllipseShape):
        if across > along:
            along, across, angle = across, along, angle + radians(90)
        written.subtype, parameter = ROI_SUBTYPE.ELLIPSE, across / along
    x, y = shape.x + shape.width / 2, shape.y + shape.height / 2
    dx, dy = along / 2 * cos(angle), along / 2 * sin(angle)
    written.x1, written.y1, written.x2, written.y2 = x - dx, y - dy, x + dx, y + dy
    fields = struct.unpack(">BBh", struct.pack(">f", parameter))
    written.arrow_style_or_aspect_ratio, written.arrow_head_size, written.rounded_rect_arc_size = fields
