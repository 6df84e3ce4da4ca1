"""Region files: JSON of labcdp, and ImageJ's .roi and .zip."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import MISSING, fields
from hashlib import sha256
from os import PathLike
from pathlib import Path
from typing import Any, TypeAlias

from ..core.disk import parse_json, quoted, read_bytes, shortened
from ..core.disk.files import suggestion
from ..core.errors import InputError, naming
from ..core.result import InputFile
from ..core.roi import Roi
from ..output import write_file
from .imagej import imagej_file, parse_imagej
from .shapes import CompositeShape, EllipseShape, GridShape, PolygonShape, RectangleShape, Shape, rois_of

#: Largest file of regions in bytes.
_MOST_BYTES = 64 * 2**20

#: Suffixes of files that can be written.
REGION_SUFFIXES = (".json", ".roi", ".zip")

#: First bytes of ImageJ's files: of one region, and of a ZIP archive of several.
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

    Examples
    --------
    >>> from labcdp.regions import RectangleShape, load_regions, save_regions
    >>> save_regions("sky.json", [RectangleShape("sky", 0, 0, 9, 9)], (40, 30))
    >>> load_regions("sky.json", (40, 30))[0].width
    9.0
    """
    shapes, drawn_on, file = read_region_file(path)
    if image_size is not None:
        require_on_image(rois_of(shapes), drawn_on, image_size, file.path)
    return shapes


def read_region_file(path: str | PathLike[str]) -> tuple[tuple[Shape, ...], ImageSize | None, InputFile]:
    """Read shapes, the size of the image they were drawn on if the file says it, and the record of the file.

    Raises
    ------
    InputError
        As `load_regions`.

    Examples
    --------
    >>> from labcdp.regions import RectangleShape, read_region_file, save_regions
    >>> save_regions("lamp.json", [RectangleShape("lamp", 0, 0, 9, 9)], (40, 30))
    >>> shapes, image_size, file = read_region_file("lamp.json")
    >>> image_size, file.role
    ((40, 30), 'regions')
    """
    path = Path(path)
    data = read_bytes(path, "a file with regions", _MOST_BYTES)
    if not data:
        raise InputError(f"{path} is empty: give a file with regions")
    try:
        if data[:4] in _IMAGEJ:
            shapes, drawn_on = parse_imagej(data, path.stem), None
        else:
            shapes, drawn_on = parse_regions(data.decode("utf-8-sig"))
        rois_of(shapes)
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: it is neither JSON nor an ImageJ file of regions (.roi or .zip)") from error
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return shapes, drawn_on, InputFile("regions", str(path), sha256(data).hexdigest())


def require_on_image(rois: Iterable[Roi], drawn_on: ImageSize | None, image_size: ImageSize, file: str = "") -> None:
    """Refuse regions that were drawn on an image of another size, or that reach out of the image.

    Parameters
    ----------
    rois : iterable of Roi
        The regions.
    drawn_on, image_size : (int, int)
        Width and height in pixels of the image they were drawn on, None if that is not known, and of the image.
    file : str
        Where they are from, for messages.

    Raises
    ------
    InputError
        If they do not fit.

    Examples
    --------
    >>> from labcdp.core.roi import Roi
    >>> from labcdp.regions import require_on_image
    >>> require_on_image([Roi.rectangle("sky", 0, 0, 9, 9)], (40, 30), (40, 30))
    """
    (width, height), where = image_size, f"{file}: " if file else ""
    if drawn_on is not None and drawn_on != (width, height):
        raise InputError(
            f"{where}the regions were drawn on an image of {drawn_on[0]} x {drawn_on[1]} pixels, this one has "
            f"{width} x {height}: draw them on this image"
        )
    try:
        for roi in rois:
            roi.window((height, width))
    except InputError as error:
        raise InputError(f"{where}{error}") from error


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

    Examples
    --------
    >>> from labcdp.regions import RectangleShape, load_regions, save_regions
    >>> save_regions("two.json", [RectangleShape("sky", 0, 0, 9, 9), RectangleShape("road", 0, 20, 9, 9)], (40, 30))
    >>> [shape.name for shape in load_regions("two.json")]
    ['sky', 'road']
    """
    path, shapes = Path(path), tuple(shapes)
    suffix = path.suffix.lower()
    if suffix not in REGION_SUFFIXES:
        raise InputError(f"{path} ends in {suffix!r}: give a name in {', '.join(REGION_SUFFIXES)}")
    rois_of(shapes)
    with naming(path):
        data = regions_json(shapes, image_size).encode() if suffix == ".json" else imagej_file(shapes, suffix == ".zip")
    write_file(path, data, force=force)


#: Value of the key "format", and the newest version of the format.
FORMAT = "labcdp regions"
VERSION = 1

#: Width and height of an image in pixels.
ImageSize: TypeAlias = tuple[int, int]

_KINDS: dict[str, type[Shape]] = {
    kind.kind: kind for kind in (PolygonShape, CompositeShape, RectangleShape, EllipseShape, GridShape)
}
_KEYS = ("format", "version", "image", "regions")


def regions_json(shapes: Sequence[Shape], image_size: ImageSize | None) -> str:
    """Write shapes, and the size of the image they belong to, as JSON."""
    head = [f'"format": {_json(FORMAT)}', f'"version": {VERSION}']
    if image_size is not None:
        width, height = image_size
        head.append(f'"image": {_json({"width": int(width), "height": int(height)})}')
    # A line each: the user finds a region, and corners do not fill pages.
    regions = ",\n    ".join(_json(_region(shape)) for shape in shapes)
    return "{\n  " + ",\n  ".join([*head, f'"regions": [\n    {regions}\n  ]']) + "\n}\n"


def parse_regions(text: str) -> tuple[tuple[Shape, ...], ImageSize | None]:
    """Read what `regions_json` wrote, or the user.

    Raises
    ------
    InputError
        Naming region and key.
    """
    document = parse_json(text)
    if not isinstance(document, dict):
        raise InputError(f'it is not a region file: it needs a table with "format": "{FORMAT}"')
    document = _table(document, _KEYS, ("format", "version", "regions"), "")
    if document["format"] != FORMAT:
        raise InputError(f"format is {quoted(document['format'])}: give {FORMAT!r}")
    version = document["version"]
    if version != VERSION or type(version) is not int:
        raise InputError(
            f"version is {quoted(version)}, this labcdp reads {VERSION}: use a newer labcdp for newer ones"
        )
    regions = document["regions"]
    if not isinstance(regions, list):
        raise InputError("regions is not a list: give a list of regions in square brackets")
    image = document.get("image")
    return tuple(_shape(at, region) for at, region in enumerate(regions)), None if image is None else _size(image)


def _json(value: object) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def _region(shape: Shape) -> dict[str, Any]:
    limits_last = sorted(fields(shape), key=lambda field: field.name == "limits_cd_m2")
    given = {
        field.name: getattr(shape, field.name) for field in limits_last if getattr(shape, field.name) != field.default
    }
    return {"name": shape.name, "kind": shape.kind, **given}


def _shape(at: int, region: object) -> Shape:
    if not isinstance(region, dict):
        raise InputError(f"regions[{at}] is not a table: give one in curly brackets")
    name, kind = region.get("name"), region.get("kind")
    where = f"region {quoted(name)}: " if isinstance(name, str) else f"regions[{at}]: "
    if not isinstance(kind, str) or kind not in _KINDS:
        given = quoted(kind) if "kind" in region else "missing"
        raise InputError(f"{where}kind is {given}: give one of {', '.join(_KINDS)}")
    parameters = fields(_KINDS[kind])
    needed = [field.name for field in parameters if field.default is MISSING]
    table = _table(region, ["kind", *(field.name for field in parameters)], needed, where)
    return _KINDS[kind](**{key: value for key, value in table.items() if key != "kind"})


def _size(image: object) -> ImageSize:
    table = _table(image, ("width", "height"), ("width", "height"), "image: ")
    for key, value in table.items():
        if type(value) is not int or value < 1:
            raise InputError(f"image: {key} is {quoted(value)}: give a whole number of pixels of at least 1")
    return table["width"], table["height"]


def _table(table: object, known: Sequence[str], needed: Sequence[str], where: str) -> dict[str, Any]:
    """Return a table that has all keys that are needed, and no unknown one; raises InputError."""
    if not isinstance(table, dict):
        raise InputError(f"{where.removesuffix(': ')} is not a table: give {', '.join(needed)} in curly brackets")
    # Unknown keys first: a mistyped key also leaves the right one missing.
    for key in table:
        if key not in known:
            raise InputError(f"{where}{shortened(key)} is not a known key: {suggestion(key, known)}")
    for key in needed:
        if key not in table:
            raise InputError(f"{where}{key} is missing: give it")
    return table
