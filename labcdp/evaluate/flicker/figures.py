"""Figures of the flicker of a video: light over time with its histogram, light over the phase, and all regions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...metrics.modulation import Flicker
from ...report import drawing
from ...report.layout import ReportFigure
from ...report.text import shortened
from .measure import RegionFlicker

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Regions that are drawn by themselves, points of a curve, and length at which names are cut.
_MOST_DRAWN, _MOST_POINTS, _LONGEST_NAME = 4, 3000, 28
#: Height of a panel in inches.
_PANEL_IN = 1.75
#: Regions whose names are written below the figure of all.
_MOST_NAMED = 40


def drawn_regions(regions: Sequence[RegionFlicker]) -> list[RegionFlicker]:
    """Return the regions that are drawn by themselves: those with the largest FMI."""
    known = [region for region in regions if np.isfinite(region.flicker.fmi.value)]
    return sorted(known, key=lambda region: -region.flicker.fmi.value)[:_MOST_DRAWN]


def over_time(regions: Sequence[RegionFlicker], unit: str) -> ReportFigure:
    """Draw the light of regions over time, each with its histogram and the bands of the indices."""
    figure = drawing.new_figure(6.6, 0.7 + _PANEL_IN * len(regions))
    grid = figure.subplots(len(regions), 2, sharey="row", squeeze=False, width_ratios=(3, 1))
    for (time, share), region in zip(grid, regions, strict=True):
        flicker, values = region.flicker, region.values
        known = np.isfinite(values)
        time.plot(region.times_s[known], values[known], ".-", color=drawing.BLUE, linewidth=0.5, markersize=2.0)
        bins = np.linspace(flicker.minimum, flicker.maximum, 41) if flicker.maximum > flicker.minimum else 10
        share.hist(values[known], bins, orientation="horizontal", color=drawing.BLUE, weights=_shares(known))
        for axes in (time, share):
            _bands(axes, flicker)
            axes.tick_params(labelsize=drawing.SMALL_SIZE)
        drawing.label(time, "", _light(unit), shortened(region.title, _LONGEST_NAME))
        drawing.label(share, "", "", f"FMI {flicker.fmi.value:.3f}, MMP {flicker.mmp.value:.3f}")
    grid[-1][0].set_xlabel("time in s", fontsize=drawing.LABEL_SIZE)
    grid[-1][1].set_xlabel("% of the frames", fontsize=drawing.LABEL_SIZE)
    caption = (
        "Light of regions over time, and how often each light occurs. Green: the band about the mean that MMP counts; "
        "orange: the light from which on FDI counts a frame, where the light with the lamp off is known."
    )
    return drawing.reported("over-time", figure, caption)


def _shares(known: NDArray[np.bool_]) -> NDArray[np.float64]:
    n_known = int(known.sum())
    return np.full(n_known, 100 / max(n_known, 1))


def _bands(axes: Axes, flicker: Flicker) -> None:
    low, high = flicker.mean * (1 - flicker.tolerance), flicker.mean * (1 + flicker.tolerance)
    axes.axhspan(low, high, color=drawing.GREEN, alpha=0.18, linewidth=0, zorder=0)
    if flicker.off > 0:
        axes.axhline(flicker.off * (1 + flicker.threshold), color=drawing.ORANGE, linewidth=1.0)


def over_phase(regions: Sequence[RegionFlicker], unit: str) -> ReportFigure | None:
    """Draw the light of regions over the phase of the lamp; None if it repeats in none of them."""
    periodic = [region for region in regions if region.flicker.wave is not None]
    if not periodic:
        return None
    figure = drawing.new_figure(6.6, 0.7 + _PANEL_IN * len(periodic))
    panels = figure.subplots(len(periodic), 1, sharex=True, squeeze=False)[:, 0]
    for axes, region in zip(panels, periodic, strict=True):
        wave = region.flicker.wave
        assert wave is not None
        axes.plot(wave.phases, wave.values, ".", color=drawing.BLUE, markersize=2.5, label="frames")
        if wave.pulse is not None:
            phases = np.linspace(0, 1, 1001)
            axes.plot(phases, wave.pulse.light(phases), color=drawing.VERMILLION, linewidth=1.0, label="pulsed lamp")
        beat = region.flicker.beat_hz
        beats = f"beat of {beat:.4g} Hz, " if np.isfinite(beat) else ""
        title = f"{shortened(region.title, _LONGEST_NAME)}: {beats}{region.flicker.n_phases:.0f} phases"
        drawing.finish(axes, "", _light(unit), title, loc="best")
    panels[-1].set_xlabel("phase of the lamp in periods", fontsize=drawing.LABEL_SIZE)
    caption = (
        "Light of regions over the phase of the lamp, by the beat between lamp and frames. Where the frames leave "
        "gaps, the lamp was not seen."
    )
    return drawing.reported("over-phase", figure, caption)


def all_regions(regions: Sequence[RegionFlicker]) -> ReportFigure:
    """Draw FMI and MMP of all regions with their 95 % intervals."""
    figure = drawing.new_figure(6.6, 4.4)
    above, below = figure.subplots(2, sharex=True)
    at = np.arange(len(regions))
    for axes, name, colour in ((above, "fmi", drawing.VERMILLION), (below, "mmp", drawing.BLUE)):
        indices = [getattr(region.flicker, name) for region in regions]
        values = np.array([index.value for index in indices])
        ends = np.array([index.interval for index in indices])
        axes.vlines(at, ends[:, 0], ends[:, 1], color=colour, linewidth=1.2, alpha=0.6)
        axes.plot(at, values, "o", color=colour, markersize=3.5)
        drawing.finish(axes, "", name.upper(), "")
        axes.set_ylim(-0.03, 1.03)
    if len(regions) <= _MOST_NAMED:
        below.set_xticks(at, [shortened(region.title, _LONGEST_NAME) for region in regions], rotation=90)
        for text in below.get_xticklabels():
            text.set_parse_math(False)
    else:
        below.set_xlabel("region, in the order of the table", fontsize=drawing.LABEL_SIZE)
    return drawing.reported("regions", figure, "FMI and MMP of all regions, with their 95 % intervals.")


def _light(unit: str) -> str:
    return unit or "relative light"
