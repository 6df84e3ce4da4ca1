"""A map of CDP as an interactive figure: all variables of a cell under the pointer, lines to switch on and off."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import nan
from typing import TYPE_CHECKING, Any

import numpy as np
from bokeh.layouts import column as stacked
from bokeh.layouts import gridplot
from bokeh.models import (
    BasicTicker,
    BoxAnnotation,
    ColorBar,
    CustomJS,
    GlyphRenderer,
    HoverTool,
    LayoutDOM,
    Legend,
    LegendItem,
    LinearColorMapper,
    LogTicker,
    PlainText,
    PrintfTickFormatter,
    Select,
    Span,
)
from bokeh.palettes import Viridis256
from bokeh.plotting import figure

from ....report.html import interactive
from ....report.layout import Script
from .axes import At, MapAxis, known_values
from .labels import axis_label, shown, variable_column
from .view import MISSING, USABLE, WIDEST, DrawnCurve, MapView, cell_edges

if TYPE_CHECKING:
    from xarray import Dataset

#: Dashes of the isolines, in rising order of their levels.
_DASHES = ("dotted", "solid", "dashed")

#: Digits of each decade that have a tick where a logarithmic axis shows few of them.
_TICKS = (1, 2, 5)

#: Heights of a heat map, of the curves of CDP and of those of SNR, in pixels.
_MAP, _CDP, _SNR = 520, 400, 240

#: Ends of the axis of CDP.
_CDP_ENDS = (-0.03, 1.05)

#: Longest texts of a legend in two columns.
_NARROW = 24


def map_script(view: MapView) -> Script:
    """Draw a map; over two axes of numbers as heat maps, else as curves."""
    return interactive(_heat_maps(view) if view.map.y is not None else _curves(view))


def _heat_maps(view: MapView) -> LayoutDOM:
    """Draw one heat map for each section, of which one is shown at a time."""
    x, y = view.map.x, view.map.y
    assert y is not None
    plot = _figure(x, axis_label(x), _MAP, y, axis_label(y), tools="pan,wheel_zoom,box_zoom,reset,save")
    plot.background_fill_color = MISSING
    plot.grid.visible = False
    colours = LinearColorMapper(palette=Viridis256, low=0, high=1)
    parts: list[list[GlyphRenderer]] = []
    items: list[list[LegendItem]] = []
    for at, section in view.parts:
        cells = _cells(plot, view, section, colours)
        lines = list(_overlays(plot, view, at))
        parts.append([cells, *(line for _, line in lines)])
        items.append([LegendItem(label={"value": text}, renderers=[line]) for text, line in lines])
    scale = ColorBar(color_mapper=colours, title="CDP", ticker=BasicTicker(desired_num_ticks=6))
    scale.title_text_font_style = "normal"
    plot.add_layout(scale, "right")
    _add_legend(plot, [item for legend_items in items for item in legend_items])
    if len(parts) == 1:
        return plot
    for number, (renderers, legend_items) in enumerate(zip(parts, items, strict=True)):
        for model in (*renderers, *legend_items):
            model.visible = number == 0
    options = [(f"{number}", view.text_of(at)) for number, (at, _) in enumerate(view.parts)]
    shown_part = Select(options=options, value="0", title="Shown", sizing_mode="stretch_width", max_width=600)
    groups = [[*renderers, *legend_items] for renderers, legend_items in zip(parts, items, strict=True)]
    code = "groups.forEach((models, i) => models.forEach((model) => (model.visible = `${i}` === cb_obj.value)))"
    shown_part.js_on_change("value", CustomJS(args={"groups": groups}, code=code))
    return stacked([shown_part, plot], sizing_mode="stretch_width")


def _cells(plot: Any, view: MapView, section: Dataset, colours: LinearColorMapper) -> GlyphRenderer:
    """Draw the cells that have a CDP, and give the values of all variables under the pointer."""
    x, y = view.map.x, view.map.y
    assert y is not None
    up, across = np.meshgrid(shown(y, y.values), shown(x, x.values), indexing="ij")
    (bottom, left), (top, right) = (
        np.meshgrid(cell_edges(y)[ends], cell_edges(x)[ends], indexing="ij") for ends in (slice(-1), slice(1, None))
    )
    texts, values = _variables(section)
    cdp = section["cdp"].values
    known = np.isfinite(cdp)
    columns = {"left": left, "right": right, "bottom": bottom, "top": top, "cdp": cdp, "x": across, "y": up}
    columns |= {f"v{number}": value for number, value in enumerate(values)}
    data = {name: np.asarray(values, dtype=float)[known] for name, values in columns.items()}
    colour = {"field": "cdp", "transform": colours}
    # With lines of the same colour there are no seams between cells.
    cells = plot.quad(left="left", right="right", bottom="bottom", top="top", source=data, color=colour, line_width=1)
    _add_hover(plot, [cells], [(axis_label(x), "x"), (axis_label(y), "y"), *texts])
    return cells


def _overlays(plot: Any, view: MapView, at: At) -> Iterator[tuple[str, GlyphRenderer]]:
    """Yield the lines over a section with their texts; isolines of one level are one, which the legend switches."""
    for text, number, lines in view.overlays(at):
        how: dict[str, Any] = {"line_color": WIDEST, "line_width": 4}
        if number is not None:
            how = {"line_color": "black", "line_width": 1.5, "line_dash": _DASHES[number % len(_DASHES)]}
        yield text, plot.multi_line(xs=[x for x, _ in lines], ys=[y for _, y in lines], **how)


def _curves(view: MapView) -> LayoutDOM:
    """Draw CDP along the axis, and below it the SNR of the map."""
    cdp, snr = view.curves()
    axis, level = view.map.x, view.analysis.level
    tools = "pan,wheel_zoom,box_zoom,reset,save"
    above = _figure(axis, "" if snr else axis_label(axis), _CDP, None, "CDP", tools=tools, y_range=_CDP_ENDS)
    for ends in view.usable:
        above.add_layout(BoxAnnotation(left=ends[0], right=ends[1], fill_color=USABLE, fill_alpha=0.15, line_width=0))
    above.add_layout(Span(location=level, dimension="width", line_color="grey", line_dash="dotted"))
    drawn = _draw_lines(above, view, cdp)
    # Without a place: the legend shows how they are drawn.
    grey = above.line(x=[nan], y=[nan], line_color="grey", line_dash="dotted")
    items = [*_items(drawn), LegendItem(label={"value": f"CDP {level:g}"}, renderers=[grey])]
    if view.usable:
        area = above.quad(left=[nan], right=[nan], top=[nan], bottom=[nan], fill_color=USABLE, fill_alpha=0.3)
        items.append(LegendItem(label={"value": "usable range"}, renderers=[area]))
    if not snr:
        _add_legend(above, items)
        return above
    below = _figure(axis, axis_label(axis), _SNR, None, "SNR in dB (20 lg)", tools=tools, x_range=above.x_range)
    snr_renderers = _draw_lines(below, view, snr)
    _add_legend(above, items)
    # Only what the curves of CDP do not have already; those are switched with them.
    _add_legend(below, [item for item in _items(snr_renderers) if item.label["value"] not in drawn])
    for text, renderers in snr_renderers.items():
        for model in renderers:
            if text in drawn:
                drawn[text][0].js_link("visible", model, "visible")
    return gridplot([[above], [below]], sizing_mode="stretch_width", merge_tools=True, toolbar_location="below")


def _draw_lines(plot: Any, view: MapView, lines: Sequence[DrawnCurve]) -> dict[str, list[GlyphRenderer]]:
    """Draw curves with their bands and dips; return what belongs to each text of the legend."""
    axis, drawn = view.map.x, dict[str, list[GlyphRenderer]]()
    places = shown(axis, axis.values) if axis.numeric else _factors(axis)
    for line in lines:
        texts, values = _variables(line.section)
        data = {"x": places, "y": line.values} | {f"v{number}": value for number, value in enumerate(values)}
        curve = plot.line(x="x", y="y", source=data, line_color=line.colour, line_width=2)
        marks = plot.scatter(x="x", y="y", source=curve.data_source, size=6 if view.marked else 2, color=line.colour)
        _add_hover(plot, [marks], [(axis_label(axis), "x"), *texts], numeric=axis.numeric)
        drawn.setdefault(line.text, []).extend((curve, marks))
        if line.band is not None:
            low, high = line.band
            band = plot.varea(x=places, y1=low, y2=high, fill_color=line.colour, fill_alpha=0.2, level="underlay")
            drawn.setdefault("95 % intervals" if len(lines) == 1 else line.text, []).append(band)
        if line.dips[0].size:
            rings = plot.scatter(*line.dips, size=14, marker="circle", fill_color=None, line_color="black")
            drawn.setdefault("dip", []).append(rings)
    return drawn


def _items(drawn: dict[str, list[GlyphRenderer]]) -> list[LegendItem]:
    return [LegendItem(label={"value": text}, renderers=renderers) for text, renderers in drawn.items()]


def _add_legend(plot: Any, items: Sequence[LegendItem]) -> None:
    """Put a legend above the figure, so that it is on the first screen; a click hides or shows."""
    if items:
        n_columns = 2 if all(len(item.label["value"]) <= _NARROW for item in items) else 1
        legend = Legend(items=list(items), click_policy="hide", ncols=n_columns, location="left")
        legend.update(border_line_color=None, padding=2, label_text_font_size="13px")
        plot.add_layout(legend, "above")


def _figure(x: MapAxis, x_label: str, height: int, y: MapAxis | None, y_label: str, **how: Any) -> Any:
    """Return a figure over an axis, with the ends and the kind of scale of its axes."""
    how.setdefault("x_range", _ends(x))
    if y is not None:
        how["y_range"] = _ends(y)
    kinds = {name: "log" if axis is not None and axis.log else "auto" for name, axis in (("x", x), ("y", y))}
    plot = figure(
        height=height,
        sizing_mode="stretch_width",
        x_axis_type=kinds["x"],
        y_axis_type=kinds["y"],
        # Over a page that is scrolled, the wheel zooms only when it is told to.
        active_scroll=None,
        toolbar_location="below",
        **how,
    )
    plot.toolbar.logo = None
    for axis, drawn, label in ((x, plot.xaxis, x_label), (y, plot.yaxis, y_label)):
        drawn.axis_label = PlainText(text=label) if label else None
        drawn.axis_label_text_font_style = "normal"
        if axis is not None and axis.numeric:
            drawn.formatter = PrintfTickFormatter(format="%.6g")
            if axis.log:
                drawn.ticker = LogTicker(mantissas=list(_TICKS))
    return plot


def _ends(axis: MapAxis) -> Any:
    """Return the ends of an axis, or its texts."""
    return tuple(cell_edges(axis)[[0, -1]].tolist()) if axis.numeric else _factors(axis)


def _factors(axis: MapAxis) -> list[str]:
    return [str(value) for value in axis.values]


def _variables(section: Dataset) -> tuple[list[tuple[str, str]], list[Any]]:
    """Return text and column of each variable, and its values; an SNR without noise is not a number."""
    texts, values = [], []
    for number, name in enumerate(map(str, section.data_vars)):
        column = variable_column(section, name)
        texts.append((f"{column.label}{column.unit and f' in {column.unit}'}", f"v{number}"))
        values.append((100 if column.unit == "%" else 1) * known_values(name, section[name].values))
    return texts, values


def _add_hover(
    plot: Any, renderers: list[GlyphRenderer], texts: Sequence[tuple[str, str]], numeric: bool = True
) -> None:
    """Show values of the cell or point under the pointer."""
    rows = [(text, f"@{name}{{%.4g}}" if numeric or name != "x" else f"@{name}") for text, name in texts]
    formatters = {f"@{name}": "printf" for _, name in texts if numeric or name != "x"}
    plot.add_tools(HoverTool(renderers=renderers, tooltips=rows, formatters=formatters, visible=False))
