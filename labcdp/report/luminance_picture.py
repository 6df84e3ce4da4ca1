"""A luminance map as a picture with a scale."""

from __future__ import annotations

import numpy as np

from ..luminance import Invalid, LuminanceMap
from .drawing import LABEL_SIZE, SMALL_SIZE, VERMILLION, block_mean, label, new_figure, plain_numbers, png, reduction

#: Darkest colour of the scale over the brightest: what is below is shown as the darkest.
_DECADES = 5
_WIDTH_IN = 8.0


def luminance_picture(luminance: LuminanceMap, title: str, simulated: bool) -> bytes:
    """Draw a map in false colours on a logarithmic scale, as PNG; saturated pixels are in red.

    Parameters
    ----------
    luminance : LuminanceMap
        The map.
    title : str
        What stands above.
    simulated : bool
        Whether the camera was simulated, which the picture then says.
    """
    from matplotlib.colors import ListedColormap, LogNorm

    values = np.asarray(luminance.luminance_cd_m2, dtype=float)
    height, width = values.shape
    side = reduction((height, width))
    drawn = block_mean(values, side)
    lit = drawn[drawn > 0]
    high = float(lit.max()) if lit.size else 1.0
    low = max(float(np.quantile(lit, 0.001)) if lit.size else 0.0, high / 10**_DECADES)
    low = min(low, 0.5 * high)
    figure = new_figure(_WIDTH_IN, 1.1 + (_WIDTH_IN - 1.7) * min(max(height / width, 0.3), 1.5), simulated)
    axes = figure.add_subplot()
    label(axes, "x in pixels", "y in pixels", title)
    extent = (0.0, float(width * luminance.step), float(height * luminance.step), 0.0)
    picture = axes.imshow(np.clip(drawn, low, high), cmap="viridis", norm=LogNorm(low, high), extent=extent)
    bar = figure.colorbar(picture, ax=axes, extend="min")
    bar.set_label("luminance in cd/m²", fontsize=LABEL_SIZE)
    bar.ax.tick_params(labelsize=SMALL_SIZE)
    plain_numbers(bar.ax.yaxis)
    saturated = block_mean(np.not_equal(luminance.invalid & Invalid.SATURATED, 0), side) > 0
    if saturated.any():
        shown = np.ma.masked_where(~saturated, np.ones(saturated.shape))
        axes.imshow(shown, cmap=ListedColormap([VERMILLION]), extent=extent, interpolation="nearest")
        axes.set_title(f"{title}; red: saturated", fontsize=LABEL_SIZE, parse_math=False)
    return png(figure)
