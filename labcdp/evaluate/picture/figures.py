"""The figures of a picture: its regions, its contrasts and its values."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, isfinite, log
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.roi import Roi
from ...metrics import ContrastDistribution, contrast_histogram
from ...report.drawing import (
    BLUE,
    GREEN,
    ORANGE,
    VERMILLION,
    add_legend,
    finish,
    label,
    placed_figure,
    reported,
)
from ...report.layout import ReportFigure
from ...report.maps import add_scale, draw_regions, drawn_pixels, image_extent, image_figure
from ...report.plots import ContrastPanel, contrast_figures
from ...report.text import percent, shortened
from .image import AnyContrast, MeasuredPicture
from .neighbours import NeighbourPair, neighbour_distribution

if TYPE_CHECKING:
    from ...core.luminance import LuminanceMap
    from ...files.picture import Picture
    from ...metrics import Cdp

#: Most contrasts of a pair with a panel each; of more, only the one closest to the measured contrast is shown.
_MOST_CONTRASTS = 3
#: Panels of contrasts.
_MOST_PANELS = 24
#: Regions, and pairs, that are drawn in one plot.
_COLOURS = (BLUE, ORANGE, GREEN, VERMILLION, "#CC79A7", "#56B4E9", "#8C6D1F", "black")
#: Share of the pixels that may be brighter than the white of a drawn picture, and how it is brightened.
_WHITE_SHARE, _GAMMA = 0.001, 0.45
#: Most bars of a histogram.
_MOST_BARS = 256


def picture_figures(measured: MeasuredPicture, picture: Picture, luminance: LuminanceMap) -> list[ReportFigure]:
    """Draw a picture with its regions, the contrasts of its pairs, and the values of picture and regions."""
    panels = []
    # Of the many pairs of a chart its own figures show the CDP.
    for pair in measured.contrasts if measured.chart is None else ():
        distribution, contrast = pair_distribution(pair, luminance), pair.contrast.value
        if distribution is not None:
            name = shortened(pair.name, 40)
            panels += [ContrastPanel(name, distribution, cdp, contrast) for cdp in _drawn(pair.cdp, contrast)]
    figures = [_picture(measured, luminance), *contrast_figures(panels[:_MOST_PANELS])]
    if measured.chart is None and any(
        len(pair.cdp) > 1 and np.isfinite(pair.cdp.cdp).any() for pair in measured.contrasts
    ):
        figures.append(_curves([(pair.name, pair.cdp) for pair in measured.contrasts]))
    if measured.colours:
        from ..colour.figures import colour_figure

        figures.append(colour_figure(measured.colours))
    return [*figures, _values(measured, picture, luminance)]


def pair_distribution(pair: AnyContrast, luminance: LuminanceMap) -> ContrastDistribution | None:
    """Return the contrasts of all pairs of pixels; None where no contrast is finite, and of saturated regions."""
    if isinstance(pair, NeighbourPair):
        return neighbour_distribution(luminance, pair)
    if pair.bound:
        return None
    highest = float(pair.cdp.detected_range.high.max(initial=0.0)) or 1.0
    a, b = (luminance.select(region.roi).astype(np.float64) for region in (pair.a, pair.b))
    return contrast_histogram(a, b, highest)


def _drawn(cdps: Cdp[NDArray[np.float64]], measured: float) -> Sequence[Cdp[float]]:
    """Return the contrasts of a pair with a panel each: of many only the one closest to the measured contrast."""
    if len(cdps) <= _MOST_CONTRASTS:
        return list(cdps)
    if isfinite(measured) and measured > 0:
        return [min(cdps, key=lambda cdp: abs(log(cdp.contrast / measured)))]
    return [max(cdps, key=lambda cdp: cdp.cdp)]


def luminance_label(unit: str) -> str:
    """Return the label of an axis of luminance."""
    return "relative luminance" if unit == "relative" else f"luminance in {unit}"


def _picture(measured: MeasuredPicture, luminance: LuminanceMap) -> ReportFigure:
    from matplotlib.colors import PowerNorm

    drawn, side = drawn_pixels(luminance)
    finite = drawn[np.isfinite(drawn)]
    white = float(np.quantile(finite, 1 - _WHITE_SHARE)) if finite.size else 1.0
    white = white if white > 0 else 1.0
    regions = [region.roi for region in measured.regions]
    if measured.neighbours is not None and measured.neighbours.rectangle is not None:
        x0, y0, x1, y1 = measured.neighbours.rectangle
        regions.append(Roi.rectangle("nearest-neighbour", x0, y0, x1 + 1 - x0, y1 + 1 - y0))
    figure = image_figure(luminance, shortened(Path(measured.file).name, 60), False, regions)
    norm = PowerNorm(_GAMMA, 0, white)
    shown = figure.axes[0].imshow(np.clip(drawn, 0, white), cmap="gray", norm=norm, extent=image_extent(luminance))
    add_scale(figure, shown, luminance_label(measured.unit), extend="max")
    draw_regions(figure, luminance, regions)
    scale = f" Each drawn pixel is the mean of {side} x {side} of the picture's." if side > 1 else ""
    with_regions = ", with its regions" if measured.regions else ""
    return reported(
        "picture",
        figure,
        f"The picture as {luminance_label(measured.unit)}, dark parts brightened{with_regions}.{scale}",
        f"Grey picture with {len(regions)} regions: {', '.join(roi.name for roi in regions) or 'none'}.",
    )


def _curves(cdps: Sequence[tuple[str, Cdp[NDArray[np.float64]]]]) -> ReportFigure:
    """Draw CDP over the target contrast, a line a pair."""
    figure = placed_figure(9.0, 4.2)
    axes = figure.add_axes((0.08, 0.14, 0.6, 0.77))
    drawn = cdps[: len(_COLOURS)]
    for (name, results), colour in zip(drawn, _COLOURS, strict=False):
        percents, (low, high) = 100 * results.contrast, results.interval
        known = np.isfinite(low) & np.isfinite(high)
        axes.plot(percents, results.cdp, "o-", color=colour, markersize=3, label=shortened(name, 30))
        axes.fill_between(percents[known], low[known], high[known], color=colour, alpha=0.2, linewidth=0)
    axes.set_ylim(-0.02, 1.05)
    title = "CDP over the target contrast, with 95 % intervals"
    beside = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.0), "frameon": False}
    finish(axes, "target Weber contrast in %", "CDP", title, **beside)
    with_cdp = [cdp for _, results in drawn for cdp in results if isfinite(cdp.cdp)]
    best = max(with_cdp, key=lambda cdp: cdp.cdp, default=None)
    largest = "" if best is None else f"; the largest is {best.cdp:.4f} at {percent(best.contrast)}"
    left_out = f" Only the first {len(drawn)} of {len(cdps)} pairs are drawn." if len(cdps) > len(drawn) else ""
    return reported(
        "cdp",
        figure,
        f"CDP of each target contrast, with its 95 % interval.{left_out}",
        f"CDP over contrast{largest}.",
    )


def _values(measured: MeasuredPicture, picture: Picture, luminance: LuminanceMap) -> ReportFigure:
    """Draw histograms of picture and regions, of the values of the file and of the luminance."""
    native = picture.light if picture.frame is None else picture.frame.dn
    assert native is not None
    in_pairs = {region.roi.name for pair in measured.pairs for region in (pair.a, pair.b)}
    rois = [region.roi for region in measured.regions if region.roi.name in in_pairs or not in_pairs][: len(_COLOURS)]
    maps = [(np.asarray(luminance.luminance_cd_m2), luminance.scaled, luminance_label(measured.unit))]
    # Without a scale and a tone curve, luminance has the histogram of the values.
    if measured.unit != "relative" or picture.encoding != "linear":
        maps.insert(0, (native, lambda roi: roi, "DN" if picture.frame is not None else "value in the file"))
    figure = placed_figure(9.6, 3.5)
    width = 0.86 / len(maps) - 0.05
    for number, (values, placed, text) in enumerate(maps):
        axes = figure.add_axes((0.06 + number * (width + 0.07), 0.27, width, 0.66))
        edges = histogram_edges(values)
        axes.stairs(_density(values, edges), edges, fill=True, color="0.75", label="whole picture")
        for roi, colour in zip(rois, _COLOURS, strict=False):
            inside = placed(roi).select(values)
            axes.stairs(_density(inside, edges), edges, color=colour, linewidth=1.3, label=shortened(roi.name, 24))
        axes.set_ylim(0.0, 1.05)
        label(axes, text, "density, scaled to 1" if number == 0 else "", "")
    add_legend(figure, *figure.axes[0].get_legend_handles_labels(), loc="lower center", ncols=5, frameon=False)
    return reported(
        "values",
        figure,
        "Histograms of the picture (grey) and its regions, each scaled to a largest bar of 1.",
        f"Histograms of the whole picture and of {len(rois)} regions.",
    )


def histogram_edges(values: NDArray[Any]) -> NDArray[np.float64]:
    """Edges of bars that fit the values: one for each of few distinct ones, as of 8 bits, else equal ones.

    Of whole numbers each bar holds as many of them.
    """
    flat = values[np.isfinite(values)] if values.dtype.kind == "f" else values.ravel()
    if not flat.size:
        return np.array([0.0, 1.0])
    low, high = float(flat.min()), float(flat.max())
    if values.dtype.kind != "f":
        width = ceil((high - low + 1) / _MOST_BARS)
        return np.arange(low, high + width + 1, width, dtype=np.float64) - 0.5
    distinct = np.unique(flat).astype(np.float64)
    if distinct.size == 1:
        only = float(distinct[0])
        return only + np.array([-0.5, 0.5]) * (abs(only) or 1.0)
    if distinct.size > _MOST_BARS:
        return np.linspace(low, high, _MOST_BARS // 2 + 1)
    middles = (distinct[1:] + distinct[:-1]) / 2
    return np.concatenate(([2 * low - middles[0]], middles, [2 * high - middles[-1]]))


def _density(values: NDArray[Any], edges: NDArray[np.float64]) -> NDArray[np.float64]:
    finite = values[np.isfinite(values)] if values.dtype.kind == "f" else values
    density: NDArray[np.float64] = np.histogram(finite, edges)[0] / np.diff(edges)
    return density / density.max() if density.any() else density
