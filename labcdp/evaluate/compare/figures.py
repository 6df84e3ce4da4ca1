"""Figures of comparisons: values with their intervals, overlaid curves, and maps with their difference."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...report.digits import printable
from ...report.figures.drawing import SMALL_SIZE, finish, label, new_figure, png
from ..sweep.maps.axes import MapAxis
from ..sweep.report.labels import at_text, axis_label, shown
from ..sweep.report.static import set_scale
from ..sweep.report.view import COLOURS, MISSING, SCALE, cell_edges
from .compare import Comparison
from .grid import Grid

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Most rows of values, and columns of maps, in a figure.
_MOST_ROWS, _MOST_COLUMNS = 30, 3


def comparison_figure(found: Comparison) -> bytes | None:
    """Draw a comparison as PNG; None if its axis has no numbers."""
    grid, names = found.grid, [printable(subject.name) for subject in found.subjects]
    if grid is None:
        return _values(found, names)
    if not grid.axes[-1].numeric:
        return None
    return _maps(grid, names) if grid.spanned == 2 else _curves(grid, names, found)


def _values(found: Comparison, names: Sequence[str]) -> bytes:
    """Draw CDPs with their intervals, or z of all differences where there is no CDP."""
    quantities = list(dict.fromkeys(row.first.quantity for row in found.rows))[:_MOST_ROWS]
    cdps = [name for name in quantities if any(r.first.probability for r in found.rows if r.first.quantity == name)]
    drawn = cdps or quantities
    figure = new_figure(7.5, 1.0 + (0.34 if len(drawn) < 12 else 0.2) * len(drawn))
    axes = figure.add_subplot()
    step = 0.5 / len(names)
    for number, name in enumerate(names):
        rows = [row for row in found.rows if number == 0 or row.name == found.subjects[number].name]
        places, values, sides = [], [], []
        for row in rows:
            if row.first.quantity not in drawn or (number == 0 and not cdps):
                continue
            one = row.first.value if number == 0 else row.other.value
            places.append(drawn.index(row.first.quantity) + step * (number - (len(names) - 1) / 2))
            values.append(float(one.value) if cdps else float(row.difference.z))  # type: ignore[arg-type]
            sides.append([float(np.nan_to_num(side)) for side in (one.below, one.above)])
        if places:
            style: dict[str, Any] = {"fmt": "o", "markersize": 4, "capsize": 3, "color": COLOURS[number % len(COLOURS)]}
            axes.errorbar(values, places, xerr=np.transpose(sides) if cdps else None, label=name, **style)
    axes.set_yticks(range(len(drawn)), [printable(name) for name in drawn], parse_math=False)
    axes.set_ylim(len(drawn) - 0.5, -0.5)
    # Values close to 1 have many digits.
    axes.locator_params(axis="x", nbins=4)
    if not cdps:
        axes.axvspan(-1.96, 1.96, color="0.88", linewidth=0, zorder=0, label="not significant")
    text = "CDP with 95 % interval" if cdps else f"z: difference from {names[0]} over its standard uncertainty"
    finish(axes, text, "", "", loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False)
    return png(figure)


def _curves(grid: Grid, names: Sequence[str], found: Comparison) -> bytes:
    """Draw overlaid curves, and below them the differences from the first with their intervals."""
    axis, sections = grid.axes[-1], _sections(grid)
    several = len(sections) > 1
    figure = new_figure(7.5, 3.4 if grid.relative else 5.0)
    panels = figure.subplots(1 if grid.relative else 2, 1, sharex=True, squeeze=False)[:, 0]
    for number, name in enumerate(names):
        for place, (at, index) in enumerate(sections):
            colour = COLOURS[(place if several else number) % len(COLOURS)]
            style: dict[str, Any] = {"color": colour, "linestyle": ("-", "--", ":", "-.")[number % 4 if several else 0]}
            text = f"{name}, {at}" if several else name
            if not grid.relative:
                one = grid.values[number]
                value, below, above = (
                    np.broadcast_to(v, np.shape(one.value))[index] for v in (one.value, one.below, one.above)
                )
                _draw(panels[0], axis, value, value - below, value + above, text, style)
            if number:
                of, factor = grid.differences[number - 1], 100 if grid.relative else 1
                middle, low, high = (factor * v[index] for v in (of.value, of.low, of.high))
                _draw(panels[-1], axis, middle, low, high, text, style)
    panels[-1].axhline(0.0, color="0.4", linewidth=1)
    if not grid.relative:
        panels[0].axhline(found.analyses[0].level, color="0.4", linewidth=1, linestyle=":")
        panels[0].set_ylim(-0.03, 1.05)
        finish(panels[0], "", grid.quantity, "", loc="upper left", bbox_to_anchor=(1.01, 1.02), frameon=False)
    ratio = (
        f"{grid.quantity} from that\nof {names[0]} in %"
        if grid.relative
        else f"difference of {grid.quantity}\nfrom {names[0]}"
    )
    set_scale(axis, panels[-1].xaxis)
    legend = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.02), "frameon": False} if grid.relative else None
    if legend:
        finish(panels[-1], axis_label(axis), ratio, "", **legend)
    else:
        label(panels[-1], axis_label(axis), ratio, "")
        panels[-1].grid(color="0.9")
    figure.align_ylabels()
    return png(figure)


def _draw(
    panel: Axes,
    axis: MapAxis,
    value: ArrayLike,
    low: NDArray[Any],
    high: NDArray[Any],
    text: str,
    style: dict[str, Any],
) -> None:
    places = shown(axis, axis.values)
    panel.plot(places, value, label=text, **style)
    if np.any(low < high):
        panel.fill_between(places, low, high, color=style["color"], alpha=0.2, linewidth=0)


def _sections(grid: Grid) -> list[tuple[str, tuple[int, ...]]]:
    """Name and place of the curves of each subject, at the values of the other axes; as many as there are colours."""
    axes = {axis.name: axis for axis in grid.axes}
    found = [
        (at_text({a.name: a.values[i].item() for a, i in zip(grid.axes[:-1], place, strict=True)}, axes), place)
        for place in np.ndindex(*(axis.values.size for axis in grid.axes[:-1]))
    ]
    return found[: len(COLOURS)]


def _maps(grid: Grid, names: Sequence[str]) -> bytes:
    """Draw the map of each subject, then the differences from the first; of further axes at their first values."""
    *_, y, x = grid.axes
    index = tuple(0 for _ in grid.axes[:-2])
    at = at_text({axis.name: axis.values[0].item() for axis in grid.axes[:-2]}, {axis.name: axis for axis in grid.axes})
    limit = max(float(np.nanmax(np.abs(one.value[index]), initial=0.0)) for one in grid.differences) or 1.0
    maps: list[tuple[str, Any, dict[str, Any]]] = [
        (name, np.asarray(one.value)[index], {"cmap": SCALE, "vmin": 0, "vmax": 1})
        for name, one in zip(names, grid.values, strict=True)
    ]
    maps += [
        (f"{name} minus {names[0]}", one.value[index], {"cmap": "RdBu", "vmin": -limit, "vmax": limit})
        for name, one in zip(names[1:], grid.differences, strict=True)
    ]
    columns = min(len(maps), _MOST_COLUMNS)
    rows = ceil(len(maps) / columns)
    figure = new_figure(1.0 + 3.7 * columns, 0.5 + 3.0 * rows)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    edges = shown(x, cell_edges(x)), shown(y, cell_edges(y))
    for number, (panel, (name, values, how)) in enumerate(zip(panels, maps, strict=False)):
        panel.set_facecolor(MISSING)
        mesh = panel.pcolormesh(*edges, np.ma.masked_invalid(values), **how)
        set_scale(x, panel.xaxis)
        set_scale(y, panel.yaxis)
        label(panel, axis_label(x), "" if number % columns else axis_label(y), f"{name}\n{at}".rstrip())
        figure.colorbar(mesh, ax=panel).ax.tick_params(labelsize=SMALL_SIZE)
    for empty in panels[len(maps) :]:
        empty.set_visible(False)
    return png(figure)
