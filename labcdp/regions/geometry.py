"""Polygons of regions: crossings and insets; checks of names, numbers and limits of shapes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import fields
from math import isfinite
from numbers import Real
from typing import Any

import numpy as np

from ..core.disk.files import MOST_QUOTED, quoted
from ..core.errors import InputError
from ..core.roi import Roi


def require_simple(roi: Roi) -> None:
    """Refuse a region whose edges cross or touch each other, or that has no area.

    Raises
    ------
    InputError
        Saying where they cross.
    """
    if len(roi.corners) <= 4 and _turns_one_way(roi.corners):
        return
    import shapely

    polygon = shapely.Polygon(roi.corners)
    if polygon.is_valid and polygon.area > 0:
        return
    if shapely.MultiPoint(roi.corners).convex_hull.area == 0:
        raise InputError(f"region {roi.name!r} has no area: its corners lie on one line; draw it again")
    place = re.search(r"\[(\S+) (\S+)\]", shapely.is_valid_reason(polygon))
    where = f" at x {float(place[1]):.6g}, y {float(place[2]):.6g}" if place else ""
    raise InputError(f"region {roi.name!r} crosses itself{where}: give its corners in order around it")


def _turns_one_way(corners: Sequence[tuple[float, float]]) -> bool:
    """Whether a polygon bends the same way at each corner: with up to four corners it cannot cross itself then."""
    sides = np.diff(corners, axis=0, append=corners[:1])
    x, y = sides.T
    with np.errstate(over="ignore", invalid="ignore"):
        bends = x * np.roll(y, -1) - y * np.roll(x, -1)
    return bool((bends > 0).all() or (bends < 0).all())


def is_simple(corners: Sequence[tuple[float, float]]) -> bool:
    """Whether the edges of a polygon neither cross nor touch each other."""
    import shapely

    return bool(shapely.Polygon(corners).is_valid)


def in_one_line(rings: Sequence[Sequence[tuple[float, float]]]) -> tuple[tuple[float, float], ...]:
    """Corners of one line around all parts and holes of a region; the ways between them are passed twice.

    Parts go around one way and holes the other, so that the area of the line is that of the region.
    """
    import shapely

    areas = [shapely.Polygon(ring) for ring in rings]
    line: list[tuple[float, float]] = []
    for at, (ring, area) in enumerate(zip(rings, areas, strict=True)):
        start = shapely.Point(ring[0])
        around = sum(other.buffer(0).contains(start) for n, other in enumerate(areas) if n != at)
        ordered = list(ring) if area.exterior.is_ccw == (around % 2 == 0) else list(ring)[::-1]
        line += [*ordered, ordered[0]] if len(rings) > 1 else ordered
        line += [line[0]] if at else []
    return tuple(line)


def inset(roi: Roi, margin_px: float) -> Roi:
    """Return what of a region lies at least `margin_px` from its edges, under the same name.

    Parameters
    ----------
    roi : Roi
        A region whose edges do not cross.
    margin_px : float
        Distance from the edges in pixels, at least 0.

    Raises
    ------
    InputError
        If the region crosses itself, the margin is negative or no number, nothing is left, or more than one piece is.
    """
    if not (isfinite(margin_px) and margin_px >= 0):
        raise InputError(f"the margin at the edges of region {roi.name!r} is {margin_px:g} pixels: give at least 0")
    require_simple(roi)
    if margin_px == 0:
        return roi
    import shapely

    # Mitred corners: a rectangle stays one, and nothing within the margin is kept at an inward corner.
    left: Any = shapely.Polygon(roi.corners).buffer(-margin_px, join_style="mitre")
    pieces = [piece for piece in getattr(left, "geoms", [left]) if piece.area > 0]
    if not pieces:
        raise InputError(
            f"nothing of region {roi.name!r} is left {margin_px:g} pixels from its edges: "
            "give a smaller margin or a larger region"
        )
    if len(pieces) > 1:
        raise InputError(
            f"region {roi.name!r} falls into {len(pieces)} pieces {margin_px:g} pixels from its edges: "
            "give a smaller margin, or draw the pieces as regions of their own"
        )
    return Roi(roi.name, tuple(pieces[0].exterior.coords[:-1]))


#: Coordinates beyond any image.
MOST_PX = 1e7


def check_name(name: object) -> None:
    """Refuse what is no name for a region: 1 to 100 printable characters, no space at its ends; raises InputError."""
    good = isinstance(name, str) and 0 < len(name) <= MOST_QUOTED and name == name.strip() and name.isprintable()
    if not good:
        raise InputError(
            f"the name of a region is {quoted(name)}: give 1 to {MOST_QUOTED} printable characters, without spaces at "
            "its ends"
        )


def check_box(shape: Any) -> None:
    """Make the numbers of a shape with a box floats; raises InputError for what is not finite or has no size."""
    for one in fields(shape):
        if one.name not in ("name", "rows", "columns", "limits_cd_m2"):
            object.__setattr__(shape, one.name, number(shape.name, one.name, getattr(shape, one.name)))
    check_limits(shape)
    for key in ("width", "height"):
        value = getattr(shape, key)
        if not value > 0:
            raise InputError(f"region {quoted(shape.name)}: {key} is {value:g}: give a number of pixels above 0")


def check_limits(shape: Any) -> None:
    """Make the limits of a shape floats, and refuse others; raises InputError."""
    given = shape.limits_cd_m2
    if given is None:
        return
    if not (isinstance(given, Sequence) and not isinstance(given, str) and len(given) == 2):
        raise InputError(f"region {quoted(shape.name)}: limits_cd_m2 is {quoted(given)}: give two numbers [low, high]")
    low, high = (number(shape.name, "limits_cd_m2", one) for one in given)
    if not 0 <= low < high:
        raise InputError(f"region {quoted(shape.name)}: limits_cd_m2 is [{low:g}, {high:g}]: give 0 <= low < high")
    object.__setattr__(shape, "limits_cd_m2", (low, high))


def number(name: str, key: str, value: object) -> float:
    """Return a finite number of a region as a float; raises InputError."""
    if type(value) is not bool and isinstance(value, Real):
        try:
            number = float(value)
        except OverflowError:
            number = float("inf")
        if abs(number) <= MOST_PX:
            return number
        if isfinite(number):
            raise InputError(
                f"region {quoted(name)}: {key} is {number:g}: give a number from {-MOST_PX:g} to {MOST_PX:g}"
            )
    raise InputError(f"region {quoted(name)}: {key} is {quoted(value)}: give a finite number")
