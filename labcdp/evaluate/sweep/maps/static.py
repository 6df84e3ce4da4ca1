"""A map of CDP as a picture: heat maps with isolines, or curves."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, sqrt
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ....report import drawing
from .axes import At
from .labels import axis_label, conditions, title
from .view import SCALE, USABLE, WIDEST, DrawnCurve, MapView, drawn_places, heat_map, set_scale

#: Line styles of the isolines, in rising order of their levels.
_STYLES: tuple[Any, ...] = (":", "-", "--")

#: Characters of a line above a panel.
_TITLE_CHARACTERS = 32


def draw_map(view: MapView) -> Figure:
    """Draw a map: over two axes of numbers as heat maps with isolines, else as curves."""
    figure = _heat_maps(view) if view.map.y is not None else _curves(view)
    heading = f"{title(view.map.dataset)}\n{conditions(view.map.dataset)}"
    figure.suptitle(heading, fontsize=drawing.TITLE_SIZE, parse_math=False)
    return figure


def _heat_maps(view: MapView) -> Figure:
    x, y = view.map.x, view.map.y
    assert y is not None
    n = len(view.parts)
    columns = ceil(sqrt(n))
    rows = ceil(n / columns)
    width, height = (9.5, 5.0) if n == 1 else (2.5 + 3.6 * columns, 1.0 + 3.1 * rows)
    figure = drawing.new_figure(width, height)
    figure.set_layout_engine("compressed", w_pad=0.1)  # numbers at the ends of neighbours do not meet
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    handles: dict[str, Any] = {}
    for number, (axes, (at, section)) in enumerate(zip(grid, view.parts, strict=False)):
        mesh = heat_map(axes, x, y, section["cdp"].values, cmap=SCALE, vmin=0, vmax=1)
        handles |= _draw_lines(axes, view, at)
        # With axes shared, only those at the rim are labelled; above a hidden panel is the rim, too.
        rim = number + columns >= n
        text = "\n".join(wrap(view.text_of(at), _TITLE_CHARACTERS))
        drawing.label(axes, axis_label(x) if rim else "", axis_label(y) if number % columns == 0 else "", text)
        axes.tick_params(labelbottom=rim)
    for empty in grid[n:]:
        empty.set_visible(False)
    bar = figure.colorbar(mesh, ax=list(grid[:n]), ticks=np.linspace(0, 1, 6))
    bar.set_label("CDP", fontsize=drawing.LABEL_SIZE)
    bar.ax.tick_params(labelsize=drawing.SMALL_SIZE)
    entries = list(handles.values()), list(handles)
    drawing.add_legend(figure, *entries, loc="outside lower center", frameon=False, ncols=4)
    return figure


def _draw_lines(axes: Axes, view: MapView, at: At) -> dict[str, Any]:
    """Draw isolines and the widest usable range; return what the legend shows."""
    handles: dict[str, Any] = {}
    for text, number, lines in view.overlays(at):
        style: dict[str, Any] = {"color": "black", "linewidth": 1.3, "linestyle": _STYLES[(number or 0) % len(_STYLES)]}
        if number is None:
            axes.plot(*lines[0], color="white", linewidth=4.5, solid_capstyle="butt", clip_on=False)
            style = {"color": WIDEST, "linewidth": 2, "marker": "|", "markersize": 11, "markeredgewidth": 2}
        for line in lines:
            axes.plot(*line, clip_on=number is not None, **style)
        handles[text] = Line2D([], [], **style)
    return handles


def _curves(view: MapView) -> Figure:
    """Draw CDP along the axis, and below it the SNR with its dips."""
    cdp, snr = view.curves()
    figure = drawing.new_figure(9.0, 6.4 if snr else 4.0)
    panels = figure.subplots(2 if snr else 1, 1, sharex=True, squeeze=False).ravel()
    axis, level = view.map.x, view.analysis.level
    _draw_curves(panels[0], view, cdp)
    panels[0].axhline(level, color="0.4", linewidth=1, linestyle=":", label=f"CDP {level:g}")
    for number, ends in enumerate(view.usable):
        text = "_nolegend_" if number else "usable range"
        panels[0].axvspan(*ends, color=USABLE, alpha=0.2, linewidth=0, zorder=0, label=text)
    panels[0].set_ylim(-0.03, 1.05)
    if snr:
        _draw_curves(panels[1], view, snr)
    for panel, name in zip(panels, ("CDP", "SNR (mean/std) in dB (20 log₁₀)"), strict=False):
        set_scale(axis, panel.xaxis)
        if not axis.numeric:
            panel.set_xticks(drawn_places(axis), list(axis.values), parse_math=False)
            panel.margins(x=0.1)
        outside = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.02), "frameon": False}
        drawing.finish(panel, axis_label(axis) if panel is panels[-1] else "", name, "", **outside)
    figure.align_ylabels()
    return figure


def _draw_curves(panel: Axes, view: MapView, lines: Sequence[DrawnCurve]) -> None:
    places, band = drawn_places(view.map.x), "95 % intervals"
    for line in lines:
        marker = "o" if view.marked else ""
        panel.plot(places, line.values, color=line.colour, label=line.text, marker=marker, markersize=4)
        if line.band is not None:
            text = band if len(lines) == 1 else None
            panel.fill_between(places, *line.band, color=line.colour, alpha=0.25, linewidth=0, label=text)
    rings = [line.dips for line in lines if line.dips[0].size]
    for number, dips in enumerate(rings):
        text = "_nolegend_" if number else "dip"
        panel.plot(*dips, "o", color="black", markersize=10, markerfacecolor="none", label=text)
