"""A contrast map as a figure: the image in grey, its edges coloured by CDP, and their values under the pointer."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil, nan
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ....core.quantity import Z_95
from ....report.drawing import DPI, add_legend, block_mean, png
from ....report.html import interactive
from ....report.layout import Script
from ....report.maps import add_scale, image_extent, image_figure
from ....report.text import percent, shortened
from ..converter import PictureSource
from .edges import EdgeKind
from .map import ContrastMap

if TYPE_CHECKING:
    from bokeh.models import LinearColorMapper
    from matplotlib.colors import LinearSegmentedColormap

#: Colours of a CDP of 0 and of 1: lost is warm, detected is cold, distinguishable for colour-blind readers too.
_LOST, _DETECTED = "#D55E00", "#0072B2"

#: Longest side of the drawn overlay, and how many times larger than it is a small image is drawn at the most.
_LONGEST_SIDE, _MOST_ZOOM = 1600, 4
#: Room for the legend, in inches.
_LEGEND_IN = 0.9

#: Darkest grey over the brightest is at least 10 to the power of minus this, in light.
_DECADES = 4

#: Dotted line: number of drawn pixels, and period.
_DOT, _PERIOD = 3, 6


@dataclass(frozen=True)
class EdgeStyle:
    """How some kinds of edges are drawn.

    Parameters
    ----------
    kinds : tuple of EdgeKind
        Kinds of edges drawn in this style.
    meaning : str
        What they are, for legends; with the minimum contrast and the CDP of a detected edge to be filled in.
    colour : str
        Their colour; that of the legend alone, where `by_cdp`.
    by_cdp : bool
        Whether each is drawn in the colour of its CDP, as a wide line.
    dotted : bool
        Whether lines are dotted.
    opacity : float
        Of the lines.
    """

    kinds: tuple[EdgeKind, ...]
    meaning: str
    colour: str
    by_cdp: bool = False
    dotted: bool = False
    opacity: float = 1.0

    def text(self, edge_map: ContrastMap) -> str:
        """Return the entry in a legend, with the number of edges."""
        settings = edge_map.settings
        meaning = self.meaning.format(least=percent(settings.minimum_contrast), detected=f"{settings.detected:g}")
        return f"{meaning}: {edge_map.count(*self.kinds)}"


#: What is painted later covers what is below; the lost edges must not be missed.
STYLES = (
    EdgeStyle((EdgeKind.FAINT,), "contrast below {least}", "#FFFFFF", opacity=0.4),
    EdgeStyle((EdgeKind.UNEVEN,), "a region is not uniform", "#44DD88", dotted=True),
    EdgeStyle((EdgeKind.BLACK, EdgeKind.SATURATED), "saturated or black", "#F781BF", dotted=True),
    EdgeStyle((EdgeKind.SEEN,), "detected, CDP {detected} or more", _DETECTED, by_cdp=True),
    EdgeStyle((EdgeKind.LOST,), "lost, CDP below {detected}", _LOST, by_cdp=True),
)


def colours(detected: float) -> list[tuple[float, str]]:
    """Return CDPs from 0 to 1 with their colours, warm up to the smallest CDP that counts as detected."""
    limit = min(detected, 0.999)
    return [(0.0, _LOST), (0.6 * limit, "#F0A030"), (limit, "#F7E96B"), (limit, "#7FC8F0"), (1.0, _DETECTED)]


def colour_map(detected: float) -> LinearSegmentedColormap:
    """Colours of a CDP of 0 to 1."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("cdp", colours(detected), N=1000)


def overlay(edge_map: ContrastMap) -> NDArray[np.uint8]:
    """Draw the image in grey on a logarithmic scale with its edges; edges that are noise are not drawn.

    Returns
    -------
    ndarray of uint8, shape (height, width, 3)
        Its colours; a small image is enlarged, and a large one reduced.
    """
    longest = max(edge_map.luminance.shape)
    side, zoom = ceil(longest / _LONGEST_SIDE), min(max(_LONGEST_SIDE // longest, 1), _MOST_ZOOM)
    rgb = _grey(edge_map.luminance.luminance_cd_m2, side).repeat(zoom, axis=0).repeat(zoom, axis=1)
    for style in STYLES:
        _paint(rgb, edge_map, zoom / side, style)
    return rgb


def overlay_figure(edge_map: ContrastMap, drawn: NDArray[np.uint8], title: str, simulated: bool) -> bytes:
    """Draw the overlay with scale and legend, as PNG."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.lines import Line2D

    title = f"Contrast detection probability at the edges of {shortened(title, 40)}"
    figure = image_figure(edge_map.luminance, title, simulated, below_in=_LEGEND_IN)
    # Fine lines need more pixels than a page has.
    figure.set_dpi(1.5 * DPI)
    axes, bar = figure.axes
    axes.imshow(drawn, extent=image_extent(edge_map.luminance), interpolation="antialiased")
    scale = ScalarMappable(Normalize(0, 1), colour_map(edge_map.settings.detected))
    add_scale(figure, scale, f"CDP of edges with a contrast of at least {percent(edge_map.settings.minimum_contrast)}")
    bar.axhline(edge_map.settings.detected, color="black", linewidth=1.5)
    bar.set_yticks(sorted({0.0, 0.2, 0.4, 0.6, 0.8, 1.0, edge_map.settings.detected}))
    entries = [(style.colour, (1.0, 1.0) if style.dotted else (), style.text(edge_map)) for style in STYLES[::-1]]
    entries.append(("none", (), f"not drawn, in the noise: {edge_map.count(EdgeKind.NOISE)}"))
    lines = [Line2D([], [], color=colour, linestyle=(0.0, dashes), linewidth=3) for colour, dashes, _ in entries]
    texts = [text for _, _, text in entries]
    add_legend(figure, lines, texts, loc="lower center", ncols=2, facecolor="#8c8c8c", framealpha=1)
    return png(figure)


def _grey(luminance: NDArray[np.floating[Any]], side: int) -> NDArray[np.uint8]:
    """Grey picture of the light, darker than it could be, so that the colours stand out."""
    values = np.nan_to_num(block_mean(np.asarray(luminance, dtype=np.float32), side), nan=0.0)
    lit = values[values > 0]
    dark, high = (float(value) for value in np.quantile(lit, (0.01, 0.999))) if lit.size else (0.0, 1.0)
    low = min(max(dark, high / 10**_DECADES), 0.5 * high)
    tone = np.log(np.clip(values, low, high) / low) / np.log(high / low)
    grey = np.round(20 + 170 * tone).astype(np.uint8)
    return np.repeat(grey[:, :, None], 3, axis=2)


def _paint(rgb: NDArray[np.uint8], edge_map: ContrastMap, scale: float, style: EdgeStyle) -> None:
    """Paint the borders of some kinds of edges; `scale` drawn pixels stand for a pixel of the map."""
    from matplotlib.colors import to_rgb

    near = edge_map.near
    sides = np.flatnonzero(edge_map.mask_of_kinds(*style.kinds)[near.sides_pair])
    if style.by_cdp:
        # The lowest CDP of a drawn pixel is painted last.
        sides = sides[np.argsort(-edge_map.edges.cdp[near.sides_pair[sides]], kind="stable")]
        cdp = edge_map.edges.cdp[near.sides_pair[sides]]
        painted = np.round(255 * colour_map(edge_map.settings.detected)(cdp)[:, :3])
    else:
        painted = np.broadcast_to(np.round(255 * np.array(to_rgb(style.colour))), (sides.size, 3))
    wide = range(-1 if style.by_cdp else 0, 1)
    for x, y in _along(near.sides_px[sides], scale):
        shown = (x + y) % _PERIOD < _DOT if style.dotted else np.full(x.size, True)
        for dy in wide:
            for dx in wide:
                rows, columns = np.maximum(y[shown] + dy, 0), np.maximum(x[shown] + dx, 0)
                below = rgb[rows, columns]
                rgb[rows, columns] = np.round(style.opacity * painted[shown] + (1 - style.opacity) * below)


def _along(places: NDArray[np.float32], scale: float) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Yield the drawn pixels (x, y) of sides of pixels; several where `scale` drawn pixels stand for one."""
    n = max(round(scale), 1)
    # A side between two columns has a whole number as x.
    upright = places[:, 0] == np.floor(places[:, 0])
    for number in range(n):
        off = (number + 0.5) / n - 0.5
        x, y = places[:, 0] + np.where(upright, 0, off), places[:, 1] + np.where(upright, off, 0)
        yield (x * scale).astype(np.intp), (y * scale).astype(np.intp)


#: Overlays, shape (height, width, 3), by the map at a contrast.
Drawn: TypeAlias = dict[ContrastMap, NDArray[np.uint8]]

#: Points under the pointer of one kind; more would make the page slow. The longest borders are kept.
_MOST_POINTS = 6000

#: Width of the drawing on a usual screen, what stands beside the picture, and its largest height, in pixels.
_WIDTH, _BESIDE, _HIGHEST = 1040, 130, 520


def _picture_url(drawn: NDArray[np.uint8]) -> str:
    import cv2

    _, data = cv2.imencode(".png", drawn[:, :, ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 6])
    return f"data:image/png;base64,{b64encode(data.tobytes()).decode()}"


def edge_script(drawn: Drawn, source: PictureSource) -> Script:
    """Draw the map, of several contrasts one at a time."""
    from bokeh.layouts import column
    from bokeh.models import BasicTicker, ColorBar, CustomJS, LinearColorMapper, Select

    first = next(iter(drawn))
    plot = _empty_figure(first.shape_px)
    mapper = LinearColorMapper(palette=_palette(first.settings.detected), low=0, high=1)
    groups = [
        [_add_picture(plot, picture, edge_map.shape_px), *_add_points(plot, edge_map, source, mapper)]
        for edge_map, picture in drawn.items()
    ]
    scale = ColorBar(color_mapper=mapper, title="CDP", ticker=BasicTicker(desired_num_ticks=6), width=16)
    scale.title_text_font_style = "normal"
    plot.add_layout(scale, "right")
    if len(drawn) == 1:
        return interactive(plot)
    # Faint edges stay hidden when their contrast is chosen: a click on the legend shows them.
    visible = [[bool(model.visible) for model in models] for models in groups]
    for models in groups[1:]:
        for model in models:
            model.visible = False
    code = (
        "groups.forEach((models, i) => models.forEach((model, k) =>"
        " (model.visible = `${i}` === cb_obj.value && visible[i][k])))"
    )
    options = [(f"{i}", f"target contrast {percent(edge_map.contrast or 0)}") for i, edge_map in enumerate(drawn)]
    chosen = Select(options=options, value="0", title="Shown", sizing_mode="stretch_width", max_width=400)
    chosen.js_on_change("value", CustomJS(args={"groups": groups, "visible": visible}, code=code))
    return interactive(column([chosen, plot], sizing_mode="stretch_width"))


def _empty_figure(shape_px: tuple[int, int]) -> Any:
    """Return a figure with the axes of the picture, as large as a usual screen shows it."""
    from bokeh.models import CustomJS, Legend, Range1d
    from bokeh.plotting import figure

    height, width = shape_px
    drawn_height = min(round((_WIDTH - _BESIDE) * height / width), _HIGHEST)
    plot = figure(
        x_range=Range1d(0, width),
        y_range=Range1d(height, 0),
        sizing_mode="stretch_width",
        frame_height=drawn_height,
        max_width=round(_BESIDE + drawn_height * width / height),
        tools="pan,wheel_zoom,box_zoom,reset,save",
        active_scroll="wheel_zoom",
        toolbar_location="below",
        x_axis_label="x in pixels",
        y_axis_label="y in pixels",
    )
    plot.toolbar.logo = None
    plot.grid.visible = False
    plot.axis.axis_label_text_font_style = "normal"
    # Pixels stay square on a narrow screen.
    code = "cb_obj.frame_height = Math.round((cb_obj.inner_width * height) / width)"
    plot.js_on_change("inner_width", CustomJS(args={"height": height, "width": width}, code=code))
    legend = Legend(click_policy="hide", location="left", background_fill_color="#c8c8c8", padding=4)
    plot.add_layout(legend, "above")
    return plot


def _palette(detected: float) -> list[str]:
    from matplotlib.colors import to_hex

    return [to_hex(colour) for colour in colour_map(detected)(np.linspace(0, 1, 256))]


def _add_picture(plot: Any, picture: NDArray[np.uint8], shape_px: tuple[int, int]) -> Any:
    height, width = shape_px
    return plot.image_url(url=[_picture_url(picture)], x=0, y=0, w=width, h=height, anchor="top_left")


def _add_points(plot: Any, edge_map: ContrastMap, source: PictureSource, mapper: LinearColorMapper) -> Iterator[Any]:
    """Add points with a tooltip in the middle of each edge, one kind at a time, and their entries in the legend."""
    from bokeh.models import HoverTool, LegendItem

    for style in reversed(STYLES):
        if not edge_map.count(*style.kinds):
            continue
        name, data = style.text(edge_map), _points(edge_map, style)
        colour: Any = {"field": "cdp", "transform": mapper} if style.by_cdp else style.colour
        points = plot.scatter("x", "y", source=data, size=6, fill_color=colour, line_color="#222222", line_width=0.5)
        points.visible = EdgeKind.FAINT not in style.kinds
        known = bool(np.isfinite(data["cdp"]).any())
        tooltips = _tooltips("(relative)" if source.unit == "relative" else "cd/m²", with_cdp=known)
        plot.add_tools(HoverTool(renderers=[points], tooltips=tooltips, visible=False, attachment="horizontal"))
        # A scale of colours has none of its own in the legend.
        entry = plot.scatter([nan], [nan], size=11, color=style.colour)
        entry.visible = points.visible
        entry.js_link("visible", points, "visible")
        item = LegendItem(label={"value": name}, renderers=[entry])
        plot.legend[0].items.append(item)
        yield points
        yield entry
        yield item


def _tooltips(unit: str, with_cdp: bool) -> list[tuple[str, str]]:
    rows = [
        ("bright side", f"@bright{{0.[000]}} {unit}"),
        ("dark side", f"@dark{{0.[000]}} {unit}"),
        ("contrast", "@contrast{0.0} % ± @expanded{0.0} % (95 %)"),
        ("border", "@border pixels at x @x{0}, y @y{0}"),
    ]
    if with_cdp:
        rows.insert(3, ("CDP", "@cdp{0.000} (95 %: @low{0.000} to @high{0.000})"))
    return rows


def _points(edge_map: ContrastMap, style: EdgeStyle) -> dict[str, NDArray[Any]]:
    """Return places and values of the edges of some kinds, the longest of many."""
    edges, mean, step = edge_map.edges, edge_map.regions.mean, edge_map.luminance.step
    chosen = np.flatnonzero(edge_map.mask_of_kinds(*style.kinds))
    chosen = chosen[np.argsort(-edges.border_px[chosen], kind="stable")][:_MOST_POINTS]

    def rounded(values: NDArray[Any], n_decimals: int) -> NDArray[np.float64]:
        return np.asarray(np.round(values[chosen], n_decimals), dtype=np.float64)

    return {
        "x": rounded(edges.middle_px[:, 0] * step, 1),
        "y": rounded(edges.middle_px[:, 1] * step, 1),
        "bright": mean[edges.bright[chosen]],
        "dark": mean[edges.dark[chosen]],
        "contrast": rounded(100 * edges.contrast, 2),
        "expanded": rounded(100 * Z_95 * edges.contrast_standard_uncertainty, 2),
        "cdp": rounded(edges.cdp, 3),
        "low": rounded(edges.cdp_low, 4),
        "high": rounded(edges.cdp_high, 4),
        "border": edges.border_px[chosen] * step,
    }
