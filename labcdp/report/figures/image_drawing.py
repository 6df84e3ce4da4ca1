"""Images in figures: layout of image and scale, and the regions in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.luminance import LuminanceMap
from ...core.roi import Roi
from ..digits import shortened
from .drawing import (
    LABEL_SIZE,
    ORANGE,
    SMALL_SIZE,
    block_mean,
    label,
    placed_figure,
    plain_numbers,
    reduction,
    taken_literally,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Width of an image, and room to its left, right, above and below, in inches.
_WIDTH_IN, _LEFT_IN, _RIGHT_IN, _ABOVE_IN, _BELOW_IN = 6.2, 0.7, 1.2, 0.45, 0.55
#: Limits of the image height, so that figures of wide and narrow images have a moderate aspect ratio.
_FLATTEST, _TALLEST = 0.3, 1.5
#: Length at which names in an image are truncated (tables have them whole), and names per column next to it.
_LONGEST_NAME, _NAMES_IN_COLUMN, _COLUMN_IN = 28, 30, 2.4
#: Size of the names in points, and width and height of a character over it.
_NAME_SIZE, _CHARACTER = 12.0, (0.6, 1.3)


@dataclass(frozen=True, eq=False)
class ImageFigure:
    """A figure for one image with a scale next to it; y runs down.

    Parameters
    ----------
    figure : Figure
        The figure.
    axes, bar : Axes
        For the image, in pixels of the camera, and for the scale.
    extent : (float, float, float, float)
        Place of the whole image in the axes.
    regions : tuple of Roi
        Regions in it.
    names_inside : bool
        Whether their names fit; else regions are numbered, and the names are listed next to the scale.
    """

    figure: Figure
    axes: Axes
    bar: Axes
    extent: tuple[float, float, float, float]
    regions: tuple[Roi, ...]
    names_inside: bool

    @classmethod
    def of(
        cls,
        size_px: tuple[float, float],
        title: str,
        simulated: bool,
        regions: Sequence[Roi] = (),
        below_in: float = 0.0,
    ) -> ImageFigure:
        """Make a figure for an image of this width and height, with room for a legend below it."""
        width_px, height_px = size_px
        height_in = _WIDTH_IN * min(max(height_px / width_px, _FLATTEST), _TALLEST)
        points_per_px = 72 * min(_WIDTH_IN / width_px, height_in / height_px)
        inside = all(_fits(region, points_per_px) for region in regions)
        beside_in = 0.0 if inside else _COLUMN_IN * ceil(len(regions) / _NAMES_IN_COLUMN)
        whole = (_LEFT_IN + _WIDTH_IN + _RIGHT_IN + beside_in, _BELOW_IN + below_in + height_in + _ABOVE_IN)
        figure = placed_figure(*whole, "bench" if simulated else "")
        bottom, height = (_BELOW_IN + below_in) / whole[1], height_in / whole[1]
        axes = figure.add_axes((_LEFT_IN / whole[0], bottom, _WIDTH_IN / whole[0], height))
        bar = figure.add_axes(((_LEFT_IN + _WIDTH_IN + 0.15) / whole[0], bottom, 0.2 / whole[0], height))
        label(axes, "x in pixels", "y in pixels", title)
        return cls(figure, axes, bar, (0.0, float(width_px), float(height_px), 0.0), tuple(regions), inside)

    def add_scale(self, shown: Any, text: str, extend: str = "neither") -> None:
        """Draw the scale of what is shown."""
        self.figure.colorbar(shown, cax=self.bar, extend=extend)
        self.bar.set_ylabel(text, fontsize=LABEL_SIZE)
        self.bar.tick_params(labelsize=SMALL_SIZE)
        plain_numbers(self.bar.yaxis)

    def draw_regions(self) -> None:
        """Draw the regions with their names, or with numbers and a list of names next to the image."""
        from matplotlib.patches import Polygon
        from matplotlib.patheffects import withStroke

        for number, region in enumerate(self.regions, start=1):
            # A light line inside a dark one is visible on any grey.
            for colour, width in (("black", 3.0), (ORANGE, 1.2)):
                self.axes.add_patch(Polygon(region.corners, fill=False, edgecolor=colour, linewidth=width))
            self.axes.text(
                *region.centre,
                shortened(region.name, _LONGEST_NAME) if self.names_inside else str(number),
                color="white",
                fontsize=_NAME_SIZE,
                horizontalalignment="center",
                verticalalignment="center",
                parse_math=False,
                path_effects=[withStroke(linewidth=2.0, foreground="black")],
            )
        if not self.names_inside:
            self._list_names()

    def _list_names(self) -> None:
        from matplotlib.lines import Line2D

        names = [shortened(region.name, _LONGEST_NAME) for region in self.regions]
        legend = self.figure.legend(
            handles=[Line2D([], [], linestyle="none") for _ in names],
            labels=[f"{number}  {name}" for number, name in enumerate(names, start=1)],
            loc="upper right",
            ncols=ceil(len(names) / _NAMES_IN_COLUMN),
            fontsize=SMALL_SIZE,
            handlelength=0,
            handletextpad=0,
            frameon=False,
        )
        taken_literally(legend)


def _fits(region: Roi, points_per_px: float) -> bool:
    """Whether the name of a region fits in it."""
    left, top, right, bottom = region.bounds
    wide, high = (_NAME_SIZE * size / points_per_px for size in _CHARACTER)
    return len(shortened(region.name, _LONGEST_NAME)) * wide < right - left and high < bottom - top


def drawn_pixels(luminance: LuminanceMap) -> tuple[NDArray[np.float64], int]:
    """Return a map downsampled to a figure's resolution, and the number of camera pixels per drawn pixel."""
    side = reduction(luminance.shape)
    return block_mean(np.asarray(luminance.luminance_cd_m2), side), side * luminance.step
