"""The plots of the live page: CDP over time and over the contrast, and the histogram."""

from __future__ import annotations

from math import inf
from time import monotonic
from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource, Range1d, Span
from bokeh.plotting import figure

from .live_bench import LiveBench
from .pair import TRACE_S

_BLUE, _RED = "#0072b2", "#d55e00"
#: Bins of the histogram, and pixels of which it is made.
_N_BINS, _SAMPLE = 128, 200_000
#: Seconds between two plots, and points of the trace in one: more slow the images down.
_PLOT_S, _MOST_POINTS = 0.5, 400


class Plots:
    """The plots of one tab.

    Parameters
    ----------
    bench : LiveBench
        What they show.
    """

    def __init__(self, bench: LiveBench) -> None:
        self._trace = ColumnDataSource(data={"t": [], "cdp": [], "low": [], "high": []})
        self._curve = ColumnDataSource(data={"contrast": [], "cdp": []})
        self._histogram = ColumnDataSource(data={"dn": [], "n": []})
        self._measured = Span(location=None, dimension="height", line_color=_RED, line_width=2)
        self._contrasts = Range1d(1, 10_000)
        self._dn = Range1d(0, bench.images.highest_dn)
        self._levels = tuple(Span(dimension="height", line_dash="dashed", line_color=one) for one in (_BLUE, _RED))
        self._plotted_s = 0.0
        limit = bench.target.limit
        self.figures = (self._trace_figure(limit), self._curve_figure(limit), self._histogram_figure())

    def update(self, bench: LiveBench) -> bool:
        """Refresh the plots, not more often than twice a second; returns whether it did."""
        now_s = monotonic()
        if now_s - self._plotted_s < _PLOT_S:
            return False
        self._plotted_s = now_s
        points = bench.trace.points
        points = points[:: 1 + len(points) // _MOST_POINTS]
        self._trace.data = {
            "t": [one.time_s - now_s for one in points],
            **{name: [getattr(one, name) for one in points] for name in ("cdp", "low", "high")},
        }
        contrasts, values = bench.curve
        self._curve.data = {"contrast": 100 * contrasts, "cdp": values}
        if contrasts.size:
            self._contrasts.update(start=100 * contrasts[0], end=100 * contrasts[-1])
        measured = 0.0 if bench.pair is None else 100 * bench.pair.contrast.value
        self._measured.location = measured if 0 < measured < inf else None
        # The line of the saturation, which is at the end, is seen as a whole.
        self._dn.end = 1.01 * bench.images.highest_dn
        self._levels[0].location = bench.images.black_dn
        self._levels[1].location = bench.workspace.image.saturation_dn
        self._histogram.data = _histogram(bench.workspace.image.values, bench.images.highest_dn)
        return True

    def _trace_figure(self, limit: float) -> Any:
        plot = _figure(120, y_range=Range1d(-0.02, 1.02), x_range=Range1d(-TRACE_S, 0))
        plot.yaxis.axis_label, plot.xaxis.axis_label = "CDP", "time in s"
        plot.varea("t", "low", "high", source=self._trace, fill_alpha=0.3, fill_color=_BLUE)
        plot.line("t", "cdp", source=self._trace, line_color=_BLUE, line_width=2)
        plot.add_layout(Span(location=limit, dimension="width", line_dash="dotted"))
        return plot

    def _curve_figure(self, limit: float) -> Any:
        plot = _figure(120, y_range=Range1d(-0.02, 1.02), x_range=self._contrasts, x_axis_type="log")
        plot.yaxis.axis_label, plot.xaxis.axis_label = "CDP", "contrast to detect in % (line: measured)"
        plot.line("contrast", "cdp", source=self._curve, line_color=_BLUE, line_width=2)
        for mark in (self._measured, Span(location=limit, dimension="width", line_dash="dotted")):
            plot.add_layout(mark)
        return plot

    def _histogram_figure(self) -> Any:
        plot = _figure(110, x_range=self._dn, y_axis_type="log")
        plot.y_range.start = 0.5
        plot.yaxis.ticker.desired_num_ticks = 3
        plot.xaxis.axis_label, plot.yaxis.axis_label = "DN (lines: black level, saturation)", "pixels"
        for mark in self._levels:
            plot.add_layout(mark)
        plot.step("dn", "n", source=self._histogram, mode="after", line_color="#555555")
        return plot


def _figure(height: int, **options: Any) -> Any:
    plot = figure(sizing_mode="stretch_width", height=height, toolbar_location=None, tools="", **options)
    # So close together that they would look like a bar.
    plot.yaxis.minor_tick_line_color = None
    return plot


def _histogram(values: Any, highest: float) -> dict[str, Any]:
    step = max(1, round((values.size / _SAMPLE) ** 0.5))
    counts, edges = np.histogram(values[::step, ::step], bins=_N_BINS, range=(0, highest + 1))
    # Empty bins are below the axis, which is logarithmic.
    return {"dn": edges[:-1], "n": np.maximum(counts, 0.1)}
