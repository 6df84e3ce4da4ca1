"""Figures of flare: the map in logarithmic colours, and the radial profile."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.luminance import LuminanceMap
from ...core.roi import Roi
from ...metrics.stray_light import Flare, attenuation_db
from ...report import drawing
from ...report.layout import Card, ReportFigure
from ...report.maps import add_scale, draw_regions, image_extent, image_figure
from ...report.text import fixed, measured_text, shortened
from .tables import FIGURES, figures_of

#: Factor that the colours of a map span at most.
_MOST_SPAN = 1e5


def map_figure(flare: Flare, luminance: LuminanceMap, source: Sequence[Roi], title: str, unit: str) -> ReportFigure:
    """Draw the stray light of all blocks, with the source and the worst place."""
    from matplotlib.colors import LogNorm

    values = flare.light.blocks.value
    positive = values[np.isfinite(values) & (values > 0)]
    top = float(positive.max(initial=1e-300))
    low = max(float(positive.min(initial=top)), top / _MOST_SPAN)
    figure = image_figure(luminance, shortened(title, 60), False, source)
    axes, (left, right, bottom, _) = figure.axes[0], image_extent(luminance)
    rows, columns = values.shape
    extent = (0.0, columns * flare.block_px, rows * flare.block_px, 0.0)
    norm = LogNorm(low, top if top > low else 2 * low)
    shown = axes.imshow(np.where(np.isfinite(values), np.maximum(values, low), np.nan), cmap="inferno", norm=norm,
                        extent=extent)  # fmt: skip
    axes.set(xlim=(left, right), ylim=(bottom, 0))
    axes.set_facecolor("0.8")
    where = "relative stray light" if unit == "relative" else f"stray light in {unit}"
    add_scale(figure, shown, where, extend="min")
    draw_regions(figure, luminance, source)
    axes.plot(*flare.worst_px, "+", color="#56B4E9", markersize=12, markeredgewidth=2)
    return drawing.reported(
        "map", figure, f"Stray light in blocks of {flare.block_px} x {flare.block_px} pixels, in logarithmic colours; "
        "the regions of the source, and a cross at the worst place.",
    )  # fmt: skip


def profile_figure(flare: Flare, unit: str) -> ReportFigure:
    """Draw the mean of rings about the source over their distance, in each unit."""
    figures = figures_of(flare)
    figure = drawing.new_figure(6.6, 1.2 + 2.3 * len(figures))
    plots = figure.subplots(len(figures), sharex=True, squeeze=False)[:, 0]
    for axes, (name, stray) in zip(plots, figures.items(), strict=True):
        value, expanded = stray.profile.value, np.nan_to_num(np.asarray(stray.profile.U))
        positive = value > 0
        axes.plot(flare.radius_px, np.where(positive, value, np.nan), ".-", color=drawing.BLUE)
        if positive.any():
            low = np.maximum(value - expanded, value[positive].min() / 10)
            axes.fill_between(flare.radius_px, low, value + expanded, color=drawing.BLUE, alpha=0.2, linewidth=0)
            drawing.logarithmic(axes.xaxis, axes.yaxis)
        last = axes is plots[-1]
        label = FIGURES[name][0] + (f" in {unit}" if name == "light" and unit != "relative" else "")
        drawing.finish(axes, "distance from the middle of the source in pixels" if last else "", label, "")
    return drawing.reported(
        "profile", figure, "Mean of rings about the source, with its 95 % interval, over their distance from it."
    )


def flare_cards(flare: Flare, unit: str) -> list[Card]:
    """Make a card for the stray light in each unit."""
    cards = []
    x, y = flare.worst_px
    for name, stray in figures_of(flare).items():
        factor, shown_unit = (1.0, unit) if name == "light" else (1e6, "ppm")
        worst, mean = (measured_text(factor * value.value, factor * value.u) for value in (stray.worst, stray.mean))
        lines = [f"mean {mean}{f' {shown_unit}' * (shown_unit != 'relative')}", f"at x {x:.0f}, y {y:.0f} px"]
        if name == "normalised":
            in_db = [fixed(attenuation_db(quantity.value), 1) for quantity in (stray.worst, stray.mean)]
            lines.append(f"attenuation {in_db[0]} dB, mean {in_db[1]} dB")
        cards.append(Card(f"Worst place, {FIGURES[name][0]}", worst, shown_unit, tuple(lines)))
    return cards
