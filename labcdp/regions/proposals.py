"""Regions proposed by superpixels, for the user to confirm; and which regions are new."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .shapes import PolygonShape, Shape
from .superpixels import Neighbours, inner, neighbours, superpixel_labels

#: Neighbours are alike if their means differ by less than this part of them, or by this many standard errors.
_ALIKE, _STANDARD_ERRORS = 0.02, 4.0

#: Distance of an outline from the next region, and how far a simpler outline may be from it, in pixels.
_MARGIN_PX, _SIMPLER_PX = 2, 0.7

#: Smallest region that is proposed, in superpixels.
_SMALLEST = 0.5


def propose_regions(image: NDArray[Any], size_px: int) -> tuple[PolygonShape, ...]:
    """Propose regions of an image for the user to confirm.

    Parameters
    ----------
    image : ndarray of int or float, shape (height, width)
        Linear light.
    size_px : int
        Side of the superpixels that regions are made of; what is smaller than half of one is not proposed.

    Returns
    -------
    tuple of PolygonShape
        The largest first. They do not cross themselves, lie inside the image and do not overlap. A region around
        another one is cut, since a polygon has no hole.

    Raises
    ------
    InputError
        As `superpixel_labels`.
    """
    labels = superpixel_labels(image, size_px)
    joined = _joined(image, labels)
    outlines = [polygon for mask, corner in _pieces(joined, size_px) for polygon in _outlines(mask, corner)]
    large = [outline for outline in outlines if outline.area >= _SMALLEST * size_px**2]
    large.sort(key=lambda outline: (-outline.area, outline.bounds))
    return tuple(
        PolygonShape(f"region {number}", tuple((float(x), float(y)) for x, y in outline.exterior.coords[:-1]))
        for number, outline in enumerate(large, start=1)
    )


def _joined(image: NDArray[Any], labels: NDArray[np.int32]) -> NDArray[np.int32]:
    """Labels with neighbours joined that do not differ, the most alike first; counted anew from 0.

    Whole groups are compared, so that light that changes slowly is not joined from end to end.
    """
    # At a border the lens mixes the light of both sides.
    counted = inner(labels, _MARGIN_PX)
    counted |= np.bincount(labels[counted], minlength=int(labels.max()) + 1)[labels] == 0
    label, values = labels[counted], np.where(np.isfinite(image), image, 0)[counted].astype(np.float64)
    n = np.bincount(label)
    mean = np.bincount(label, weights=values) / n
    variance = np.bincount(label, weights=np.square(values - mean[label])) / np.maximum(n - 1, 1)
    return _groups(neighbours(labels), n.astype(np.float64), mean, variance / n)[labels]


def _groups(
    near: Neighbours, n: NDArray[np.float64], mean: NDArray[np.float64], error_variance: NDArray[np.float64]
) -> NDArray[np.int32]:
    """Return the number of the group of each label."""
    from scipy.cluster.hierarchy import DisjointSet

    # By the label that stands for a group.
    n, mean, error_variance, groups = n.copy(), mean.copy(), error_variance.copy(), DisjointSet(range(n.size))

    def unlike(a: int, b: int) -> float:
        limit = max(
            _ALIKE * abs(mean[a] + mean[b]) / 2, _STANDARD_ERRORS * np.sqrt(error_variance[a] + error_variance[b])
        )
        difference = abs(mean[a] - mean[b])
        return float(difference / limit) if limit > 0 else float(difference > 0) * np.inf

    order = np.argsort([unlike(int(a), int(b)) for a, b in near.pairs], kind="stable")
    for first, second in near.pairs[order].tolist():
        a, b = groups[first], groups[second]
        if a != b and unlike(a, b) <= 1:
            groups.merge(a, b)
            whole = groups[a]
            mean[whole] = (n[a] * mean[a] + n[b] * mean[b]) / (n[a] + n[b])
            n[whole] = n[a] + n[b]
            error_variance[whole] = error_variance[a]
    _, numbers = np.unique([groups[label] for label in range(n.size)], return_inverse=True)
    return numbers.astype(np.int32)


def _pieces(labels: NDArray[np.int32], size_px: int) -> Iterator[tuple[NDArray[np.uint8], tuple[int, int]]]:
    """Yield masks without holes of what lies inside each region, with the upper left corner (x, y) of each."""
    import cv2
    from scipy.ndimage import find_objects

    inside = inner(labels, _MARGIN_PX)
    for number, window in enumerate(find_objects(labels + 1)):
        mask = ((labels[window] == number) & inside[window]).astype(np.uint8)
        # Without bridges of a pixel, at which an outline would touch itself.
        mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((3, 3), dtype=np.uint8), borderValue=0)
        for piece, (x, y) in _without_holes(mask, size_px):
            yield piece, (x + window[1].start, y + window[0].start)


def _without_holes(mask: NDArray[np.uint8], size_px: int) -> Iterator[tuple[NDArray[np.uint8], tuple[int, int]]]:
    """Yield a mask, or its parts left and right of the middle of its first hole; small ones are left out."""
    import cv2

    if np.count_nonzero(mask) < _SMALLEST * size_px**2:
        return
    contours, levels = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    holes = [contour for contour, (_, _, _, outer) in zip(contours, levels[0], strict=True) if outer >= 0]
    if not holes:
        yield mask, (0, 0)
        return
    left, _, width, _ = cv2.boundingRect(holes[0])
    cut = left + width // 2
    for part, start in ((mask[:, :cut], 0), (mask[:, cut:], cut)):
        for piece, (x, y) in _without_holes(np.ascontiguousarray(part), size_px):
            yield piece, (x + start, y)


def _outlines(mask: NDArray[np.uint8], corner: tuple[int, int]) -> Iterator[Any]:
    """Yield a simple polygon through the middles of the outermost pixels of each connected part of a mask."""
    import cv2
    import shapely

    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    for contour in contours:
        points = contour[:, 0, :] + np.array(corner) + 0.5
        if len(points) < 4:
            continue
        whole: Any = shapely.Polygon(points).buffer(0)
        for part in getattr(whole, "geoms", [whole]):
            simple: Any = shapely.Polygon(part.exterior).simplify(_SIMPLER_PX, preserve_topology=True)
            if simple.is_valid and not simple.is_empty:
                yield simple


#: Regions coincide if they have at least this part of their joint area in common.
_COMMON_PART = 0.9


def new_shapes(shapes: Iterable[Shape], known: Sequence[Shape]) -> tuple[Shape, ...]:
    """Return the shapes with a region that coincides with none of the known ones, whatever their names.

    Parameters
    ----------
    shapes : iterable of Shape
        Such as what a detection finds.
    known : sequence of Shape
        Shapes that exist already.

    Notes
    -----
    Two regions coincide if at least 90 % of their joint area is common to both (P. Jaccard's index, 1901): a pixel more
    or less at the edges, as between two images of one target, makes no second region.

    Examples
    --------
    >>> from labcdp.regions import RectangleShape, new_shapes
    >>> known = [RectangleShape("sky", 0, 0, 9, 9)]
    >>> found = [RectangleShape("P1", 30, 0, 9, 9), RectangleShape("P2", 0, 0, 9, 9)]
    >>> [shape.name for shape in new_shapes(found, known)]
    ['P1']
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

    return tuple(shape for shape in shapes if not all(is_there(shapely.Polygon(roi.corners)) for roi in shape.rois()))
