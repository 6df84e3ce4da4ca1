"""Images as figures: luminance in grey with named regions, and in false colours with the reasons of invalid pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import NDArray

from ...core.luminance import Invalid, LuminanceMap
from ...core.roi import Roi
from ..digits import share_percent
from .drawing import ORANGE, SMALL_SIZE, VERMILLION, block_mean, new_figure, png, reduction
from .image_drawing import ImageFigure, drawn_pixels

#: Height of a line of the legend, in inches.
_LEGEND_IN = 0.3
#: Width of a small picture, in inches, and its margin around the regions over their extent.
_CLOSE_IN, _MARGIN = 3.2, 0.08


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
    from matplotlib.colors import LogNorm

    figure = ImageFigure.of(_size(luminance), title, simulated, regions)
    levels = [float(np.mean(luminance.select(region))) for region in regions]
    lit = [level for level in levels if level > 0] or [1.0]
    darkest, brightest = 0.4 * min(lit), 1.2 * max(lit)
    drawn, _ = drawn_pixels(luminance)
    norm = LogNorm(darkest, brightest)
    shown = figure.axes.imshow(np.clip(drawn, darkest, brightest), cmap="gray", norm=norm, extent=figure.extent)
    figure.add_scale(shown, "luminance in cd/m²", extend="both")
    figure.draw_regions()
    return png(figure.figure)


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
    from matplotlib.patches import Polygon

    bounds = np.array([region.bounds for region in regions])
    (left, top), (right, bottom) = bounds[:, :2].min(axis=0), bounds[:, 2:].max(axis=0)
    margin = _MARGIN * max(right - left, bottom - top)
    width_px, height_px = _size(luminance)
    x = (max(left - margin, 0.0), min(right + margin, width_px))
    y = (max(top - margin, 0.0), min(bottom + margin, height_px))
    lit = [level for region in regions if (level := float(np.mean(luminance.select(region)))) > 0] or [1.0]
    (first, last), (upper, lower) = ((int(low / luminance.step), ceil(high / luminance.step)) for low, high in (x, y))
    inner = np.asarray(luminance.luminance_cd_m2)[upper:lower, first:last]
    drawn = np.clip(block_mean(inner, reduction(inner.shape)), 0.4 * min(lit), 1.2 * max(lit))
    figure = new_figure(_CLOSE_IN, _CLOSE_IN * (y[1] - y[0]) / (x[1] - x[0]), "bench" if simulated else "")
    axes = figure.add_subplot()
    axes.imshow(drawn, cmap="gray", norm=LogNorm(), extent=(x[0], x[1], y[1], y[0]))
    axes.set_axis_off()
    for number, region in enumerate(regions, start=1):
        for colour, width in (("black", 2.0), (ORANGE, 0.8)):
            axes.add_patch(Polygon(region.corners, fill=False, edgecolor=colour, linewidth=width))
        box = {"facecolor": "white", "edgecolor": "none", "pad": 1.2, "alpha": 0.85}
        axes.text(*region.centre, str(number), fontsize=8, ha="center", va="center", bbox=box)
    return png(figure)


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
    from matplotlib.colors import LogNorm, Normalize
    from matplotlib.patches import Patch

    low, high = 0.9 * range_cd_m2[0], 1.1 * range_cd_m2[1]
    reasons = _reasons(luminance, range_cd_m2[0])
    figure = ImageFigure.of(_size(luminance), title, simulated, below_in=_LEGEND_IN * ceil(len(reasons) / 2))
    drawn, _ = drawn_pixels(luminance)
    norm = Normalize(low, high) if linear else LogNorm(low, high)
    shown = figure.axes.imshow(np.clip(drawn, low, high), cmap="viridis", norm=norm, extent=figure.extent)
    figure.add_scale(shown, "luminance in cd/m²", extend="both")
    if reasons:
        overlay = _overlay(reasons, reduction(luminance.shape))
        figure.axes.imshow(overlay, extent=figure.extent, interpolation="nearest")
        figure.figure.legend(
            handles=[Patch(facecolor=reason.colour, edgecolor="black", linewidth=0.6) for reason in reasons],
            labels=[f"{reason.name}: {share_percent(float(reason.mask.mean()))} of the pixels" for reason in reasons],
            loc="lower center",
            ncols=2,
            fontsize=SMALL_SIZE,
        )
    return png(figure.figure)


def _size(luminance: LuminanceMap) -> tuple[float, float]:
    """Width and height of the image in pixels of the camera."""
    height, width = luminance.shape
    return float(width * luminance.step), float(height * luminance.step)


@dataclass(frozen=True)
class _Reason:
    """Invalid pixels of one reason, and their colour.

    Parameters
    ----------
    name : str
        For the legend.
    mask : ndarray of bool, shape (height, width)
        Which pixels.
    colour : str
        Any that matplotlib knows.
    counts_alone : bool
        True if a single pixel colours the drawn pixel that represents it and its neighbours.
    """

    name: str
    mask: NDArray[np.bool_]
    colour: str
    counts_alone: bool = False


def _reasons(luminance: LuminanceMap, low_cd_m2: float) -> list[_Reason]:
    """Group invalid pixels, each under one reason; reasons without a pixel are left out."""

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
    """Colours of the invalid drawn pixels, shape (height, width, 4); the others are transparent."""
    from matplotlib.colors import to_rgba

    shares = np.array([block_mean(reason.mask, side) for reason in reasons])
    # A reason that a single pixel suffices for takes precedence over those by majority.
    weights = np.where([[[reason.counts_alone]] for reason in reasons], np.ceil(shares), shares)
    colours = np.array([to_rgba(reason.colour) for reason in reasons])
    overlay: NDArray[np.float64] = colours[np.argmax(weights, axis=0)]
    overlay[np.sum(weights, axis=0) < 0.5] = 0.0
    return overlay
