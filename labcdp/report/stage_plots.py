"""Plots of a simulated chain: what a stage makes of the signal, and CDP and SNR from stage to stage."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, sqrt
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..evaluate.map_snr import LARGEST_SNR
from .digits import decimals, fixed, printable, shortened, significant
from .drawing import (
    BLUE,
    GREEN,
    SMALL_SIZE,
    TITLE_SIZE,
    VERMILLION,
    label,
    new_figure,
    plain_numbers,
    png,
    taken_literally,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..contrast import Distribution

#: Most bars of values that repeat, bins of those that do not, and how often a value of the former occurs on average.
_MOST_BARS, _N_BINS, _REPEATS = 256, 100, 2


#: Values that differ by less, relatively, differ by rounding, and are drawn as one.
_SAME = 1e-12


def stage_figure(
    title: str,
    native: Distribution,
    native_label: str,
    luminance: Distribution,
    simulated: bool = True,
    luminance_label: str = "luminance in cd/m²",
) -> bytes:
    """Draw cumulative probability and density of a stage's values, and beside them the same in cd/m^2.

    As the 2018 thesis draws them (section 3): a blue line, and grey bars scaled to a largest one of 1.

    Parameters
    ----------
    title : str
        Name of the stage.
    native : Distribution
        Values of a region after the stage.
    native_label : str
        What they are, with their unit.
    luminance : Distribution
        The same values as luminance of the scene, in cd/m^2.
    simulated : bool
        Whether the picture says that the chain is simulated.
    luminance_label : str
        What stands below the luminance, for pictures without a scale.

    Returns
    -------
    bytes
        PNG.
    """
    figure = _figure(10.0, 4.6, simulated)
    panels = figure.subplots(1, 2, sharey=True)
    for panel, values, text in zip(
        panels, (native, luminance), (printable(native_label), luminance_label), strict=True
    ):
        _draw_distribution(panel, values)
        label(panel, text, "probability" if values is native else "", "")
        panel.xaxis.label.set_parse_math(False)
    figure.suptitle(shortened(title, 80), fontsize=TITLE_SIZE, parse_math=False)
    return png(figure)


def chain_figure(
    stage_names: Sequence[str],
    cdp: Sequence[float],
    cdp_interval: Sequence[tuple[float, float]],
    snr_ratio: Sequence[float],
    snr_db: Sequence[float],
    luminance_snr_ratio: Sequence[float],
    simulated: bool = True,
) -> bytes:
    """Draw CDP with its 95 % intervals, and SNR, from stage to stage.

    Parameters
    ----------
    stage_names : sequence of str, length n
        In the order of the chain.
    cdp : sequence of float, length n
        CDP after each stage; nan is left out.
    cdp_interval : sequence of (float, float), length n
        95 % intervals; (nan, nan) where there is none.
    snr_ratio, snr_db : sequence of float, length n
        Mean over standard deviation of the values a stage hands on, and the same in dB, written beside the points.
        Infinity, and what is above 1e6, is drawn above all else, with an arrow; nan and what is not above 0 is left
        out.
    luminance_snr_ratio : sequence of float, length n
        The same of the luminance in cd/m^2 that the values stand for, which gains nothing from glare or black level.
    simulated : bool
        Whether the picture says that the chain is simulated.

    Returns
    -------
    bytes
        PNG.

    Raises
    ------
    InputError
        If the lengths differ or are 0.
    """
    lengths = [len(values) for values in (stage_names, cdp, cdp_interval, snr_ratio, snr_db, luminance_snr_ratio)]
    if len(set(lengths)) != 1 or not lengths[0]:
        raise InputError(f"the chain's lists have lengths {lengths}: give one value of each for each stage")
    figure = _figure(max(6.0, 2.0 + 1.1 * lengths[0]), 6.4, simulated)
    above, below = figure.subplots(2, 1, sharex=True)
    _draw_cdp(above, np.array(cdp, dtype=np.float64), np.array(cdp_interval, dtype=np.float64))
    _draw_snr(below, _with_noise(snr_ratio), snr_db, _with_noise(luminance_snr_ratio))
    names = [shortened(name, 24) for name in stage_names]
    slanted = max(map(len, names)) > 11
    below.set_xticks(
        range(len(names)), names, rotation=30 if slanted else 0, ha="right" if slanted else "center", parse_math=False
    )
    below.set_xlim(-0.5, len(names) - 0.5)
    figure.legend(*below.get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize=SMALL_SIZE)
    for panel in (above, below):
        panel.grid(color="0.9")
        panel.set_axisbelow(True)
    return png(figure)


def _with_noise(ratio: Sequence[float]) -> NDArray[np.float64]:
    """Return an SNR, infinite where there is no noise but that of rounding."""
    values = np.array(ratio, dtype=np.float64)
    return np.where(values > LARGEST_SNR, np.inf, values)


def _figure(width_in: float, height_in: float, simulated: bool) -> Figure:
    figure = new_figure(width_in, height_in, simulated=False)
    if simulated:
        figure.text(0.01, 0.99, "simulated chain", va="top", fontsize=SMALL_SIZE, color=VERMILLION)
    return figure


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
    axes.grid(color="0.9")
    axes.set_axisbelow(True)
    axes.plot([], [], linestyle="none", label=_moments(values))
    legend = axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), fontsize=SMALL_SIZE, ncols=1, frameon=False)
    taken_literally(legend)


def _moments(values: Distribution) -> str:
    shares = values.weights / values.total
    deviation = sqrt(float(shares @ (values.values - values.mean) ** 2))
    if deviation <= _SAME * abs(values.mean):
        return f"mean {values.mean:.5g}, std 0, SNR (mean/std) ∞"
    n, snr = min(decimals(deviation, 3), 12), values.mean / deviation
    return f"mean {fixed(values.mean, n)}, std {fixed(deviation, n)}, SNR (mean/std) {significant(snr, 3)}"


def _bars(values: Distribution) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Edges of bars and the density of each, shapes (k + 1,) and (k,).

    Values that come again and again, as of whole numbers, get a bar each, or as many of them as make no more than 256
    bars; equal bins would hold now more, now fewer of them. Others get 100 equal bins.
    """
    x, shares = values.values, values.weights / values.total
    span = float(x[-1] - x[0])
    if span <= _SAME * abs(float(x[0])):
        half = 0.05 * abs(float(x[0])) or 0.5
        return x[0] + half * np.array([-4.0, -1.0, 1.0, 4.0]), np.array([0.0, 0.5 / half, 0.0])
    if values.size is not None and values.size < _REPEATS * x.size:
        edges = np.linspace(x[0], x[-1], _N_BINS + 1)
        return edges, np.histogram(x, edges, weights=shares)[0] / np.diff(edges)
    # From half way to half way between neighbours, but no wider than a fortieth of all to each side.
    halves = np.minimum(np.diff(x) / 2, span / 40)
    lows, highs = x - np.append(halves[0], halves), x + np.append(halves, halves[-1])
    starts = np.arange(0, x.size, ceil(x.size / _MOST_BARS))
    lows, highs = lows[starts], np.append(highs[starts[1:] - 1], highs[-1])
    density = np.add.reduceat(shares, starts) / (highs - lows)
    # Between two bars an empty one, mostly of no width.
    edges = np.column_stack((lows, np.maximum(lows, highs))).ravel()
    edges[2::2] = np.maximum(edges[2::2], edges[1:-1:2])  # rounding must not make them fall
    return edges, np.insert(density, np.arange(1, density.size), 0.0)


def _draw_cdp(axes: Axes, cdp: NDArray[np.float64], interval: NDArray[np.float64]) -> None:
    stages = np.arange(cdp.size)
    known = np.isfinite(cdp)
    axes.plot(stages[known], cdp[known], "o-", color=BLUE, linewidth=1.5, markersize=5)
    sure = known & np.isfinite(interval).all(axis=1)
    # An interval by another method than the point's need not hold it; a bar cannot have a negative length.
    lengths = np.clip([cdp - interval[:, 0], interval[:, 1] - cdp], 0, None)[:, sure]
    axes.errorbar(stages[sure], cdp[sure], yerr=lengths, fmt="none", ecolor="black", capsize=3, elinewidth=1.0)
    axes.set_ylim(-0.05, 1.2)
    axes.set_yticks(np.linspace(0, 1, 6))
    tops = np.where(np.isfinite(interval[:, 1]), np.fmax(interval[:, 1], cdp), cdp)
    for stage in stages[known]:
        _write_above(axes, stage, tops[stage], f"{cdp[stage]:.3f}")
    label(axes, "", "CDP", "CDP after each stage, with 95 % bars")


def _draw_snr(
    axes: Axes, native: NDArray[np.float64], native_db: Sequence[float], luminance: NDArray[np.float64]
) -> None:
    from matplotlib.ticker import LogLocator

    both = np.concatenate((native, luminance))
    finite = both[np.isfinite(both) & (both > 0)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (1.0, 1.0)
    top = high * max((high / low) ** 0.25, 1.5)
    axes.set_yscale("log")
    # The luminance on top, in smaller marks, so that both show where they are equal.
    _draw_ratio(axes, native, top, ("o-", BLUE, 7), "SNR of the values")
    _draw_ratio(axes, luminance, top, ("s--", GREEN, 4), "SNR of the luminance in cd/m²")
    axes.set_ylim(low / max((high / low) ** 0.15, 1.3), top * max((high / low) ** 0.15, 1.3))
    plain_numbers(axes.yaxis)
    if finite.size:
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    else:
        axes.set_yticks([])
    for stage in np.flatnonzero(native > 0).tolist():
        text = f"{native_db[stage]:.1f} dB" if np.isfinite(native[stage]) else "∞"
        _write_above(axes, stage, min(float(native[stage]), top), text)
    label(axes, "", "SNR (mean/std)", "SNR after each stage")


def _draw_ratio(axes: Axes, ratio: NDArray[np.float64], top: float, style: tuple[str, str, float], text: str) -> None:
    """Draw an SNR from stage to stage; `style` is form, colour and size of the marks."""
    form, colour, size = style
    stages, finite = np.arange(ratio.size), np.isfinite(ratio) & (ratio > 0)
    endless = np.isposinf(ratio)
    axes.plot(stages[finite], ratio[finite], form, color=colour, linewidth=1.5, markersize=size, label=text)
    axes.plot(stages[endless], np.full(endless.sum(), top), "^", color=colour, markersize=size)


def _write_above(axes: Axes, x: float, y: float, text: str) -> None:
    """Write a value above its point, readable across a line."""
    from matplotlib.patheffects import withStroke

    axes.annotate(
        text,
        (x, y),
        xytext=(0, 7),
        textcoords="offset points",
        horizontalalignment="center",
        fontsize=SMALL_SIZE,
        path_effects=[withStroke(linewidth=3, foreground="white")],
    )
