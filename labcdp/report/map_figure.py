"""A map of CDP as a picture: heat maps with isolines, or curves."""

from __future__ import annotations

from math import ceil, sqrt
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..evaluate.map_axes import At, MapAxis, map_layout
from .drawing import LABEL_SIZE, SMALL_SIZE, TITLE_SIZE, VERMILLION, label, new_figure, png
from .map_curves import draw_curves, write_notes
from .map_parts import axes_of, panels_of
from .map_scales import cell_edges, set_scale
from .map_wording import at_text, axis_label, conditions, notes, shown, title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from xarray import Dataset

    from ..evaluate.maps import MapAnalysis

#: Line styles of the isolines, in rising order of their levels.
_STYLES: tuple[Any, ...] = (":", "-", "--")

#: Characters of a line above a panel.
_TITLE_CHARACTERS = 32


def map_figure(dataset: Dataset, analysis: MapAnalysis) -> bytes:
    """Draw a map: over two axes of numbers as heat maps with isolines, else as curves.

    Parameters
    ----------
    dataset : xarray.Dataset
        The map.
    analysis : MapAnalysis
        Of the same map.

    Returns
    -------
    bytes
        PNG.

    Raises
    ------
    InputError
        If the map has so many axes that more than 12 panels, or more than 8 curves, would be needed.
    """
    layout = map_layout(dataset)
    axes = axes_of(dataset)
    if layout.y is None:
        return png(draw_curves(dataset, analysis, layout, axes))
    panels = panels_of(dataset, layout)
    columns = ceil(sqrt(len(panels)))
    rows = ceil(len(panels) / columns)
    width, height = (9.5, 5.0) if len(panels) == 1 else (2.5 + 3.6 * columns, 1.0 + 3.1 * rows)
    figure = new_figure(width, height, simulated=False)
    figure.set_layout_engine("compressed", w_pad=0.1)  # numbers at the ends of neighbours do not meet
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    for place, (at, section) in zip(grid, panels, strict=False):
        mesh = _draw_panel(place, section["cdp"].values, layout.x, layout.y)
        _draw_isolines(place, analysis, at, layout.x, layout.y, numbered=len(panels) == 1)
        _mark_widest(place, analysis, at, layout.x, layout.y)
        place.set_title("\n".join(wrap(at_text(at, axes), _TITLE_CHARACTERS)))
    for empty in grid[len(panels) :]:
        empty.set_visible(False)
    for number, place in enumerate(grid[: len(panels)]):
        # With axes shared, only those at the rim are labelled; above a hidden panel is the rim, too.
        label(
            place,
            axis_label(layout.x) if number + columns >= len(panels) else "",
            axis_label(layout.y) if number % columns == 0 else "",
            place.get_title(),
        )
        place.tick_params(labelbottom=number + columns >= len(panels))
    _add_bar(figure, mesh, grid[: len(panels)])
    _add_legend(figure, dataset, analysis, axes)
    return png(figure)


def _draw_panel(axes: Axes, values: NDArray[Any], x: MapAxis, y: MapAxis) -> Any:
    axes.set_facecolor("0.85")  # missing values
    mesh = axes.pcolormesh(
        shown(x, cell_edges(x)), shown(y, cell_edges(y)), np.ma.masked_invalid(values), cmap="viridis", vmin=0, vmax=1
    )
    for axis, drawn in ((x, axes.xaxis), (y, axes.yaxis)):
        set_scale(axis, drawn)
    return mesh


def _draw_isolines(axes: Axes, analysis: MapAnalysis, at: At, x: MapAxis, y: MapAxis, numbered: bool) -> None:
    levels = sorted({line.level for line in analysis.isolines})
    for number, level in enumerate(levels):
        lines = [line for line in analysis.isolines if line.at == at and line.level == level]
        for line in lines:
            style = _STYLES[number % len(_STYLES)]
            axes.plot(shown(x, line.x), shown(y, line.y), color="black", linewidth=1.3, linestyle=style)
        if numbered and lines:
            longest = max(lines, key=lambda line: len(line.x))
            # Each level at another part of its line, so that numbers of close lines do not meet.
            place = int(len(longest.x) * (number + 1) / (len(levels) + 1))
            _number_line(axes, shown(x, longest.x)[place], shown(y, longest.y)[place], f"{level:g}")


def _number_line(axes: Axes, x: float, y: float, text: str) -> None:
    from matplotlib.patheffects import withStroke

    axes.text(
        x,
        y,
        text,
        fontsize=SMALL_SIZE,
        horizontalalignment="center",
        verticalalignment="center",
        path_effects=[withStroke(linewidth=3, foreground="white")],
    )


def _mark_widest(axes: Axes, analysis: MapAnalysis, at: At, x: MapAxis, y: MapAxis) -> None:
    """Draw the widest usable range of the map, in the panel and at the height where it is."""
    one = analysis.widest
    if one is None or one.widest is None or any(one.at[name] != value for name, value in at.items()):
        return
    ends = shown(x, [one.widest.low, one.widest.high])
    height = shown(y, [one.at[y.name]] * 2)
    axes.plot(ends, height, color="white", linewidth=4.5, solid_capstyle="butt", clip_on=False)
    axes.plot(ends, height, color=VERMILLION, linewidth=2, marker="|", markersize=11, markeredgewidth=2, clip_on=False)


def _add_bar(figure: Figure, mesh: Any, places: Any) -> None:
    bar = figure.colorbar(mesh, ax=list(places), ticks=np.linspace(0, 1, 6))
    bar.set_label("CDP", fontsize=LABEL_SIZE)
    bar.ax.tick_params(labelsize=SMALL_SIZE)


def _add_legend(figure: Figure, dataset: Dataset, analysis: MapAnalysis, axes: dict[str, MapAxis]) -> None:
    from matplotlib.lines import Line2D

    figure.suptitle(f"{title(dataset)}\n{conditions(dataset)}", fontsize=TITLE_SIZE, parse_math=False)
    levels = sorted({line.level for line in analysis.isolines})
    handles = [
        Line2D([], [], color="black", linewidth=1.3, linestyle=_STYLES[i % len(_STYLES)], label=f"CDP {level:g}")
        for i, level in enumerate(levels)
    ]
    if analysis.widest:
        handles.append(Line2D([], [], color=VERMILLION, linewidth=2, marker="|", label="widest usable range"))
    write_notes(figure, notes(analysis, axes))
    figure.legend(handles=handles, loc="outside right upper", fontsize=SMALL_SIZE, frameon=False)
