"""Figures of a chart: the matrix to point at, and figures of merit over luminance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...core.result import Result
from ...report import drawing
from ...report.html import interactive
from ...report.layout import Card, ReportFigure, Script, Section
from ...report.text import bounded, shortened, significant
from .measure import MeasuredChart

if TYPE_CHECKING:
    from bokeh import plotting

_Array = NDArray[np.float64]

#: Pictures that are named in a figure, and length at which their names are cut.
_MOST_NAMED, _LONGEST_NAME = 10, 30
#: Pixels of a cell of the matrix, and smallest and largest side of it.
_CELL_PX, _LEAST_PX, _MOST_PX = 18, 300, 760


def matrix_figure(chart: MeasuredChart) -> Script:
    """Return all patches against all in colours by their CDP, with values and interval where the pointer is."""
    matrix = chart.matrix if "contrast" not in chart.matrix["cdp"].dims else chart.matrix.isel(contrast=0)
    order = np.argsort(-np.nan_to_num([region.mean for region in chart.regions]), kind="stable")
    at = np.ix_(order, order)
    values = {key: matrix[key].values[at] for key in ("cdp", "cdp_low", "cdp_high", "cnr")}
    values["target"] = 100 * np.broadcast_to(matrix["contrast"].values, matrix["cdp"].shape)[at]
    values["measured"] = 100 * matrix["measured_contrast"].values[at]
    shown = [
        ("CDP", "@cdp{0.000} (95 %: @cdp_low{0.000} to @cdp_high{0.000})"), ("target contrast", "@target{0.0} %"),
        ("measured contrast", "@measured{0.0} %"), ("CNR", "@cnr{0.0}"),
    ]  # fmt: skip
    return interactive(_map([str(name) for name in matrix["bright"].values[order]], values, "cdp", "CDP", shown))


def matrix_maps(names: Sequence[str], values: Mapping[str, _Array], contrast: _Array) -> Script:
    """Return all patches against all in colours by the mean and by the lowest CDP of the frames of a video.

    Parameters
    ----------
    names : sequence of str
        The patches, the brightest first.
    values : mapping of str to ndarray of float, shape (n, n)
        As of `labcdp.evaluate.chart_video.over_frames.PAIR_COLUMNS`.
    contrast : ndarray of float, shape (n, n)
        Contrasts to be detected.
    """
    from bokeh.layouts import column

    shown = [
        ("mean CDP", "@mean_cdp{0.000}, standard deviation @std_cdp{0.000}"),
        ("lowest CDP", "@lowest_cdp{0.000} (95 %: @lowest_cdp_low{0.000} to @lowest_cdp_high{0.000})"),
        ("in frame", "@lowest_frame{0}"), ("frames that detect", "@detected{0.0} % of @n_frames{0}"),
        ("target contrast", "@target{0.0} %"),
    ]  # fmt: skip
    values = {**values, "target": 100 * contrast, "detected": 100 * values["detected_share"]}
    maps = (("mean_cdp", "mean CDP"), ("lowest_cdp", "lowest CDP"))
    plots = [_map(names, values, name, label, shown) for name, label in maps]
    return interactive(column(*plots, sizing_mode="scale_width"))


def _map(
    names: Sequence[str], values: Mapping[str, _Array], coloured: str, label: str, shown: Sequence[tuple[str, str]]
) -> plotting.figure:
    """Return all patches against all in colours by one of the values, with those shown where the pointer is."""
    from bokeh.models import BasicTicker, ColorBar, ColumnDataSource, LinearColorMapper
    from bokeh.palettes import Viridis256
    from bokeh.plotting import figure

    bright, dark = np.triu_indices(len(names), 1)
    source = ColumnDataSource({
        "bright": [names[i] for i in bright.tolist()], "dark": [names[i] for i in dark.tolist()],
        **{key: matrix[bright, dark] for key, matrix in values.items()},
    })  # fmt: skip
    colours = LinearColorMapper(palette=Viridis256, low=0, high=1, nan_color="#e8e8e8")
    side = min(max(_CELL_PX * len(names), _LEAST_PX), _MOST_PX)
    plot = figure(
        x_range=list(names), y_range=list(names)[::-1], width=side + 110, height=side + 90,
        sizing_mode="scale_width", max_width=side + 110, tools="hover,reset", toolbar_location=None,
        x_axis_location="below", tooltips=[("bright / dark", "@bright / @dark"), *shown],
        x_axis_label="bright patch", y_axis_label="dark patch",
    )  # fmt: skip
    fill = {"field": coloured, "transform": colours}
    plot.rect("bright", "dark", 1, 1, source=source, line_color=None, fill_color=fill)
    plot.xaxis.major_label_orientation = 1.57
    plot.axis.major_label_text_font_size = "9px"
    plot.grid.grid_line_color = None
    plot.add_layout(ColorBar(color_mapper=colours, ticker=BasicTicker(), title=label, width=12), "right")
    return plot


def luminance_figure(charts: Sequence[tuple[str, MeasuredChart]]) -> ReportFigure:
    """Draw SNR of the patches, and CDP of patches next to each other, over luminance; of several pictures overlaid."""
    figure = drawing.new_figure(6.6, 5.6)
    above, below = figure.subplots(2, sharex=True)
    for name, chart in charts:
        levels = chart.luminance
        shown = np.flatnonzero(levels > 0)
        shown = shown[np.argsort(levels[shown])]
        snr = np.array([region.snr.value for region in chart.regions])
        label = shortened(Path(name).name, _LONGEST_NAME) if 1 < len(charts) <= _MOST_NAMED else None
        above.plot(levels[shown], snr[shown], ".-", label=label)
        matrix = chart.matrix if "contrast" not in chart.matrix["cdp"].dims else chart.matrix.isel(contrast=0)
        dark, bright = shown[:-1], shown[1:]
        below.plot(levels[dark], matrix["cdp"].values[bright, dark], ".-", label=label)
        for at in shown:
            if chart.saturated[at]:
                above.axvline(levels[at], color=drawing.VERMILLION, linewidth=0.6)
    drawing.logarithmic(above.xaxis, above.yaxis)
    drawing.logarithmic(below.xaxis)
    unit = charts[0][1].unit
    drawing.finish(above, "", "SNR", "Signal-to-noise ratio of the patches")
    where = "relative luminance" if unit == "relative" else f"luminance in {unit}"
    drawing.finish(below, where, "CDP", "CDP of patches next to each other, at the darker one")
    below.set_ylim(-0.03, 1.03)
    return drawing.reported(
        "chart", figure, "SNR of each patch and CDP of patches next to each other over luminance; red lines: saturated."
    )


def range_cards(chart: MeasuredChart) -> list[Card]:
    """Make a card for each dynamic range that the picture has."""
    cards = []
    unit = "" if chart.unit == "relative" else f" {chart.unit}"
    for chart_range in chart.ranges:
        ends = chart_range.range
        if not ends.stops > 0:
            continue
        lines = (
            f"{significant(ends.low)} to {significant(ends.high)}{unit}",
            f"{significant(ends.decibels)} dB, {significant(ends.ratio)} : 1",
        )
        value = bounded(ends.stops, ends.bound, "stops") if ends.bound else f"{ends.stops:.2f} stops"
        detail = "the chart ends first" if ends.bound else f"95 %: ± {1.96 * ends.u_stops:.2f} stops"
        cards.append(Card(f"Dynamic range, {chart_range.name} ≥ {ends.limit:g}", value, detail, lines))
    return cards


def chart_section(name: str, chart: MeasuredChart, result: Result) -> Section:
    """Return the section of a page with the figures and patches of one chart."""
    return Section("Chart", [luminance_figure([(name, chart)]), matrix_figure(chart), *result.tables_named("chart")])
