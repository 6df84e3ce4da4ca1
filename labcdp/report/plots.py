"""Plots of distributions: contrasts of pairs of regions, and values after a stage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, isfinite, nan, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import drawing
from .layout import ReportFigure
from .text import cdp_decimals, cdp_interval, decimals, fixed, percent, printable, share_percent, shortened, significant

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..metrics import Cdp, ContrastDistribution, Distribution


#: Least and greatest upper end of the contrast axis as multiples of the interval's upper end, and share of the pairs
#: shown in between: a dark pixel close to 0 makes arbitrarily large contrasts, on whose scale the interval would
#: vanish.
_LEAST_TIMES, _MOST_TIMES, _DRAWN_SHARE = 4, 10, 0.9
#: Share of pairs beyond the axis above which the figure states it.
_STATED_SHARE = 0.001
#: Panels of a figure.
_MOST_PANELS = 6
#: Columns, width and height of panels, and margins around them, at the top for a note and at the bottom for the legend,
#: in inches.
_COLUMNS, _PANEL_IN, _AROUND_IN, _NOTE_IN, _LEGEND_IN = 2, (4.1, 2.3), (0.75, 0.95), 0.25, 0.5
#: Entries of the legend, and height of each further row of them.
_ENTRIES, _LEGEND_ROW_IN = 5, 0.2


@dataclass(frozen=True, eq=False)
class ContrastPanel:
    """Contrasts of one pair of regions with the detected interval.

    Parameters
    ----------
    title : str
        Name of the pair.
    distribution : ContrastDistribution
        The contrasts.
    result : Cdp
        CDP of the same pixels.
    measured : float
        Contrast of the means; nan for none.
    """

    title: str
    distribution: ContrastDistribution
    result: Cdp[float]
    measured: float = nan


def contrast_figures(panels: Sequence[ContrastPanel], simulated: str = "") -> list[ReportFigure]:
    """Draw cumulative probability and density of the contrasts of pairs of regions, six to a figure.

    In the style of the 2018 thesis: a blue line, and grey bars scaled to a maximum of 1.

    Parameters
    ----------
    panels : sequence of ContrastPanel
        The pairs.
    simulated : str
        Simulated part named in the picture: "bench" or "chain"; empty for a measurement.
    """
    groups = [panels[first : first + _MOST_PANELS] for first in range(0, len(panels), _MOST_PANELS)]
    return [
        ReportFigure(
            f"contrasts-{number}.png",
            _draw(group, simulated),
            "Contrasts of all pairs of a bright and a dark pixel. Blue: share of the pairs with at most this contrast; "
            "grey: density scaled to a largest bar of 1; shaded: what counts as detected.",
            f"Distributions of the contrasts of {'; '.join(panel.title for panel in group)}.",
        )
        for number, group in enumerate(groups, start=1)
    ]


def _draw(panels: Sequence[ContrastPanel], simulated: str) -> bytes:
    rows, columns = ceil(len(panels) / _COLUMNS), min(len(panels), _COLUMNS)
    cell = (_PANEL_IN[0] + _AROUND_IN[0], _PANEL_IN[1] + _AROUND_IN[1])
    above = _NOTE_IN if simulated else 0.0
    # Two legend entries fit under one panel.
    ncols = _ENTRIES if columns > 1 else 2
    below = _LEGEND_IN + _LEGEND_ROW_IN * (ceil(_ENTRIES / ncols) - 1)
    width, height = columns * cell[0] + 0.15, above + rows * cell[1] + below
    figure = drawing.placed_figure(width, height, simulated)
    for number, panel in enumerate(panels):
        left = (number % columns) * cell[0] + _AROUND_IN[0] - 0.1
        bottom = height - above - (number // columns + 1) * cell[1] + 0.45
        axes_box = (left / width, bottom / height, _PANEL_IN[0] / width, _PANEL_IN[1] / height)
        _draw_panel(figure.add_axes(axes_box), panel)
    legend = {text: line for axes in figure.axes for line, text in zip(*axes.get_legend_handles_labels(), strict=True)}
    drawing.add_legend(figure, list(legend.values()), list(legend), loc="lower center", ncols=ncols, frameon=False)
    return drawing.png(figure)


def _draw_panel(axes: Axes, panel: ContrastPanel) -> None:
    """Draw the contrasts of a pair and the detected interval."""
    distribution, result = panel.distribution, panel.result
    edges = 100 * distribution.edges
    share = np.diff(distribution.cumulative)
    density = share / share.max() if share.any() else share
    low, high = result.detected_range
    axes.plot(edges, distribution.cumulative, color=drawing.BLUE, linewidth=1.8, label="cumulative probability")
    axes.stairs(density, edges, fill=True, color="0.6", label="density, scaled to 1")
    shaded: dict[str, Any] = {"color": drawing.ORANGE, "alpha": 0.25, "linewidth": 0, "zorder": 0}
    axes.axvspan(100 * low, 100 * high, label="counts as detected", **shaded)
    axes.axvline(100 * result.contrast, color="black", linestyle="--", label="target contrast")
    if isfinite(panel.measured):
        axes.axvline(100 * panel.measured, color=drawing.GREEN, linestyle="-.", label="measured contrast")
    axes.set_ylim(0.0, 1.05)
    start, stop, beyond = _drawn_contrasts(distribution, result)
    axes.set_xlim(100 * start, 100 * stop)
    cdp = fixed(result.cdp, cdp_decimals(result))
    interval = f" (95 %: {cdp_interval(result)})" if isfinite(result.u_pixels) else ""
    target = f"target contrast {percent(result.contrast, 4)}"
    above = f"; {share_percent(beyond)} of the pairs are above" if beyond >= _STATED_SHARE else ""
    title = f"{panel.title}\nCDP {cdp}{interval}; {target}"
    drawing.label(axes, f"Weber contrast in %{above}", "probability", title)
    axes.title.set_fontsize(drawing.SMALL_SIZE)


def _drawn_contrasts(distribution: ContrastDistribution, result: Cdp[float]) -> tuple[float, float, float]:
    """Lowest and highest contrast that are drawn, and the share of pairs above the latter."""
    low, high = result.detected_range
    edges, cumulative = distribution.edges, distribution.cumulative
    bulk = edges[min(int(np.searchsorted(cumulative, _DRAWN_SHARE)), edges.size - 1)]
    wanted = min(max(_LEAST_TIMES * high, bulk), _MOST_TIMES * high)
    # An edge, where the share is known.
    last = min(int(np.searchsorted(edges, wanted)), edges.size - 1)
    margin = 0.1 * (high - low)
    return min(float(edges[0]), low - margin), max(float(edges[last]), high + margin), float(1 - cumulative[last])


#: Most bars for repeating values, number of bins for others, and mean frequency above which values count as repeating.
_MOST_BARS, _N_BINS, _REPEATS = 256, 100, 2


#: Relative difference below which values differ only by rounding and are drawn as one.
_SAME = 1e-12


def stage_figure(title: str, native: Distribution, native_label: str, luminance: Distribution) -> bytes:
    """Draw cumulative probability and density of a stage's values, and the same in cd/m^2 next to them.

    In the style of the 2018 thesis (section 3): a blue line, and grey bars scaled to a maximum of 1.

    Parameters
    ----------
    title : str
        Name of the stage.
    native : Distribution
        Values of a region after the stage.
    native_label : str
        Name of the values, with their unit.
    luminance : Distribution
        The same values as luminance of the scene, in cd/m^2.

    Returns
    -------
    bytes
        PNG.
    """
    figure = drawing.placed_figure(10.0, 5.0)
    figure.text(0.01, 0.99, "simulated chain", va="top", fontsize=drawing.SMALL_SIZE, color=drawing.VERMILLION)
    left = figure.add_axes((0.06, 0.27, 0.45, 0.63))
    panels = (left, figure.add_axes((0.53, 0.27, 0.45, 0.63), sharey=left))
    panels[1].tick_params(labelleft=False)
    for panel, values, text in zip(
        panels, (native, luminance), (printable(native_label), "luminance in cd/m²"), strict=True
    ):
        _draw_distribution(panel, values)
        below = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.16), "frameon": False}
        drawing.finish(panel, text, "probability" if values is native else "", "", **below)
        panel.xaxis.label.set_parse_math(False)
    figure.suptitle(shortened(title, 80), fontsize=drawing.TITLE_SIZE, parse_math=False)
    return drawing.png(figure)


def _draw_distribution(axes: Axes, values: Distribution) -> None:
    edges, density = _bars(values)
    axes.stairs(density / density.max(), edges, fill=True, color="0.6", label="density, scaled to 1")
    cumulative = values.cumulative / values.total
    places = np.concatenate(([edges[0]], values.values, [edges[-1]]))
    how: dict[str, Any] = {"where": "post", "color": drawing.BLUE, "linewidth": 1.8, "label": "cumulative probability"}
    axes.step(places, np.concatenate((cumulative, [1.0])), **how)
    axes.set_ylim(0.0, 1.2)
    margin = 0.03 * (edges[-1] - edges[0])
    axes.set_xlim(edges[0] - margin, edges[-1] + margin)
    axes.plot([], [], linestyle="none", label=_moments(values))


def _moments(values: Distribution) -> str:
    shares = values.weights / values.total
    deviation = sqrt(float(shares @ (values.values - values.mean) ** 2))
    if deviation <= _SAME * abs(values.mean):
        return f"mean {values.mean:.5g}, std 0, SNR (mean/std) ∞"
    n, snr = min(decimals(deviation, 3), 12), values.mean / deviation
    return f"mean {fixed(values.mean, n)}, std {fixed(deviation, n)}, SNR (mean/std) {significant(snr, 3)}"


def _bars(values: Distribution) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Edges of bars and the density of each, shapes (k + 1,) and (k,).

    Repeating values, such as integers, get a bar each, or several share one to keep to 256 bars; bins of equal width
    would hold varying numbers of them. Others get 100 equal bins.
    """
    x, shares = values.values, values.weights / values.total
    span = float(x[-1] - x[0])
    if span <= _SAME * abs(float(x[0])):
        half = 0.05 * abs(float(x[0])) or 0.5
        return x[0] + half * np.array([-4.0, -1.0, 1.0, 4.0]), np.array([0.0, 0.5 / half, 0.0])
    if values.size is not None and values.size < _REPEATS * x.size:
        edges = np.linspace(x[0], x[-1], _N_BINS + 1)
        return edges, np.histogram(x, edges, weights=shares)[0] / np.diff(edges)
    # Between the midpoints to the neighbours, but at most a fortieth of the span to each side.
    halves = np.minimum(np.diff(x) / 2, span / 40)
    lows, highs = x - np.append(halves[0], halves), x + np.append(halves, halves[-1])
    starts = np.arange(0, x.size, ceil(x.size / _MOST_BARS))
    lows, highs = lows[starts], np.append(highs[starts[1:] - 1], highs[-1])
    density = np.add.reduceat(shares, starts) / (highs - lows)
    # An empty bar, mostly of zero width, between two bars.
    edges = np.column_stack((lows, np.maximum(lows, highs))).ravel()
    edges[2::2] = np.maximum(edges[2::2], edges[1:-1:2])  # keep them non-decreasing despite rounding
    return edges, np.insert(density, np.arange(1, density.size), 0.0)
