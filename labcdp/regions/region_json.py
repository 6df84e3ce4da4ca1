"""The JSON format of region files."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import MISSING, Field, fields
from typing import Any, TypeAlias

from ..core.disk import parse_json, quoted, shortened
from ..core.disk.quoting import closest
from ..core.errors import InputError
from .shapes import CompositeShape, EllipseShape, GridShape, PolygonShape, RectangleShape, Shape

#: What the key "format" says, and the newest version of the format.
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
    document = _document(text)
    _check_keys(document, _KEYS, ("format", "version", "regions"), "")
    if document["format"] != FORMAT:
        raise InputError(f"format is {quoted(document['format'])}: give {FORMAT!r}")
    version = document["version"]
    if isinstance(version, int) and not isinstance(version, bool) and version > VERSION:
        raise InputError(f"version is {version}, this labcdp reads {VERSION}: use a newer labcdp")
    if version != VERSION or not isinstance(version, int) or isinstance(version, bool):
        raise InputError(f"version is {quoted(version)}: give {VERSION}")
    regions = document["regions"]
    if not isinstance(regions, list):
        raise InputError("regions is no list: give a list of regions in square brackets")
    image = document.get("image")
    return tuple(_shape(at, region) for at, region in enumerate(regions)), None if image is None else _size(image)


def _json(value: object) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def _document(text: str) -> dict[str, Any]:
    document = parse_json(text)
    if not isinstance(document, dict):
        raise InputError(f'it is no region file: give a table with "format": "{FORMAT}"')
    return document


def _region(shape: Shape) -> dict[str, Any]:
    table: dict[str, Any] = {"name": shape.name, "kind": shape.kind}
    for field in _parameters(type(shape)):
        value = getattr(shape, field.name)
        if value != field.default:
            table[field.name] = value
    return table


def _shape(at: int, region: object) -> Shape:
    if not isinstance(region, dict):
        raise InputError(f"regions[{at}] is no table: give one in curly brackets")
    name = region.get("name")
    where = f"region {quoted(name)}: " if isinstance(name, str) else f"regions[{at}]: "
    known = ", ".join(_KINDS)
    if "kind" not in region:
        raise InputError(f"{where}kind is missing: give one of {known}")
    kind = region["kind"]
    shape = _KINDS.get(kind) if isinstance(kind, str) else None
    if shape is None:
        raise InputError(f"{where}kind is {quoted(kind)}: give one of {known}")
    parameters = _parameters(shape)
    needed = [field.name for field in parameters if field.default is MISSING]
    _check_keys(region, ["name", "kind", *(field.name for field in parameters)], ["name", *needed], where)
    return shape(**{key: value for key, value in region.items() if key != "kind"})


def _parameters(shape: type[Shape]) -> list[Field[Any]]:
    return [field for field in fields(shape) if field.name != "name"]


def _size(image: object) -> ImageSize:
    if not isinstance(image, dict):
        raise InputError("image is no table: give its width and height in curly brackets")
    _check_keys(image, ("width", "height"), ("width", "height"), "image: ")
    for key, value in image.items():
        if not isinstance(value, int) or isinstance(value, bool) or value < 1:
            raise InputError(f"image: {key} is {quoted(value)}: give a whole number of pixels of at least 1")
    return image["width"], image["height"]


def _check_keys(table: dict[str, Any], known: Sequence[str], needed: Sequence[str], where: str) -> None:
    # Unknown keys first: a mistyped key also leaves the right one missing.
    for key in table:
        if key not in known:
            close = closest(key, known)
            hint = f"did you mean {close}?" if close else f"known here are {', '.join(known)}"
            raise InputError(f"{where}{shortened(key)} is not a known key: {hint}")
    for key in needed:
        if key not in table:
            raise InputError(f"{where}{key} is missing: give it")
