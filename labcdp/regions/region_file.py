"""Region files: JSON of labcdp, and ImageJ's .roi and .zip."""

from __future__ import annotations

from collections.abc import Iterable
from os import PathLike
from pathlib import Path

from ..core.disk import read_bytes
from ..core.errors import InputError
from ..output import write_file
from .imagej import parse_imagej
from .imagej_writing import imagej_file
from .region_json import ImageSize, parse_regions, regions_json
from .shapes import Shape, rois_of

#: A file of regions that is larger than this is none.
_MOST_BYTES = 64 * 2**20

#: What the suffix of a file to be written may be.
REGION_SUFFIXES = (".json", ".roi", ".zip")

#: How files of ImageJ begin: one region, or a ZIP archive of several.
_IMAGEJ = (b"Iout", b"PK\x03\x04", b"PK\x05\x06")


def load_regions(path: str | PathLike[str], image_size: ImageSize | None = None) -> tuple[Shape, ...]:
    """Read regions from a file of labcdp (JSON) or ImageJ (.roi, or .zip of several); detected by content.

    Parameters
    ----------
    path : path-like
        The file.
    image_size : (int, int) or None
        Width and height, in pixels, of the image that the regions are meant for; checked where given.

    Returns
    -------
    tuple of Shape
        At least one, with names of their own; their polygons do not cross themselves.

    Raises
    ------
    InputError
        Naming the file, and region and key, if it cannot be read, is no region file, holds no region or one that
        cannot be used, or belongs to an image of another size, or a region reaches out of the image.
    """
    path = Path(path)
    data = _read(path)
    try:
        if data[:4] in _IMAGEJ:
            shapes, drawn_on = parse_imagej(data, path.stem), None
        else:
            shapes, drawn_on = parse_regions(_text(data))
        rois = rois_of(shapes)
        if image_size is not None:
            width, height = image_size
            if drawn_on is not None and drawn_on != (width, height):
                raise InputError(
                    f"the regions belong to an image of {drawn_on[0]} x {drawn_on[1]} pixels, this one has "
                    f"{width} x {height}: draw them on this image"
                )
            for roi in rois:
                roi.window((height, width))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return shapes


def image_size_of(path: str | PathLike[str]) -> ImageSize | None:
    """Width and height of the image that the regions of a file were drawn on; None if it does not say.

    Raises
    ------
    InputError
        If it is no region file.
    """
    data = _read(Path(path))
    if data[:4] in _IMAGEJ:
        return None
    try:
        return parse_regions(_text(data))[1]
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def save_regions(
    path: str | PathLike[str], shapes: Iterable[Shape], image_size: ImageSize | None = None, *, force: bool = False
) -> None:
    """Write regions: JSON (.json), ImageJ's file of one region (.roi), or of any number (.zip).

    Parameters
    ----------
    path : path-like
        The file.
    shapes : iterable of Shape
        At least one. ImageJ has no grids: their rectangles are written one by one.
    image_size : (int, int) or None
        Width and height of the image they belong to, in pixels; only JSON keeps it.
    force : bool
        Whether an existing file is replaced.

    Raises
    ------
    InputError
        If the suffix is none of these, the regions cannot be used (see `rois_of`), there are several for a .roi file,
        or the file exists or cannot be written.
    """
    path, shapes = Path(path), tuple(shapes)
    suffix = path.suffix.lower()
    if suffix not in REGION_SUFFIXES:
        raise InputError(f"{path} ends in {suffix!r}: give a name in {', '.join(REGION_SUFFIXES)}")
    rois_of(shapes)
    try:
        data = regions_json(shapes, image_size).encode() if suffix == ".json" else imagej_file(shapes, suffix == ".zip")
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    write_file(path, data, force=force)


def _read(path: Path) -> bytes:
    data = read_bytes(path, "a file with regions", _MOST_BYTES)
    if not data:
        raise InputError(f"{path} is empty: give a file with regions")
    return data


def _text(data: bytes) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError("it is neither JSON nor an ImageJ file of regions (.roi or .zip)") from error
