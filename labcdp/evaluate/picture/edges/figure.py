"""A contrast map as a figure: the image in grey, its edges coloured by CDP, and their values under the pointer."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ....core.quantity import Z_95
from ....report.drawing import DPI, add_legend, block_mean, png
from ....report.html import interactive
from ....report.layout import Script
from ....report.maps import ImageFigure
from ....report.text import percent, shortened
from ..converter import PictureSource
from .edges import EdgeKind
from .map import ContrastMap

if TYPE_CHECKING:
    from matplotlib.colors import LinearSegmentedColormap
    from plotly.graph_objects import Scatter

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
        Which ones.
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

    def text(self, found: ContrastMap) -> str:
        """Return the entry in a legend, with the number of edges."""
        asked = found.settings
        meaning = self.meaning.format(least=percent(asked.minimum_contrast), detected=f"{asked.detected:g}")
        return f"{meaning}: {found.count(*self.kinds)}"


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


def overlay(found: ContrastMap) -> NDArray[np.uint8]:
    """Draw the image in grey on a logarithmic scale with its edges; edges that are noise are not drawn.

    Returns
    -------
    ndarray of uint8, shape (height, width, 3)
        Its colours; a small image is enlarged, and a large one reduced.
    """
    longest = max(found.luminance.shape)
    side, zoom = ceil(longest / _LONGEST_SIDE), min(max(_LONGEST_SIDE // longest, 1), _MOST_ZOOM)
    rgb = _grey(found.luminance.luminance_cd_m2, side).repeat(zoom, axis=0).repeat(zoom, axis=1)
    for style in STYLES:
        _paint(rgb, found, zoom / side, style)
    return rgb


def overlay_figure(found: ContrastMap, drawn: NDArray[np.uint8], title: str, simulated: bool) -> bytes:
    """Draw the overlay with scale and legend, as PNG."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.lines import Line2D

    title = f"Contrast detection probability at the edges of {shortened(title, 40)}"
    figure = ImageFigure.of(found.luminance, title, simulated, below_in=_LEGEND_IN)
    # Fine lines need more pixels than a page has.
    figure.figure.set_dpi(1.5 * DPI)
    figure.axes.imshow(drawn, extent=figure.extent, interpolation="antialiased")
    scale = ScalarMappable(Normalize(0, 1), colour_map(found.settings.detected))
    figure.add_scale(scale, f"CDP of edges with a contrast of at least {percent(found.settings.minimum_contrast)}")
    figure.bar.axhline(found.settings.detected, color="black", linewidth=1.5)
    figure.bar.set_yticks(sorted({0.0, 0.2, 0.4, 0.6, 0.8, 1.0, found.settings.detected}))
    entries = [(one.colour, (1.0, 1.0) if one.dotted else (), one.text(found)) for one in STYLES[::-1]]
    entries.append(("none", (), f"not drawn, in the noise: {found.count(EdgeKind.NOISE)}"))
    lines = [Line2D([], [], color=colour, linestyle=(0.0, dashes), linewidth=3) for colour, dashes, _ in entries]
    texts = [text for _, _, text in entries]
    add_legend(figure.figure, lines, texts, loc="lower center", ncols=2, facecolor="#8c8c8c", framealpha=1)
    return png(figure.figure)


def _grey(luminance: NDArray[np.floating[Any]], side: int) -> NDArray[np.uint8]:
    """Grey picture of the light, darker than it could be, so that the colours stand out."""
    values = np.nan_to_num(block_mean(np.asarray(luminance, dtype=np.float32), side), nan=0.0)
    lit = values[values > 0]
    dark, high = (float(one) for one in np.quantile(lit, (0.01, 0.999))) if lit.size else (0.0, 1.0)
    low = min(max(dark, high / 10**_DECADES), 0.5 * high)
    tone = np.log(np.clip(values, low, high) / low) / np.log(high / low)
    grey = np.round(20 + 170 * tone).astype(np.uint8)
    return np.repeat(grey[:, :, None], 3, axis=2)


def _paint(rgb: NDArray[np.uint8], found: ContrastMap, scale: float, style: EdgeStyle) -> None:
    """Paint the borders of some kinds of edges; `scale` drawn pixels stand for a pixel of the map."""
    from matplotlib.colors import to_rgb

    near = found.near
    sides = np.flatnonzero(found.of_kind(*style.kinds)[near.sides_pair])
    if style.by_cdp:
        # The lowest CDP of a drawn pixel is painted last.
        sides = sides[np.argsort(-found.edges.cdp[near.sides_pair[sides]], kind="stable")]
        cdp = found.edges.cdp[near.sides_pair[sides]]
        painted = np.round(255 * colour_map(found.settings.detected)(cdp)[:, :3])
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

#: Width of the drawing on a usual screen, and margins, in pixels; it is no higher than the screen.
_WIDTH, _BESIDE, _ABOVE, _HIGHEST = 1040, 90, 90, 600


def _layout_image(drawn: NDArray[np.uint8], size: tuple[int, int]) -> dict[str, Any]:
    import cv2

    _, data = cv2.imencode(".png", drawn[:, :, ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 6])
    picture = f"data:image/png;base64,{b64encode(data.tobytes()).decode()}"
    place = {"x": 0, "y": 0, "sizex": size[1], "sizey": size[0], "xref": "x", "yref": "y"}
    return {"source": picture, **place, "sizing": "stretch", "layer": "below"}


def edge_script(drawn: Drawn, source: PictureSource) -> Script:
    """Draw the map, of several contrasts one at a time."""
    from plotly.graph_objects import Figure

    found = next(iter(drawn))
    height, width = found.shape_px
    traces = {
        one: [trace for style in STYLES[::-1] if one.count(*style.kinds) for trace in _points(one, source, style)]
        for one in drawn
    }
    images = {one: [_layout_image(picture, found.shape_px)] for one, picture in drawn.items()}
    figure = Figure(layout={"images": images[found]})
    if len(drawn) > 1:
        buttons = [
            {
                "label": f"target contrast {percent(chosen.contrast or 0)}",
                "method": "update",
                "args": [
                    {"visible": [one is chosen and trace.visible for one in drawn for trace in traces[one]]},
                    {"images": images[chosen]},
                ],
            }
            for chosen in drawn
        ]
        menu = {"buttons": buttons, "x": 0, "xanchor": "left", "y": 1.12, "yanchor": "bottom"}
        figure.update_layout(updatemenus=[menu])
    for one in drawn:
        figure.add_traces([trace if one is found else trace.update(visible=False) for trace in traces[one]])
    figure.update_xaxes(title="x in pixels", range=[0, width], showgrid=False, zeroline=False, constrain="domain")
    figure.update_yaxes(
        title="y in pixels", range=[height, 0], showgrid=False, zeroline=False, scaleanchor="x", constrain="domain"
    )
    scale = [list(pair) for pair in colours(found.settings.detected)]
    legend = {"orientation": "h", "y": 1.02, "yanchor": "bottom", "bgcolor": "#c8c8c8", "itemsizing": "constant"}
    figure.update_layout(
        margin={"t": 50 if len(drawn) == 1 else 110, "r": 20},
        height=min(round(_ABOVE + (_WIDTH - _BESIDE) * max(height / width, 0.3)), _HIGHEST),
        hovermode="closest",
        dragmode="pan",
        legend=legend,
        coloraxis={"colorscale": scale, "cmin": 0, "cmax": 1, "colorbar": {"title": "CDP"}},
    )
    return interactive(figure, scroll_zoom=True)


def _points(found: ContrastMap, source: PictureSource, style: EdgeStyle) -> list[Scatter]:
    """Make a point with a tooltip in the middle of each edge of some kinds, and their entry in the legend."""
    from plotly.graph_objects import Scatter

    edges, mean, step = found.edges, found.regions.mean, found.luminance.step
    chosen = np.flatnonzero(found.of_kind(*style.kinds))
    chosen = chosen[np.argsort(-edges.border_px[chosen], kind="stable")][:_MOST_POINTS]

    def rounded(values: NDArray[Any], n_decimals: int) -> NDArray[np.float64]:
        return np.asarray(np.round(values[chosen], n_decimals), dtype=np.float64)

    marker: dict[str, Any] = {"size": 5, "line": {"width": 0.5, "color": "#222222"}}
    marker |= {"color": rounded(edges.cdp, 3), "coloraxis": "coloraxis"} if style.by_cdp else {"color": style.colour}
    unit = "(relative)" if source.unit == "relative" else "cd/m²"
    rows = [
        f"bright side %{{customdata[0]:.4~g}} {unit}",
        f"dark side %{{customdata[1]:.4~g}} {unit}",
        "contrast %{customdata[2]:.1f} % ± %{customdata[3]:.1f} % (95 %)",
        "border %{customdata[7]} pixels at x %{x:.0f}, y %{y:.0f}",
    ]
    if np.isfinite(edges.cdp[chosen]).any():
        rows.insert(3, "CDP %{customdata[4]:.3f} (95 %: %{customdata[5]:.3f} to %{customdata[6]:.3f})")
    shown = [
        mean[edges.bright[chosen]],
        mean[edges.dark[chosen]],
        rounded(100 * edges.contrast, 2),
        rounded(100 * Z_95 * edges.contrast_standard_uncertainty, 2),
        *(rounded(values, 4) for values in (edges.cdp, edges.cdp_low, edges.cdp_high)),
        edges.border_px[chosen] * step,
    ]
    # Faint edges can be many; a click on the legend shows them.
    visible = "legendonly" if EdgeKind.FAINT in style.kinds else True
    name = style.text(found)
    alike = {"mode": "markers", "name": name, "legendgroup": name, "visible": visible}
    points = Scatter(
        x=rounded(edges.middle_px[:, 0] * step, 1),
        y=rounded(edges.middle_px[:, 1] * step, 1),
        showlegend=False,
        marker=marker,
        customdata=np.stack(shown, axis=1).astype(np.float64),
        hovertemplate="<br>".join(rows) + "<extra></extra>",
        **alike,
    )
    # A scale of colours has none of its own in the legend.
    return [points, Scatter(x=[None], y=[None], marker={"size": 11, "color": style.colour}, **alike)]
