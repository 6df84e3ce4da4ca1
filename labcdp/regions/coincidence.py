"""Regions that are there already, though drawn or found a second time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import chain
from typing import Any

from .shapes import Shape

#: Regions coincide if they have at least this part of their joint area in common.
_COMMON_PART = 0.9


def new_shapes(found: Iterable[Shape], known: Sequence[Shape]) -> tuple[Shape, ...]:
    """Return the shapes with a region that coincides with none of the known ones, whatever their names.

    Parameters
    ----------
    found : iterable of Shape
        Such as what a detection finds.
    known : sequence of Shape
        What there is.

    Notes
    -----
    Two regions coincide if at least 90 % of their joint area is common to both (P. Jaccard's index, 1901): a pixel more
    or less at the edges, as between two images of one target, makes no second region.
    """
    import shapely

    there = [shapely.Polygon(roi.corners) for roi in chain.from_iterable(shape.rois() for shape in known)]
    tree = shapely.STRtree(there)

    def is_there(polygon: Any) -> bool:
        near = (there[index] for index in tree.query(polygon))
        return any(
            (common := polygon.intersection(other).area) >= _COMMON_PART * (polygon.area + other.area - common)
            for other in near
        )

    return tuple(shape for shape in found if not all(is_there(shapely.Polygon(roi.corners)) for roi in shape.rois()))
