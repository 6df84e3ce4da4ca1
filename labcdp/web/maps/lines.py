"""Lines in a luminance map: the profile along one, and lines of equal luminance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, hypot

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.luminance import LuminanceMap
from ...report.drawing import block_mean
from ..regions.page_image import PageImage

#: Most points along the longer side of the map of which isolines are made, and fewest points of a line that is shown:
#: noise makes many short ones.
_ISOLINE_SIDE, _SHORTEST = 500, 10


@dataclass(frozen=True)
class Profile:
    """Luminance along a line.

    Parameters
    ----------
    distance_px : ndarray of float, shape (n,)
        Distance from the first end, in pixels of the image.
    luminance, expanded : ndarray of float, shape (n,)
        Luminance of the nearest pixel, and its U (95 %): nan if it is not known.
    """

    distance_px: NDArray[np.float64]
    luminance: NDArray[np.float64]
    expanded: NDArray[np.float64]


def profile(image: PageImage, ends: Sequence[float]) -> Profile:
    """Read the luminance along a line.

    Parameters
    ----------
    image : PageImage
        The image.
    ends : sequence of float
        x, y, x, y of the ends in pixels; what is outside the image is left out.

    Raises
    ------
    InputError
        If there are not four finite numbers, or all of the line is outside.
    """
    if len(ends) != 4 or not np.isfinite(ends).all():
        raise InputError("the ends of a line are four numbers x, y, x, y in pixels")
    xa, ya, xb, yb = ends
    step, (height, width) = image.luminance.step, image.luminance.shape
    length_px = hypot(xb - xa, yb - ya)
    # No more points than a screen could show of the largest image.
    share = np.linspace(0, 1, min(ceil(length_px / step), 20_000) + 1)
    columns = np.floor((xa + share * (xb - xa)) / step).astype(int)
    rows = np.floor((ya + share * (yb - ya)) / step).astype(int)
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    if not inside.any():
        raise InputError("the line is outside the image: draw it in the picture")
    luminance, expanded = image.light_at(rows[inside], columns[inside])
    return Profile(share[inside] * length_px, luminance, expanded)


@dataclass(frozen=True)
class Isoline:
    """A line of equal luminance.

    Parameters
    ----------
    level : float
        Its luminance.
    x, y : ndarray of float, shape (n,)
        Its points in pixels of the image.
    """

    level: float
    x: NDArray[np.float64]
    y: NDArray[np.float64]


def isolines(luminance: LuminanceMap, levels: Sequence[float]) -> list[Isoline]:
    """Find the lines of equal luminance in a map, reduced to at most 500 points a side; invalid pixels count too."""
    from contourpy import contour_generator

    side = ceil(max(luminance.shape) / _ISOLINE_SIDE)
    values = block_mean(np.nan_to_num(luminance.luminance_cd_m2, posinf=0.0, neginf=0.0), side)
    if min(values.shape) < 2:
        return []
    generator = contour_generator(z=values)
    pixels = side * luminance.step
    return [
        Isoline(level, pixels * (line[:, 0] + 0.5), pixels * (line[:, 1] + 0.5))
        for level in levels
        for line in map(np.asarray, generator.lines(level))
        if len(line) >= _SHORTEST
    ]
