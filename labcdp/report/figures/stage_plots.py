"""Plots of the distribution of values after a stage, and of the corresponding luminance."""

from __future__ import annotations

from math import ceil, sqrt
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..digits import decimals, fixed, printable, shortened, significant
from .drawing import BLUE, SMALL_SIZE, TITLE_SIZE, VERMILLION, finish, placed_figure, png

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...metrics import Distribution

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
    figure = placed_figure(10.0, 5.0)
    figure.text(0.01, 0.99, "simulated chain", va="top", fontsize=SMALL_SIZE, color=VERMILLION)
    left = figure.add_axes((0.06, 0.27, 0.45, 0.63))
    panels = (left, figure.add_axes((0.53, 0.27, 0.45, 0.63), sharey=left))
    panels[1].tick_params(labelleft=False)
    for panel, values, text in zip(
        panels, (native, luminance), (printable(native_label), "luminance in cd/m²"), strict=True
    ):
        _draw_distribution(panel, values)
        below = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.16), "frameon": False}
        finish(panel, text, "probability" if values is native else "", "", **below)
        panel.xaxis.label.set_parse_math(False)
    figure.suptitle(shortened(title, 80), fontsize=TITLE_SIZE, parse_math=False)
    return png(figure)


def _draw_distribution(axes: Axes, values: Distribution) -> None:
    edges, density = _bars(values)
    axes.stairs(density / density.max(), edges, fill=True, color="0.6", label="density, scaled to 1")
    cumulative = values.cumulative / values.total
    places = np.concatenate(([edges[0]], values.values, [edges[-1]]))
    axes.step(
        places,
        np.concatenate((cumulative, [1.0])),
        where="post",
        color=BLUE,
        linewidth=1.8,
        label="cumulative probability",
    )
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
