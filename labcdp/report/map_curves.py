"""A map over one axis as curves: CDP with its 95 % band, and SNR."""

from __future__ import annotations

from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..evaluate.map_axes import MapAxis, MapLayout
from .digits import Z_95
from .drawing import ORANGE, SMALL_SIZE, TITLE_SIZE, label, new_figure, taken_literally
from .map_parts import COLOURS, SNR_COLOURS, curves_of, decibels, snr_of
from .map_scales import set_scale
from .map_wording import at_text, axis_label, conditions, notes, shown, title, variable_name

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from xarray import Dataset

    from ..evaluate.map_axes import At
    from ..evaluate.maps import MapAnalysis


#: Characters of the notes to an inch; few letters are wider than the mean of a line.
_CHARACTERS_PER_IN = 14.5


def draw_curves(dataset: Dataset, analysis: MapAnalysis, layout: MapLayout, axes: dict[str, MapAxis]) -> Figure:
    """Draw CDP along the axis, and below it the SNR with its dips."""
    curves = curves_of(dataset, layout)
    snr = snr_of(dataset, analysis, len(curves))
    figure = new_figure(9.0, 6.4 if snr else 4.0, simulated=False)
    panels = figure.subplots(2 if snr else 1, 1, sharex=True, squeeze=False).ravel()
    _draw_cdp(panels[0], curves, analysis, axes)
    for at, section in curves if snr else ():
        for name in snr:
            text, colour = _of_curve(curves, at, axes, SNR_COLOURS[name], variable_name(dataset, name))
            values = decibels(section[name].values)
            panels[1].plot(_places(layout.x), values, color=colour, label=text, marker=_marker(layout.x), markersize=4)
            _mark_dips(panels[1], values, at, analysis, layout.x, name)
    for panel in panels:
        _prepare(panel, layout.x)
    label(panels[0], "" if snr else axis_label(layout.x), "CDP", "")
    if snr:
        label(panels[1], axis_label(layout.x), "SNR (mean/std) in dB (20 log₁₀)", "")
    figure.suptitle(f"{title(dataset)}\n{conditions(dataset)}", fontsize=TITLE_SIZE, parse_math=False)
    write_notes(figure, notes(analysis, axes))
    figure.align_ylabels()
    return figure


def _places(axis: MapAxis) -> NDArray[np.float64]:
    return np.asarray(shown(axis, axis.values) if axis.numeric else np.arange(axis.values.size), dtype=np.float64)


def _marker(axis: MapAxis) -> str:
    return "" if axis.numeric and axis.values.size > 40 else "o"


def _of_curve(
    curves: list[tuple[At, Dataset]], at: At, axes: dict[str, MapAxis], colour: str, name: str
) -> tuple[str, str]:
    """Text and colour: by the section if there are several, else those of the variable."""
    if len(curves) == 1:
        return name, colour
    return at_text(at, axes), COLOURS[[other for other, _ in curves].index(at)]


def _draw_cdp(panel: Axes, curves: list[tuple[At, Dataset]], analysis: MapAnalysis, axes: dict[str, MapAxis]) -> None:
    axis = axes[analysis.x]
    for at, section in curves:
        text, colour = _of_curve(curves, at, axes, COLOURS[0], "CDP")
        cdp = section["cdp"].values
        panel.plot(_places(axis), cdp, color=colour, label=text, marker=_marker(axis), markersize=4)
        if "standard_error" in section and np.isfinite(section["standard_error"].values).any():
            half_width = Z_95 * section["standard_error"].values
            band = "95 % band" if len(curves) == 1 else None
            low, high = np.clip([cdp - half_width, cdp + half_width], 0, 1)
            panel.fill_between(_places(axis), low, high, color=colour, alpha=0.25, linewidth=0, label=band)
        _mark_dips(panel, cdp, at, analysis, axis, "cdp")
    panel.axhline(analysis.level, color="0.4", linewidth=1, linestyle=":", label=f"CDP {analysis.level:g}")
    only = analysis.usable_ranges[0].intervals if len(analysis.usable_ranges) == 1 else ()
    for number, interval in enumerate(only):
        low, high = shown(axis, [interval.low, interval.high])
        text = "_nolegend_" if number else "usable range"
        panel.axvspan(low, high, color=ORANGE, alpha=0.2, linewidth=0, zorder=0, label=text)
    panel.set_ylim(-0.03, 1.05)


def _mark_dips(
    panel: Axes, values: NDArray[np.float64], at: At, analysis: MapAnalysis, axis: MapAxis, variable: str
) -> None:
    ring: dict[str, Any] = {"marker": "o", "markersize": 10, "markerfacecolor": "none", "linestyle": "none"}
    for dip in analysis.dips:
        if dip.at == at and dip.variable == variable:
            named = "dip" in panel.get_legend_handles_labels()[1]
            height = values[int(np.searchsorted(axis.values, dip.position))]
            text = "_nolegend_" if named else "dip"
            panel.plot([float(shown(axis, dip.position))], [height], color="black", label=text, **ring)


def _prepare(panel: Axes, axis: MapAxis) -> None:
    set_scale(axis, panel.xaxis)
    if not axis.numeric:
        panel.set_xticks(_places(axis), list(axis.values), parse_math=False)
        panel.margins(x=0.1)
    panel.grid(color="0.9")
    panel.set_axisbelow(True)
    legend = panel.legend(fontsize=SMALL_SIZE, loc="upper left", bbox_to_anchor=(1.01, 1.02), frameon=False)
    taken_literally(legend)


def write_notes(figure: Figure, lines: list[str]) -> None:
    """Write lines below all else, each wrapped to the width of the figure."""
    characters = int(_CHARACTERS_PER_IN * figure.get_figwidth())
    wrapped = [part for line in lines for part in wrap(line, characters, subsequent_indent="    ")]
    # Below the figure proper: a picture is written with all that is drawn, and the layout above stays as it is.
    figure.text(0.02, -0.015, "\n".join(wrapped), va="top", fontsize=SMALL_SIZE, linespacing=1.4, parse_math=False)
