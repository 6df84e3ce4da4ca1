"""Panels or curves of a map for its picture and page, in the units that are shown."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import cycle
from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ....report.drawing import BLUE, GREEN, ORANGE, VERMILLION, logarithmic
from ....report.text import Z_95
from .axes import SNR_VARIABLES, TO_DETECT, VARIABLES, At, CdpMap, MapAxis, known_values
from .labels import at_text, axis_unit, ends_text, shown
from .map import MapAnalysis

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh
    from xarray import Dataset


#: More panels than this are too small to read.
MOST_PANELS = 12

#: Colours of curves: the most that are distinguishable.
COLOURS = (BLUE, VERMILLION, GREEN, ORANGE, "#CC79A7", "#56B4E9", "#000000", "#8C7500")

#: Colours of the SNR of a single section, without those of its curves of CDP.
_SNR_COLOURS = (GREEN, "#CC79A7", "#000000", "#8C7500", "#56B4E9", ORANGE)

#: Colours of missing values, of usable ranges and of the widest one in a heat map, and name of the scale of CDP.
MISSING, USABLE, WIDEST, SCALE = "#d9d9d9", ORANGE, VERMILLION, "viridis"

#: Points of a curve up to which each has a mark.
_MARKED = 40

Points = tuple[NDArray[np.float64], NDArray[np.float64]]


@dataclass(frozen=True, eq=False)
class DrawnCurve:
    """A curve.

    Parameters
    ----------
    text, colour : str
        In the legend; of several sections, the curves of one have the same.
    section : Dataset
        The section.
    values : ndarray of float, shape (n,)
        CDP, or SNR in dB.
    band : (ndarray, ndarray) or None
        Ends of the 95 % intervals.
    dips : (ndarray, ndarray)
        Places and values of its dips.
    """

    text: str
    colour: str
    section: Dataset
    values: NDArray[np.float64]
    band: Points | None
    dips: Points


@dataclass(frozen=True, eq=False)
class MapView:
    """A map as it is drawn.

    Parameters
    ----------
    map : CdpMap
        The map.
    analysis : MapAnalysis
        Of the same map.
    parts : list of (At, Dataset)
        Sections that are drawn: each a panel if the picture has two axes, else a curve.
    left_out : int
        Sections that are not drawn, as there are too many.
    """

    map: CdpMap
    analysis: MapAnalysis
    parts: list[tuple[At, Dataset]]
    left_out: int

    @classmethod
    def of(cls, dataset: Dataset, analysis: MapAnalysis) -> MapView:
        """Choose what is drawn: of too many sections some, evenly spread from the first to the last."""
        cdp_map = CdpMap.of(dataset)
        count = prod(axis.values.size for name, axis in cdp_map.axes.items() if name not in cdp_map.spanned)
        most = len(COLOURS) if cdp_map.y is None else MOST_PANELS
        chosen = set(np.linspace(0, count - 1, min(count, most)).round().astype(int).tolist())
        parts = [part for index, part in enumerate(cdp_map.sections(*cdp_map.spanned)) if index in chosen]
        return cls(cdp_map, analysis, parts, count - len(parts))

    @property
    def marked(self) -> bool:
        """Whether each point of a curve has a mark."""
        return not self.map.x.numeric or self.map.x.values.size <= _MARKED

    @property
    def usable(self) -> list[tuple[float, float]]:
        """Ends of the usable ranges of a single curve."""
        ranges = self.analysis.usable_ranges
        intervals = ranges[0].intervals if len(ranges) == 1 else ()
        return [tuple(shown(self.map.x, [interval.low, interval.high]).tolist()) for interval in intervals]

    def text_of(self, at: At) -> str:
        """Name a section."""
        return at_text(at, self.map.axes)

    def overlays(self, at: At) -> Iterator[tuple[str, int | None, list[Points]]]:
        """Iterate over the lines drawn over a section: text, number and lines.

        These are the isolines, numbered by their levels, and without number the widest usable range if it lies there.
        """
        x, y, usable = self.map.x, self.map.y, self.analysis.widest
        assert y is not None
        for number, level in enumerate(sorted({line.level for line in self.analysis.isolines})):
            lines = [line for line in self.analysis.isolines if line.at == at and line.level == level]
            yield f"CDP {level:g}", number, [(shown(x, line.x), shown(y, line.y)) for line in lines]
        if usable is not None and usable.widest is not None and all(usable.at[name] == at[name] for name in at):
            ends = shown(x, [usable.widest.low, usable.widest.high]), shown(y, [usable.at[y.name]] * 2)
            yield f"widest usable range, {ends_text(x, usable.widest)} {axis_unit(x)}".rstrip(), None, [ends]

    def curves(self) -> tuple[list[DrawnCurve], list[DrawnCurve]]:
        """Return the curves of CDP and of SNR: of a single section all SNR, of several the one searched for dips.

        The SNR does not depend on the contrast to be detected.
        """
        names = [name for name in SNR_VARIABLES if name in self.map.dataset]
        apart = [at for at, _ in self.parts if at.get(TO_DETECT) == self.parts[0][0].get(TO_DETECT)]
        if len(apart) > 1:
            names = [name for name in names if name in self.analysis.dip_variables]
        several, cdp, snr = len(self.parts) > 1, [], []
        free = [name for name in _SNR_COLOURS if name not in COLOURS[: len(self.parts)]] or _SNR_COLOURS
        for colour, (at, section) in zip(COLOURS, self.parts, strict=False):
            cdp.append(self._line(at, section, "cdp", self.text_of(at) if several else "CDP", colour))
            section_text = (
                self.text_of({name: value for name, value in at.items() if name != TO_DETECT}) if several else ""
            )
            for name, other in zip(names, cycle(free), strict=False) if at in apart else ():
                text_and_colour = (section_text, colour) if section_text else (VARIABLES[name].label, other)
                snr.append(self._line(at, section, name, *text_and_colour))
        return cdp, snr

    def _line(self, at: At, section: Dataset, variable: str, text: str, colour: str) -> DrawnCurve:
        values = section[variable].values
        if variable in SNR_VARIABLES:
            # As EMVA 1288 gives SNR; nan where it is 0 or there is no noise.
            known = known_values(variable, values)
            values = 20 * np.log10(np.where(known > 0, known, np.nan))
        places = [dip.position for dip in self.analysis.dips if dip.at == at and dip.variable == variable]
        rings = values[np.searchsorted(self.map.x.values, places)] if places else np.array([])
        band = _band(section) if variable == "cdp" else None
        return DrawnCurve(text, colour, section, values, band, (shown(self.map.x, np.array(places)), rings))


def drawn_places(axis: MapAxis) -> Any:
    """Return the places of the values of an axis in the picture; texts are numbered."""
    return shown(axis, axis.values) if axis.numeric else np.arange(axis.values.size)


def set_scale(axis: MapAxis, drawn: Any) -> None:
    """Make a drawn axis logarithmic if the map's is."""
    if axis.log:
        logarithmic(drawn)


def cell_edges(axis: MapAxis) -> NDArray[np.float64]:
    """Edges of the cells around the values of an axis as they are drawn, half way on its scale, shape (n + 1,).

    A cell ends at 0 where nothing can be below it, as with contrasts.
    """
    places = axis.scaled(axis.values)
    if places.size == 1:
        half = 0.5 * (abs(places[0]) or 1.0)
        edges = axis.unscaled(np.array([places[0] - half, places[0] + half]))
    else:
        middles = (places[1:] + places[:-1]) / 2
        edges = axis.unscaled(np.r_[2 * places[0] - middles[0], middles, 2 * places[-1] - middles[-1]])
    drawn: NDArray[np.float64] = shown(axis, np.maximum(edges, 0) if axis.never_negative else edges)
    return drawn


def heat_map(panel: Axes, x: MapAxis, y: MapAxis, values: NDArray[np.float64], **how: Any) -> QuadMesh:
    """Draw values over two axes, shape (up, across), with matplotlib's settings `how`."""
    panel.set_facecolor(MISSING)
    mesh = panel.pcolormesh(cell_edges(x), cell_edges(y), np.ma.masked_invalid(values), **how)
    set_scale(x, panel.xaxis)
    set_scale(y, panel.yaxis)
    return mesh


def _band(section: Dataset) -> Points | None:
    if "standard_error" not in section or not np.isfinite(section["standard_error"].values).any():
        return None
    expanded = Z_95 * section["standard_error"].values
    low, high = np.clip([section["cdp"].values - expanded, section["cdp"].values + expanded], 0, 1)
    return low, high
