"""Usable ranges, where CDP is high enough, and isolines, where it takes a given value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import inf, isfinite, log10, nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....core.errors import InputError
from .axes import At, CdpMap, MapAxis

#: Largest step of CDP between two grid points for linear interpolation of the crossing.
_RESOLVED_STEP = 0.2


@dataclass(frozen=True)
class End:
    """An end of an interval.

    Parameters
    ----------
    place : float
        Where it is, in the unit of the axis; if it is not resolved, the last grid point that is high enough.
    bracket : (float, float)
        The grid points around it, the lower one first; of an open end, the last grid point twice.
    is_open : bool
        Whether it is that of the map, or is next to a missing value, so that the range may continue beyond it.
    resolved : bool
        Whether CDP changes so little from grid point to grid point, by at most 0.2, that it is known. If not, all that
        is known is that it lies in the bracket.
    """

    place: float
    bracket: tuple[float, float]
    is_open: bool = False
    resolved: bool = True


@dataclass(frozen=True)
class UsableInterval:
    """A part of an axis on which CDP is high enough, no wider than the grid shows.

    Parameters
    ----------
    ends : (End, End)
        The lower and the upper one.
    of_ratios : bool
        Whether the ratio of the ends is meaningful, as for luminances.

    Attributes
    ----------
    low, high : float
        Places of the ends.
    decades : float
        log10(high / low); infinity if `low` is not above 0, nan if the ratio is not meaningful.
    range_db : float
        20 log10(high / low), as dynamic range is given by EMVA 1288.
    """

    ends: tuple[End, End]
    of_ratios: bool
    low: float = field(init=False)
    high: float = field(init=False)
    decades: float = field(init=False)
    range_db: float = field(init=False)

    def __post_init__(self) -> None:
        low, high = (end.place for end in self.ends)
        decades = nan if not self.of_ratios else log10(high / low) if low > 0 else inf
        for name, value in (("low", low), ("high", high), ("decades", decades), ("range_db", 20 * decades)):
            object.__setattr__(self, name, value)

    @property
    def width(self) -> tuple[float, float]:
        """Key for comparing intervals by width: decades if meaningful, then the difference of the ends."""
        return (self.decades if self.of_ratios else 0.0, self.high - self.low)


@dataclass(frozen=True)
class UsableRange:
    """All parts of an axis on which CDP is high enough, at one value of all other parameters.

    Parameters
    ----------
    at : dict of str to (float or str)
        Values of the other parameters.
    axis : str
        Name of the axis.
    level : float
        CDP that is high enough.
    intervals : tuple of UsableInterval
        In rising order; empty if CDP is nowhere high enough.

    Attributes
    ----------
    widest : UsableInterval or None
        The one of the largest ratio of its ends, or of the largest difference where a ratio is not meaningful.
    """

    at: At
    axis: str
    level: float
    intervals: tuple[UsableInterval, ...]
    widest: UsableInterval | None = field(init=False)

    def __post_init__(self) -> None:
        widest = max(self.intervals, key=lambda interval: interval.width, default=None)
        object.__setattr__(self, "widest", widest)


def usable_ranges(cdp_map: CdpMap, axis: str, level: float = 0.9) -> tuple[UsableRange, ...]:
    """Find where CDP is at least `level` along an axis, for each value of the other parameters.

    Parameters
    ----------
    cdp_map : CdpMap
        The map.
    axis : str
        Name of an axis of numbers, best the luminance.
    level : float
        Lowest CDP that is high enough, above 0, up to 1.

    Returns
    -------
    tuple of UsableRange
        One for each section of the map.

    Raises
    ------
    InputError
        If the axis is missing or not of numbers, or the level is out of range.

    Notes
    -----
    Between grid points CDP is taken as linear in the axis, or in its logarithm where the axis is logarithmic; not so
    between those of more than 0.2 difference, as where a sensor saturates, and on an axis of whole numbers: there the
    range ends at the last grid point that is high enough.
    """
    along = cdp_map.numbers(axis, "range")
    if not 0 < level <= 1:
        raise InputError(f"level is {level}: give a CDP above 0, up to 1")
    return tuple(
        UsableRange(at, axis, float(level), _intervals(along, section["cdp"].values, level))
        for at, section in cdp_map.sections(axis)
    )


def widest_range(ranges: tuple[UsableRange, ...]) -> UsableRange | None:
    """Return the range whose widest interval is the widest of all; None if all are empty."""
    candidates = [(usable.widest.width, usable) for usable in ranges if usable.widest]
    return max(candidates, key=lambda entry: entry[0])[1] if candidates else None


def _intervals(axis: MapAxis, values: NDArray[np.float64], level: float) -> tuple[UsableInterval, ...]:
    enough = np.concatenate(([False], values >= level, [False]))
    starts, stops = np.flatnonzero(~enough[:-1] & enough[1:]), np.flatnonzero(enough[:-1] & ~enough[1:])
    return tuple(
        UsableInterval(
            (_end(axis, values, level, start, start - 1), _end(axis, values, level, stop - 1, stop)), axis.of_ratios
        )
        for start, stop in zip(starts.tolist(), stops.tolist(), strict=True)
    )


def _end(axis: MapAxis, values: NDArray[np.float64], level: float, inside: int, outside: int) -> End:
    """Where CDP crosses the level between two neighbouring grid points."""
    last = float(axis.values[inside])
    if not 0 <= outside < values.size or not np.isfinite(values[outside]):
        return End(last, (last, last), is_open=True)
    low, high = sorted((last, float(axis.values[outside])))
    if axis.is_whole:
        return End(last, (low, high))
    step = values[inside] - values[outside]
    if step > _RESOLVED_STEP:
        return End(last, (low, high), resolved=False)
    share = (level - values[outside]) / step
    if share == 1:  # no rounding where the grid point itself is the end
        return End(last, (low, high))
    places = axis.scaled(axis.values[[outside, inside]])
    return End(float(axis.unscaled(places[0] + share * (places[1] - places[0]))), (low, high))


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
    cdp_map: CdpMap, x: str, y: str, levels: Sequence[float] = LEVELS, variable: str = "cdp"
) -> tuple[Isoline, ...]:
    """Find the isolines of a map over two of its axes, in each section over the others.

    Parameters
    ----------
    cdp_map : CdpMap
        The map.
    x, y : str
        Names of two axes of numbers.
    levels : sequence of float
        Values of the variable, each finite.
    variable : str
        Name of the variable.

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
    across, up = (cdp_map.numbers(name, "isolines", least=2) for name in (x, y))
    if not all(isfinite(level) for level in levels):
        raise InputError(f"levels are {list(levels)}: give finite numbers")
    return tuple(
        line
        for at, section in cdp_map.sections(y, x, variable=variable)
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
