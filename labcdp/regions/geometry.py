"""Polygons of regions: crossings and insets."""

from __future__ import annotations

import re
from collections.abc import Sequence
from math import isfinite
from typing import Any

import numpy as np

from ..core.errors import InputError
from ..core.roi import Roi


def require_simple(roi: Roi) -> None:
    """Refuse a region whose edges cross or touch each other, or that has no area.

    Raises
    ------
    InputError
        Saying where they cross.

    Examples
    --------
    >>> from labcdp.core.roi import Roi
    >>> from labcdp.regions import require_simple
    >>> require_simple(Roi("roof", ((0.0, 10.0), (20.0, 10.0), (10.0, 0.0))))
    """
    if len(roi.corners) <= 4 and _turns_one_way(roi.corners):
        return
    import shapely

    polygon = shapely.Polygon(roi.corners)
    if polygon.is_valid and polygon.area > 0:
        return
    if shapely.MultiPoint(roi.corners).convex_hull.area == 0:
        raise InputError(f"region {roi.name!r} has no area: its corners lie on one line; draw it again")
    position = re.search(r"\[(\S+) (\S+)\]", shapely.is_valid_reason(polygon))
    where = f" at x {float(position[1]):.6g}, y {float(position[2]):.6g}" if position else ""
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

    Examples
    --------
    >>> from labcdp.core.roi import Roi
    >>> from labcdp.regions import inset
    >>> inset(Roi.rectangle("patch", 0, 0, 20, 20), 3).bounds
    (3.0, 3.0, 17.0, 17.0)
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
