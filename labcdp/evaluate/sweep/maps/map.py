"""Analysis of a map of CDP over parameters of a chain: isolines, usable ranges and dips."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .axes import SNR_VARIABLES, CdpMap
from .dips import SnrDip, find_dips
from .ranges import LEVELS, Isoline, UsableRange, isolines, usable_ranges, widest_range

if TYPE_CHECKING:
    from xarray import Dataset

#: CDP before a fall, below which nothing is detected that could be lost.
_LEAST_CDP = 0.1


@dataclass(frozen=True)
class MapAnalysis:
    """Analysis of a map; `dataclasses.asdict` gives values JSON can hold.

    Parameters
    ----------
    x, y : str
        Names of the axes across and up; `y` is empty if the map has one axis of numbers.
    level : float
        CDP that is high enough.
    usable_ranges : tuple of UsableRange
        Along `x`, one for each value of the other parameters.
    widest : UsableRange or None
        The one with the widest interval.
    dip_variables : tuple of str
        The variables searched for dips: an SNR, if the map has one, and CDP.
    dips : tuple of SnrDip
        Along `x`, by variable; of CDP only those from 0.1 or more.
    isolines : tuple of Isoline
        Over `x` and `y`.
    """

    x: str
    y: str
    level: float
    usable_ranges: tuple[UsableRange, ...]
    widest: UsableRange | None
    dip_variables: tuple[str, ...]
    dips: tuple[SnrDip, ...]
    isolines: tuple[Isoline, ...]


def analyse_map(dataset: Dataset, level: float = 0.9, expected: Sequence[float] = ()) -> MapAnalysis:
    """Analyse a map along the luminance, or along its first axis of numbers.

    Parameters
    ----------
    dataset : xarray.Dataset
        The map; at least `cdp` over one axis or more.
    level : float
        CDP that is high enough, above 0, up to 1.
    expected : sequence of float
        Luminances at which the sensor changes exposure (see `find_dips`).

    Returns
    -------
    MapAnalysis
        Without ranges, dips and isolines if no axis has numbers.

    Raises
    ------
    InputError
        If the dataset is no map, an axis cannot be used, or the level is out of range.
    """
    cdp_map = CdpMap.of(dataset)
    # The first that the map has: the dark region has the luminance of the axis.
    snr = tuple(name for name in SNR_VARIABLES if name in dataset.data_vars)[:1]
    x, y = cdp_map.x.name, cdp_map.y.name if cdp_map.y else ""
    ranges = usable_ranges(cdp_map, x, level) if cdp_map.x.numeric else ()
    dips = [dip for name in (*snr, "cdp") if cdp_map.x.numeric for dip in find_dips(cdp_map, x, name, expected)]
    return MapAnalysis(
        x=x,
        y=y,
        level=float(level),
        usable_ranges=ranges,
        widest=widest_range(ranges),
        dip_variables=(*snr, "cdp"),
        dips=tuple(dip for dip in dips if dip.variable != "cdp" or dip.highest >= _LEAST_CDP),
        isolines=isolines(cdp_map, x, y, LEVELS) if y else (),
    )
