"""A contrast map as an interactive figure: the overlay, and the values of an edge under the pointer."""

from __future__ import annotations

from base64 import b64encode
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ....core.table import Z_95
from ....report.html import interactive
from ....report.layout import Script
from ....report.text import percent
from ..conversion import PictureSource
from .edges import EdgeKind
from .figure import STYLES, EdgeStyle, colours
from .map import ContrastMap

if TYPE_CHECKING:
    from plotly.graph_objects import Scatter

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
    legend = {"orientation": "h", "x": 0, "y": 1.0, "yanchor": "bottom", "bgcolor": "#c8c8c8", "itemsizing": "constant"}
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
