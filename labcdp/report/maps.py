"""Images as figures: luminance in grey with named regions, and in false colours with the reasons of invalid pixels."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..core.luminance import Invalid, LuminanceMap
from ..core.roi import Roi
from . import drawing
from .text import share_percent, shortened

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


#: Width of an image, and room to its left, right, above and below, in inches.
_WIDTH_IN, _LEFT_IN, _RIGHT_IN, _ABOVE_IN, _BELOW_IN = 6.2, 0.7, 1.2, 0.45, 0.55
#: Limits of the image height, so that figures of wide and narrow images have a moderate aspect ratio.
_FLATTEST, _TALLEST = 0.3, 1.5
#: Length at which names in an image are truncated (tables have them whole), and names per column next to it.
_LONGEST_NAME, _NAMES_IN_COLUMN = 28, 30
#: Size of the names in points, and width and height of a character over it.
_NAME_SIZE, _CHARACTER = 12.0, (0.6, 1.3)
_IN_REGION: dict[str, Any] = {"fontsize": _NAME_SIZE, "ha": "center", "va": "center"}
#: Height of a line of the legend; width of a small picture, in inches, and its margin around regions over their extent.
_LEGEND_IN, _CLOSE_IN, _MARGIN = 0.3, 3.2, 0.08
#: Characters of the longest text of a legend in two columns.
_LEGEND_COLUMN = 48


def image_figure(
    luminance: LuminanceMap, title: str, simulated: bool, regions: Sequence[Roi] = (), below_in: float = 0.0
) -> Figure:
    """Make a figure for an image of the size of a map, with a scale next to it; y runs down.

    Its axes are that of the image, in pixels of the camera (see `image_extent`), and that of the scale. There is room
    for the names of regions that do not fit in them, and for a legend below.
    """
    width_px, height_px = _size(luminance)
    height_in = _WIDTH_IN * min(max(height_px / width_px, _FLATTEST), _TALLEST)
    beside_in = 0.0 if _names_fit(luminance, regions) else _names_width_in(regions)
    whole = (_LEFT_IN + _WIDTH_IN + _RIGHT_IN + beside_in, _BELOW_IN + below_in + height_in + _ABOVE_IN)
    figure = drawing.placed_figure(*whole, "bench" if simulated else "")
    bottom, height = (_BELOW_IN + below_in) / whole[1], height_in / whole[1]
    axes = figure.add_axes((_LEFT_IN / whole[0], bottom, _WIDTH_IN / whole[0], height))
    figure.add_axes(((_LEFT_IN + _WIDTH_IN + 0.15) / whole[0], bottom, 0.2 / whole[0], height))
    drawing.label(axes, "x in pixels", "y in pixels", title)
    return figure


def image_extent(luminance: LuminanceMap) -> tuple[float, float, float, float]:
    """Return the edges of an image in its axes: left, right, lower and upper."""
    width_px, height_px = _size(luminance)
    return 0.0, width_px, height_px, 0.0


def add_scale(figure: Figure, shown: Any, text: str, extend: str = "neither") -> None:
    """Draw the scale of what an `image_figure` shows."""
    _, bar = figure.axes
    figure.colorbar(shown, cax=bar, extend=extend)
    bar.set_ylabel(text, fontsize=drawing.LABEL_SIZE)
    bar.tick_params(labelsize=drawing.SMALL_SIZE)
    drawing.plain_numbers(bar.yaxis)


def draw_regions(figure: Figure, luminance: LuminanceMap, regions: Sequence[Roi]) -> None:
    """Draw regions with their names into an `image_figure`, or with numbers and a list of names next to the image."""
    from matplotlib.lines import Line2D
    from matplotlib.patheffects import withStroke

    axes, inside = figure.axes[0], _names_fit(luminance, regions)
    for number, region in enumerate(regions, start=1):
        _outline(axes, region, 3.0, 1.2)
        name = shortened(region.name, _LONGEST_NAME) if inside else str(number)
        outlined = [withStroke(linewidth=2.0, foreground="black")]
        axes.text(*region.centre, name, color="white", parse_math=False, path_effects=outlined, **_IN_REGION)
    if not inside:
        names = [f"{n}  {shortened(region.name, _LONGEST_NAME)}" for n, region in enumerate(regions, start=1)]
        lines = [Line2D([], [], linestyle="none") for _ in names]
        how = {"loc": "upper right", "ncols": ceil(len(names) / _NAMES_IN_COLUMN), "frameon": False}
        drawing.add_legend(figure, lines, names, handlelength=0, handletextpad=0, **how)


def _outline(axes: Axes, region: Roi, dark: float, light: float) -> None:
    """Draw the outline of a region: a light line inside a dark one is visible on any grey."""
    from matplotlib.patches import Polygon

    for colour, width in (("black", dark), (drawing.ORANGE, light)):
        axes.add_patch(Polygon(region.corners, fill=False, edgecolor=colour, linewidth=width))


def _names_width_in(regions: Sequence[Roi]) -> float:
    """Width of the list of names, with their numbers, in inches."""
    # Number, gaps, and the dots of a name that is cut.
    longest = min(max(len(region.name) for region in regions), _LONGEST_NAME) + 6
    return longest * _CHARACTER[0] * drawing.SMALL_SIZE / 72 * ceil(len(regions) / _NAMES_IN_COLUMN)


def _names_fit(luminance: LuminanceMap, regions: Sequence[Roi]) -> bool:
    """Whether the names of all regions fit in them; else they are numbered, and the names listed."""
    width_px, height_px = _size(luminance)
    height_in = _WIDTH_IN * min(max(height_px / width_px, _FLATTEST), _TALLEST)
    points_per_px = 72 * min(_WIDTH_IN / width_px, height_in / height_px)
    wide, high = (_NAME_SIZE * size / points_per_px for size in _CHARACTER)
    for region in regions:
        left, top, right, bottom = region.bounds
        if len(shortened(region.name, _LONGEST_NAME)) * wide >= right - left or high >= bottom - top:
            return False
    return True


def drawn_pixels(luminance: LuminanceMap) -> tuple[NDArray[np.float64], int]:
    """Return a map downsampled to a figure's resolution, and the number of camera pixels per drawn pixel."""
    side = drawing.reduction(luminance.shape)
    return drawing.block_mean(np.asarray(luminance.luminance_cd_m2), side), side * luminance.step


def regions_picture(luminance: LuminanceMap, regions: Sequence[Roi], title: str, simulated: bool) -> bytes:
    """Draw a map in grey on a logarithmic scale, with regions and their names, as PNG.

    Where a name does not fit its region, all regions are numbered, and the names are listed next to the picture.

    Parameters
    ----------
    luminance : LuminanceMap
        The map.
    regions : sequence of Roi
        At least one; the scale spans their luminances.
    title : str
        Title.
    simulated : bool
        Whether the camera was simulated; the picture is then labelled so.
    """
    figure = image_figure(luminance, title, simulated, regions)
    _show(figure, luminance, _grey_range(luminance, regions), "gray")
    draw_regions(figure, luminance, regions)
    return drawing.png(figure)


def close_picture(luminance: LuminanceMap, regions: Sequence[Roi], simulated: bool) -> bytes:
    """Draw the part of a map around regions in grey on a logarithmic scale, small and without axes, as PNG.

    Parameters
    ----------
    luminance : LuminanceMap
        The map.
    regions : sequence of Roi
        At least one; numbered in their order.
    simulated : bool
        Whether the camera was simulated; the picture is then labelled so.
    """
    from matplotlib.colors import LogNorm

    bounds = np.array([region.bounds for region in regions])
    (left, top), (right, bottom) = bounds[:, :2].min(axis=0), bounds[:, 2:].max(axis=0)
    margin = _MARGIN * max(right - left, bottom - top)
    width_px, height_px = _size(luminance)
    x = (max(left - margin, 0.0), min(right + margin, width_px))
    y = (max(top - margin, 0.0), min(bottom + margin, height_px))
    (first, last), (upper, lower) = ((int(low / luminance.step), ceil(high / luminance.step)) for low, high in (x, y))
    inner = np.asarray(luminance.luminance_cd_m2)[upper:lower, first:last]
    drawn = np.clip(drawing.block_mean(inner, drawing.reduction(inner.shape)), *_grey_range(luminance, regions))
    figure = drawing.new_figure(_CLOSE_IN, _CLOSE_IN * (y[1] - y[0]) / (x[1] - x[0]), "bench" if simulated else "")
    axes = figure.add_subplot()
    axes.imshow(drawn, cmap="gray", norm=LogNorm(), extent=(x[0], x[1], y[1], y[0]))
    axes.set_axis_off()
    for number, region in enumerate(regions, start=1):
        _outline(axes, region, 2.0, 0.8)
        box = {"facecolor": "white", "edgecolor": "none", "pad": 1.2, "alpha": 0.85}
        axes.text(*region.centre, str(number), fontsize=8, ha="center", va="center", bbox=box)
    return drawing.png(figure)


def luminance_picture(
    luminance: LuminanceMap, title: str, simulated: bool, range_cd_m2: tuple[float, float], *, linear: bool = False
) -> bytes:
    """Draw a map in false colours, and invalid pixels in plain ones, as PNG.

    A drawn pixel that represents several pixels counts as saturated if one of them is, and as invalid for another
    reason if most of them are.

    Parameters
    ----------
    luminance : LuminanceMap
        The map.
    title : str
        Title.
    simulated : bool
        Whether the camera was simulated; the picture is then labelled so.
    range_cd_m2 : (float, float)
        Calibrated range, spanned by the scale.
    linear : bool
        Whether the scale is linear instead of logarithmic.
    """
    from matplotlib.colors import to_rgba
    from matplotlib.patches import Patch

    reasons = _reasons(luminance, range_cd_m2[0])
    texts = [f"{name}: {share_percent(float(mask.mean()))} of the pixels" for name, mask in reasons.items()]
    ncols = 2 if all(len(text) <= _LEGEND_COLUMN for text in texts) else 1
    figure = image_figure(luminance, title, simulated, below_in=_LEGEND_IN * ceil(len(texts) / ncols))
    _show(figure, luminance, (0.9 * range_cd_m2[0], 1.1 * range_cd_m2[1]), "viridis", linear)
    if reasons:
        side = drawing.reduction(luminance.shape)
        shares = np.array([drawing.block_mean(mask, side) for mask in reasons.values()])
        # One saturated pixel suffices; it takes precedence over reasons by majority.
        first = np.array([name == _SATURATED for name in reasons])[:, None, None]
        weights = np.where(first, np.ceil(shares), shares)
        colours = np.array([to_rgba(_COLOURS[name]) for name in reasons])
        overlay = colours[np.argmax(weights, axis=0)]
        overlay[np.sum(weights, axis=0) < 0.5] = 0.0
        figure.axes[0].imshow(overlay, extent=image_extent(luminance), interpolation="nearest")
        patches = [Patch(facecolor=_COLOURS[name], edgecolor="black", linewidth=0.6) for name in reasons]
        drawing.add_legend(figure, patches, texts, loc="lower center", ncols=ncols)
    return drawing.png(figure)


def _show(
    figure: Figure, luminance: LuminanceMap, limits: tuple[float, float], colours: str, linear: bool = False
) -> None:
    """Draw a map with its scale."""
    from matplotlib.colors import LogNorm, Normalize

    norm = Normalize(*limits) if linear else LogNorm(*limits)
    drawn = np.clip(drawn_pixels(luminance)[0], *limits)
    shown = figure.axes[0].imshow(drawn, cmap=colours, norm=norm, extent=image_extent(luminance))
    add_scale(figure, shown, "luminance in cd/m²", extend="both")


def _grey_range(luminance: LuminanceMap, regions: Sequence[Roi]) -> tuple[float, float]:
    """Luminances that are black and white in a picture of regions."""
    lit = [level for region in regions if (level := float(np.mean(luminance.select(region)))) > 0] or [1.0]
    return 0.4 * min(lit), 1.2 * max(lit)


def _size(luminance: LuminanceMap) -> tuple[float, float]:
    """Width and height of the image in pixels of the camera."""
    height, width = luminance.shape
    return float(width * luminance.step), float(height * luminance.step)


_SATURATED = "saturated at every exposure"
#: Colours of invalid pixels by their reason.
_COLOURS = {
    _SATURATED: drawing.VERMILLION,
    "below the camera's black": "black",
    "darker than the calibrated range": "#9a9a9a",
    "brighter than the calibrated range": "#CC79A7",
}


def _reasons(luminance: LuminanceMap, low_cd_m2: float) -> dict[str, NDArray[np.bool_]]:
    """Masks of the invalid pixels, each under one reason; reasons without a pixel are left out."""
    saturated, black, outside = (
        np.not_equal(luminance.invalid & flag, 0)
        for flag in (Invalid.SATURATED, Invalid.BELOW_BLACK, Invalid.OUTSIDE_CALIBRATED)
    )
    black &= ~saturated
    outside &= ~saturated & ~black
    dark = luminance.luminance_cd_m2 < low_cd_m2
    masks = (saturated, black, outside & dark, outside & ~dark)
    return {name: mask for name, mask in zip(_COLOURS, masks, strict=True) if mask.any()}
