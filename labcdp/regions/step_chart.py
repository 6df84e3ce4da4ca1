"""Detection of step charts: patches of different luminance in a row or a grid."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.roi import Roi
from .corners import FloatImage, grey_values, reduced
from .lattice import largest_lattice, places_between, sides_of
from .shapes import PolygonShape

#: Two places differ if their values do by this part at least, in an image without noise.
_LEAST_CONTRAST = 0.03
#: And by this many standard deviations of the noise that smoothing leaves: a window of 25 values spans about 4.
_LEAST_SIGMA = 7.0

#: Radii of windows, in pixels, over which a uniform area may not change; a larger one averages more noise.
_RADII = (1, 2, 4, 7)

#: Smallest area of a patch in pixels, and largest in parts of the image.
_LEAST_AREA_PX, _LARGEST_AREA = 36, 0.35

#: Part of its quadrilateral that a uniform area fills.
_FILLED = 0.9

#: Fewest luminances of a chart, and most areas that are looked at.
_FEWEST_LEVELS, _MOST_PATCHES = 3, 400


def detect_step_chart(grey: NDArray[Any]) -> tuple[PolygonShape, ...]:
    """Find the patches of a step chart: uniform quadrilaterals of one size in a row, a column or a grid.

    Parameters
    ----------
    grey : ndarray, shape (height, width)
        Image, linear in light or nearly so. A chart has three patches at least, of at least three luminances; each
        differs from what is around it by about 5 % or more.

    Returns
    -------
    tuple of PolygonShape
        The patches from left to right and top to bottom, called ``step1``, ``step2`` and so on (``step01`` where there
        are ten or more); within the edges of each.

    Raises
    ------
    InputError
        If no chart is found for sure.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp.regions import detect_step_chart
    >>> image = np.full((100, 300), 20, np.uint8)
    >>> for number, level in enumerate((40, 80, 120, 160)):
    ...     image[30:70, 30 + 65 * number : 75 + 65 * number] = level
    >>> [patch.name for patch in detect_step_chart(image)]
    ['step1', 'step2', 'step3', 'step4']
    """
    image = grey_values(grey)
    values, scale = reduced(image)
    # First what the image shows all of; only then what its edge may cut off.
    # A larger window only if it shows more: it takes more off the patches.
    best = next(filter(None, (max((_chart(values, r, whole) for r in _RADII), key=len) for whole in (True, False))), [])
    if not best:
        raise InputError(
            f"no step chart was found in the image of {image.shape[1]} x {image.shape[0]} pixels: show at least "
            f"{_FEWEST_LEVELS} patches of one size and different luminance in a row or a grid, or draw the regions"
        )
    digits = len(str(len(best)))
    return tuple(
        PolygonShape(f"step{number:0{digits}d}", tuple((x / scale, y / scale) for x, y in patch.tolist()))
        for number, patch in enumerate(best, 1)
    )


def _chart(values: FloatImage, radius: int, whole: bool) -> list[NDArray[np.float64]]:
    """Return the corners of a chart's patches, row by row, found with windows of this radius; empty without a chart.

    A chart has patches of at least three luminances, distinguished by 3 %.
    """
    uniform = _uniform(values, radius)
    patches = list(_patches(values, uniform, radius, whole))
    corners = np.array([patch for patch, _ in patches]).reshape(-1, 4, 2)
    largest = np.argsort(-np.abs(np.linalg.det(sides_of(corners))), kind="stable")[:_MOST_PATCHES]
    corners, levels = corners[largest], np.array([level for _, level in patches])[largest]
    chart = largest_lattice(corners)
    if not chart:
        return []
    steps = np.sort(levels[list(chart.values())])
    if 1 + (np.diff(steps) > _LEAST_CONTRAST * np.abs(steps[1:])).sum() < _FEWEST_LEVELS:
        return []
    complete = {at: corners[patch] for at, patch in chart.items()}
    # A patch that is as light as what is around it has no edge that could be found.
    for at, corners_px in places_between(chart, corners).items():
        if _inside(corners_px, uniform).mean() > _FILLED:
            complete[at] = corners_px
    return [complete[at] for at in sorted(complete)]


def _patches(
    values: FloatImage, uniform: NDArray[np.bool_], radius: int, whole: bool
) -> Iterator[tuple[NDArray[np.float64], float]]:
    """Give corners and median of areas in which values stay alike in such windows, of cut off ones if not `whole`."""
    import cv2

    count, labels, stats, _ = cv2.connectedComponentsWithStats(uniform.astype(np.uint8), connectivity=4)
    height, width = values.shape
    for label in range(1, count):
        x, y, w, h, area = (int(v) for v in stats[label])
        if area < _LEAST_AREA_PX or area > _LARGEST_AREA * values.size:
            continue
        cut_off = x <= radius or y <= radius or x + w >= width - radius or y + h >= height - radius
        if whole and cut_off:
            continue
        area_mask = labels[y : y + h, x : x + w] == label
        corners = _quadrilateral(area_mask.astype(np.uint8))
        if corners is not None:
            yield corners + np.array([x, y]), float(np.median(values[y : y + h, x : x + w][area_mask]))


def _uniform(values: FloatImage, radius: int) -> NDArray[np.bool_]:
    """Return where only noise changes within a square of 2 `radius` + 1 pixels."""
    import cv2

    smooth = cv2.GaussianBlur(values, (0, 0), max(radius / 2, 0.5)) if radius > 1 else values
    window = np.ones((2 * radius + 1, 2 * radius + 1), np.uint8)
    span = cv2.dilate(smooth, window) - cv2.erode(smooth, window)
    level = cv2.GaussianBlur(values, (0, 0), radius)
    noise = _noise_of_level(smooth, level)
    return np.asarray(span < np.maximum(_LEAST_SIGMA * noise, _LEAST_CONTRAST * np.abs(level)))


def _noise_of_level(smooth: FloatImage, level: FloatImage) -> NDArray[np.float32]:
    """Return the standard deviation of the noise for each pixel: shot noise rises with the level.

    From second differences, which neither a gradient nor an edge here and there disturbs.
    """
    step = 4
    differences = np.abs(2 * smooth[:, step:-step] - smooth[:, : -2 * step] - smooth[:, 2 * step :]).ravel()
    levels = level[:, step:-step].ravel()
    every = max(1, levels.size // 200_000)
    differences, levels = differences[::every], levels[::every]
    edges = np.unique(np.quantile(levels, np.linspace(0, 1, 17)))
    # 1.4826: the median of |x| in standard deviations of normal noise; 6 = 4 + 1 + 1 variances.
    noise = {
        (low + high) / 2: 1.4826 * float(np.median(differences[(levels >= low) & (levels <= high)])) / np.sqrt(6)
        for low, high in pairwise(edges)
    }
    if not noise:
        return np.zeros_like(level)
    # Noise rises with the level, at most in proportion; where it seems to rise more, it is edges that are seen. Levels
    # without noise are saturated.
    known = [(low, sigma) for low, sigma in noise.items() if sigma > 0 and low > 0]
    bounded = [min([sigma, *(other * max(1.0, high / low) for low, other in known)]) for high, sigma in noise.items()]
    return np.asarray(np.interp(level, list(noise), bounded), dtype=np.float32)


def _quadrilateral(area: NDArray[np.uint8]) -> NDArray[np.float64] | None:
    """Return the corners of an area, from the upper left one clockwise as seen, if it is a quadrilateral."""
    import cv2

    contours, _ = cv2.findContours(area, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    contour = max(contours, key=len)
    hull = cv2.convexHull(contour)
    length = cv2.arcLength(hull, True)
    for tolerance in np.arange(0.01, 0.12, 0.01):
        corners = cv2.approxPolyDP(hull, tolerance * length, True)
        if len(corners) <= 4:
            break
    if len(corners) != 4:
        return None
    filled = np.zeros_like(area)
    cv2.fillPoly(filled, [corners], 1)
    # Holes of noise within are no fault, what sticks out is.
    outline = np.zeros_like(area)
    cv2.drawContours(outline, [contour], -1, 1, cv2.FILLED)
    if (filled & outline).sum() < _FILLED * (filled | outline).sum() or area.sum() < 0.7 * outline.sum():
        return None
    # Corners of the contour are centres of pixels, in clockwise order as those of its hull.
    around = corners.reshape(4, 2).astype(np.float64) + 0.5
    # The side that points most to the right is the upper one.
    sides = np.roll(around, -1, axis=0) - around
    return np.asarray(np.roll(around, -int(np.argmax(sides[:, 0] / np.hypot(*sides.T))), axis=0))


def _inside(corners: NDArray[np.float64], values: NDArray[Any]) -> NDArray[Any]:
    """Return what lies within a quadrilateral."""
    return Roi("patch", tuple((float(x), float(y)) for x, y in corners)).select(values)
