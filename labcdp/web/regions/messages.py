"""Messages between the page and labcdp, and the changes of a drawing that those of mouse and keys request."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, TypeVar

from bokeh.core.properties import Float, Int, List, String
from bokeh.model import DataModel

from ...core.disk import parse_json
from ...core.errors import InputError, naming
from ...regions import ImageSize, PolygonShape, Shape
from . import shapes as edit
from .drawing import Drawing
from .shapes import Corner
from .wording import OTHER_COLOUR, PROPOSAL_COLOUR, colour

#: Most corners of a drawn polygon.
_MOST_CORNERS = 10_000
_Kind = TypeVar("_Kind")


class PageLink(DataModel):  # type: ignore[misc]
    """Messages between the page and labcdp.

    Parameters
    ----------
    state, answers : str
        From labcdp: the drawing, and by serial number whether the last messages were applied; JSON.
    ask : str
        From a button: ``fit``, ``in`` or ``out``, and a counter that makes each message different.
    sent : str
        From mouse and keys: a message for `Workspace.do`; JSON.
    view : list of float
        Left, top, right and bottom of the visible part, in pixels of the image, and its size on the screen.
    pointer : list of int
        Pixel under the pointer; empty outside the image.
    line : list of float
        Ends x, y, x, y of the last line drawn for a profile; empty if none.
    n_refreshes, n_handled : int
        Number of the newest refresh, and of the newest one that the browser has handled.
    drawn : int
        Number of the newest image that the browser has drawn.
    tab : str
        Name of the tab of the browser, which stays while it is reloaded.
    """

    state = String(default="{}")
    answers = String(default="{}")
    ask = String(default="")
    sent = String(default="")
    view = List(Float)
    pointer = List(Int)
    line = List(Float)
    n_refreshes = Int(default=0)
    n_handled = Int(default=0)
    drawn = Int(default=0)
    tab = String(default="")


def state_of(drawing: Drawing, selected: str | None) -> dict[str, Any]:
    """Return a drawing as the page gets it, in values JSON can hold."""
    width, height = drawing.size
    shapes = []
    for shape in (*drawing.shapes, *drawing.proposals):
        proposal = drawing.is_proposal(shape.name)
        rois = shape.rois()
        colours = [PROPOSAL_COLOUR if proposal else colour(drawing, roi.name) for roi in rois]
        shapes.append(
            {
                "name": shape.name,
                "kind": shape.kind,
                "outlines": [[[round(x, 2), round(y, 2)] for x, y in roi.corners] for roi in rois],
                "colours": colours,
                "handles": edit.handles(shape),
                "angle": 0.0 if isinstance(shape, PolygonShape) else shape.angle_deg,
                "label": "" if proposal and shape.name != selected else shape.name,
                "label_colour": colours[0] if len(set(colours)) == 1 else OTHER_COLOUR,
                "paired": any(roi.name in drawing.pair for roi in rois),
                "proposal": proposal,
            }
        )
    return {"width": width, "height": height, "selected": selected, "shapes": shapes}


def parse_message(text: str) -> dict[str, Any]:
    """Parse a message of the page; raises InputError if it is invalid."""
    with naming("the page sent an invalid message"):
        message = parse_json(text)
    if not isinstance(message, dict) or not isinstance(message.get("do"), str):
        raise InputError("the page sent a message without an action")
    return message


def change(drawing: Drawing, message: Mapping[str, Any]) -> tuple[Drawing, str | None]:
    """Return the drawing changed by a message, and the name of the shape then selected (None for none).

    Parameters
    ----------
    drawing : Drawing
        Current drawing.
    message : mapping
        ``do`` with its arguments: ``polygon`` (corners), ``box`` (kind, start, end), ``corner`` (name, at, to),
        ``insert`` (name, after, at), ``remove corner`` (name, at), ``move`` (name, by), ``delete`` (name), ``rename``
        (name, to), ``accept`` (name), ``limits`` (name, of two numbers or None).

    Raises
    ------
    InputError
        If the message is invalid, or the drawing cannot be changed accordingly.
    """
    what, size = message["do"], drawing.size
    if what in ("polygon", "box"):
        name = drawing.new_name()
        return drawing.added(_drawn_shape(what, name, message, size)), name
    name = _field(message, "name", str)
    if what == "delete":
        return drawing.deleted(name), None
    if what == "rename":
        to = _field(message, "to", str).strip()
        return drawing.renamed(name, to), to
    if what == "accept":
        return drawing.accepted([name]), name
    return drawing.changed(name, lambda shape: _edited(what, shape, message, size)), name


def _drawn_shape(what: str, name: str, message: Mapping[str, Any], size: ImageSize) -> Shape:
    if what == "box":
        return edit.box_shape(
            _field(message, "kind", str), name, _position(message, "start"), _position(message, "end"), size
        )
    corners = message.get("corners")
    if not isinstance(corners, list) or len(corners) > _MOST_CORNERS:
        raise InputError(f"a polygon has 3 to {_MOST_CORNERS} corners: draw it again")
    return edit.polygon_shape(name, tuple(_position({"corner": corner}, "corner") for corner in corners), size)


def _edited(what: str, shape: Shape, message: Mapping[str, Any], size: ImageSize) -> Shape:
    match what:
        case "corner":
            return edit.with_handle(shape, _field(message, "at", int), _position(message, "to"), size)
        case "insert":
            return edit.with_corner(shape, _field(message, "after", int), _position(message, "at"), size)
        case "remove corner":
            return edit.without_corner(shape, _field(message, "at", int))
        case "move":
            return edit.moved(shape, _position(message, "by"), size)
        case "limits":
            return replace(shape, limits_cd_m2=message.get("of"))
    raise InputError(f"the page asked for {what!r}, which is unknown: reload it")


def _position(message: Mapping[str, Any], key: str) -> Corner:
    value = message.get(key)
    if isinstance(value, list) and [type(coordinate) in (int, float) for coordinate in value] == [True, True]:
        return float(value[0]), float(value[1])
    raise InputError(f"the page sent a {key} that is not two numbers: reload it")


def _field(message: Mapping[str, Any], key: str, kind: type[_Kind]) -> _Kind:
    value = message.get(key)
    if type(value) is not kind:
        raise InputError(f"the page sent no {key} that can be used: reload it")
    return value
