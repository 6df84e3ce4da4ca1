"""Isolines of a map: where CDP takes a given value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ....core.errors import InputError
from .axes import At, MapAxis, map_axis, sections

if TYPE_CHECKING:
    from xarray import Dataset

#: Levels of CDP drawn in every map.
LEVELS = (0.5, 0.9, 0.95)


@dataclass(frozen=True)
class Isoline:
    """A line along which a variable of a map has one value.

    Parameters
    ----------
    at : dict of str to (float or str)
        Values of the parameters that are not axes of the line.
    level : float
        The value of the variable.
    x, y : tuple of float
        Points of the line, in the unit of the axes.
    closed : bool
        Whether the line ends where it begins.
    """

    at: At
    level: float
    x: tuple[float, ...]
    y: tuple[float, ...]
    closed: bool


def isolines(
    dataset: Dataset, x: str, y: str, levels: Sequence[float] = LEVELS, variable: str = "cdp"
) -> tuple[Isoline, ...]:
    """Find the isolines of a map over two of its axes, in each section over the others.

    Parameters
    ----------
    dataset : xarray.Dataset
        The map.
    x, y : str
        Names of two axes of numbers.
    levels : sequence of float
        Values of the variable, each finite.
    variable : str
        What to follow.

    Returns
    -------
    tuple of Isoline
        By section, then by level. Cells next to a missing value have no line.

    Raises
    ------
    InputError
        If an axis or the variable is missing, an axis has no numbers or fewer than two, or a level is not finite.

    Notes
    -----
    Marching squares; between grid points the variable is taken as linear in the axis, or in the logarithm of the
    axis where that is logarithmic. An error of at most h^2/8 times the second derivative follows, h the step.
    """
    across, up = map_axis(dataset, x), map_axis(dataset, y)
    for axis in (across, up):
        if not axis.numeric or axis.values.size < 2:
            raise InputError(f"axis {axis.name} has no isolines: choose an axis of at least two numbers")
    if variable not in dataset.data_vars:
        raise InputError(f"the map has no variable {variable!r}: choose one of {sorted(map(str, dataset.data_vars))}")
    if not all(isfinite(level) for level in levels):
        raise InputError(f"levels are {list(levels)}: give finite numbers")
    return tuple(
        line
        for at, section in sections(dataset, (y, x))
        for level in levels
        for line in _lines(at, section[variable].values, across, up, level)
    )


def _lines(at: At, values: NDArray[Any], across: MapAxis, up: MapAxis, level: float) -> list[Isoline]:
    from contourpy import LineType, contour_generator

    masked = np.ma.masked_invalid(values.astype(np.float64))
    generator = contour_generator(
        across.scaled(across.values), up.scaled(up.values), masked, corner_mask=True, line_type=LineType.Separate
    )
    lines = []
    for points in generator.lines(level):
        points = np.asarray(points, dtype=np.float64)
        x, y = (tuple(axis.unscaled(points[:, i]).tolist()) for i, axis in enumerate((across, up)))
        lines.append(Isoline(at, float(level), x, y, closed=bool((points[0] == points[-1]).all())))
    return lines
