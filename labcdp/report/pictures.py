"""Figures that are images: the target with its regions, and the luminance map."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..luminance import Invalid, LuminanceMap
from ..roi import Roi
from .digits import share_percent, shortened
from .drawing import (
    LABEL_SIZE,
    ORANGE,
    SMALL_SIZE,
    VERMILLION,
    block_mean,
    label,
    missing_glyphs_allowed,
    new_figure,
    plain_numbers,
    png,
    reduction,
    taken_literally,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Text

    from ..evaluate import SessionEvaluation

_WIDTH_IN = 8.0

#: Names beside the target: cut at this length (the tables have them whole), and so many in a column.
_LONGEST_NAME, _NAMES_IN_COLUMN = 28, 30


def target_figure(evaluation: SessionEvaluation) -> bytes:
    """Draw the target in grey on a logarithmic scale, with its regions and their names, as PNG.

    Where a name does not fit its region, all regions get numbers, and the names stand beside the picture.
    """
    from matplotlib.colors import LogNorm

    luminance = evaluation.map.luminance_cd_m2
    name = shortened(evaluation.observed.configuration.target.name, 60)
    figure, axes = _image_axes(evaluation, f"Target: {name}", beside_in=0.6)
    levels = [row.calibrated.luminance_cd_m2 for row in evaluation.patches]
    darkest, brightest = 0.4 * min(levels), 1.2 * max(levels)
    axes.imshow(
        np.clip(block_mean(luminance, reduction(luminance.shape)), darkest, brightest),
        cmap="gray",
        norm=LogNorm(darkest, brightest),
        extent=_extent(evaluation.map),
    )
    name_regions(figure, axes, [row.region for row in evaluation.patches])
    return png(figure)


def _image_axes(evaluation: SessionEvaluation, title: str, beside_in: float) -> tuple[Figure, Axes]:
    """Make a figure for the image, with some inches for what stands beside it."""
    height, width = evaluation.map.luminance_cd_m2.shape
    # Wide and narrow images alike get a figure that is neither a strip nor a tower.
    height_in = (_WIDTH_IN - beside_in) * min(max(height / width, 0.3), 1.5)
    figure = new_figure(_WIDTH_IN, 1.1 + height_in, bool(evaluation.simulated))
    axes = figure.add_subplot()
    label(axes, "x in pixels", "y in pixels", title)
    return figure, axes


def _extent(image: LuminanceMap) -> tuple[float, float, float, float]:
    """Place the image so that regions can be drawn in the camera's pixels, y down."""
    height, width = image.shape
    return 0.0, float(width * image.step), float(height * image.step), 0.0


def name_regions(figure: Figure, axes: Axes, regions: list[Roi]) -> None:
    """Draw regions with their names, or with numbers where a name does not fit, and the names beside the picture."""
    from matplotlib.patches import Polygon

    for region in regions:
        # A light line in a dark one shows on any grey.
        for colour, width in (("black", 3.0), (ORANGE, 1.2)):
            axes.add_patch(Polygon(region.corners, fill=False, edgecolor=colour, linewidth=width))
    texts = [_outlined_text(axes, region, shortened(region.name, _LONGEST_NAME)) for region in regions]
    if all(_fitting(figure, axes, regions, texts)):
        return
    for number, text in enumerate(texts, start=1):
        text.set_text(str(number))
    _list_names(figure, [shortened(region.name, _LONGEST_NAME) for region in regions])
    for fits, region, text in zip(_fitting(figure, axes, regions, texts), regions, texts, strict=True):
        if not fits:  # a tiny region: its number stands above it
            text.set_position((region.centre[0], region.bounds[1]))
            text.set_verticalalignment("bottom")


def _outlined_text(axes: Axes, region: Roi, name: str) -> Text:
    from matplotlib.patheffects import withStroke

    return axes.text(
        *region.centre,
        name,
        color="white",
        fontsize=SMALL_SIZE,
        horizontalalignment="center",
        verticalalignment="center",
        parse_math=False,
        path_effects=[withStroke(linewidth=2.5, foreground="black")],
    )


def _fitting(figure: Figure, axes: Axes, regions: list[Roi], texts: list[Text]) -> list[bool]:
    """Tell of each text whether it lies inside its region as the figure is now laid out."""
    with missing_glyphs_allowed():
        figure.draw_without_rendering()
        inside = []
        for region, text in zip(regions, texts, strict=True):
            x0, y0, x1, y1 = region.bounds
            (left, top), (right, bottom) = axes.transData.transform([(x0, y0), (x1, y1)])
            extent = text.get_window_extent()
            inside.append(extent.width < 0.96 * (right - left) and extent.height < 0.96 * (top - bottom))
    return inside


def _list_names(figure: Figure, names: list[str]) -> None:
    from matplotlib.lines import Line2D

    columns = ceil(len(names) / _NAMES_IN_COLUMN)
    figure.set_figwidth(figure.get_figwidth() + 2.4 * columns)
    legend = figure.legend(
        handles=[Line2D([], [], linestyle="none") for _ in names],
        labels=[f"{number}  {name}" for number, name in enumerate(names, start=1)],
        loc="outside right upper",
        ncols=columns,
        fontsize=SMALL_SIZE,
        handlelength=0,
        handletextpad=0,
        frameon=False,
    )
    taken_literally(legend)


@dataclass(frozen=True)
class _Reason:
    """Why pixels are not valid, which ones, and how they are drawn.

    Parameters
    ----------
    name : str
        For the legend.
    mask : ndarray of bool, shape (height, width)
        Which pixels.
    colour : str
        Any that matplotlib knows.
    counts_alone : bool
        True if a single pixel colours the drawn pixel that stands for it and its neighbours.
    """

    name: str
    mask: NDArray[np.bool_]
    colour: str
    counts_alone: bool = False


def luminance_figure(evaluation: SessionEvaluation) -> bytes:
    """Draw the luminance in false colours on a logarithmic scale, and pixels that are not valid in plain ones, as PNG.

    A drawn pixel that stands for several counts as saturated if one of them is, and as not valid for another
    reason if most of them are.
    """
    from matplotlib.colors import LogNorm
    from matplotlib.patches import Patch

    luminance = evaluation.map.luminance_cd_m2
    low, high = evaluation.calibration.range_cd_m2
    figure, axes = _image_axes(evaluation, "Luminance by the calibrated camera", beside_in=1.7)
    side = reduction(luminance.shape)
    picture = axes.imshow(
        np.clip(block_mean(luminance, side), 0.9 * low, 1.1 * high),
        cmap="viridis",
        norm=LogNorm(0.9 * low, 1.1 * high),
        extent=_extent(evaluation.map),
    )
    bar = figure.colorbar(picture, ax=axes, extend="both")
    bar.set_label("luminance in cd/m²", fontsize=LABEL_SIZE)
    bar.ax.tick_params(labelsize=SMALL_SIZE)
    plain_numbers(bar.ax.yaxis)
    reasons = _reasons(evaluation.map, low)
    if reasons:
        axes.imshow(_overlay(reasons, side), extent=_extent(evaluation.map), interpolation="nearest")
        figure.legend(
            handles=[Patch(facecolor=reason.colour, edgecolor="black", linewidth=0.6) for reason in reasons],
            labels=[f"{reason.name}: {share_percent(float(reason.mask.mean()))} of the pixels" for reason in reasons],
            loc="outside lower center",
            ncols=2,
            fontsize=SMALL_SIZE,
        )
    return png(figure)


def _reasons(luminance: LuminanceMap, low_cd_m2: float) -> list[_Reason]:
    """Sort pixels that are not valid, each under one reason; reasons without a pixel are left out."""

    def flagged(flag: Invalid) -> NDArray[np.bool_]:
        mask: NDArray[np.bool_] = np.not_equal(luminance.invalid & flag, 0)
        return mask

    saturated = flagged(Invalid.SATURATED)
    black = flagged(Invalid.BELOW_BLACK) & ~saturated
    outside = flagged(Invalid.OUTSIDE_CALIBRATED) & ~saturated & ~black
    dark = luminance.luminance_cd_m2 < low_cd_m2
    reasons = [
        _Reason("saturated at every exposure", saturated, VERMILLION, counts_alone=True),
        _Reason("below the camera's black", black, "black"),
        _Reason("darker than the calibrated range", outside & dark, "#9a9a9a"),
        _Reason("brighter than the calibrated range", outside & ~dark, "#CC79A7"),
    ]
    return [reason for reason in reasons if reason.mask.any()]


def _overlay(reasons: list[_Reason], side: int) -> NDArray[np.float64]:
    """Colours of the drawn pixels that are not valid, shape (height, width, 4); the others are transparent."""
    from matplotlib.colors import to_rgba

    shares = np.array([block_mean(reason.mask, side) for reason in reasons])
    # What counts alone outweighs all that counts by the majority.
    weights = np.where([[[reason.counts_alone]] for reason in reasons], np.ceil(shares), shares)
    colours = np.array([to_rgba(reason.colour) for reason in reasons])
    overlay: NDArray[np.float64] = colours[np.argmax(weights, axis=0)]
    overlay[np.sum(weights, axis=0) < 0.5] = 0.0
    return overlay
