"""A contrast map as an interactive HTML page that needs nothing else, not even a network."""

from __future__ import annotations

from base64 import b64encode
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..evaluate.contrast_map_edges import EdgeKind
from .contrast_map_figure import COLOURS, FAINT_COLOUR, UNEVEN_COLOUR, UNMEASURABLE_COLOUR, Overlay
from .contrast_map_wording import MapSource, result_text, settings_facts, weakest_table
from .digits import percent, printable
from .page import page_environment

if TYPE_CHECKING:
    from plotly.graph_objects import Figure, Scatter

    from ..evaluate.contrast_map import ContrastMap

_FONT = 'system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, "Liberation Sans", sans-serif'

#: Points under the pointer of one kind; more would make the page slow. The longest borders are kept.
_MOST_POINTS = 6000

#: Width of the drawing on a usual screen, and room beside and above it, in pixels.
_WIDTH, _BESIDE, _ABOVE = 1040, 90, 90


def contrast_map_page(found: ContrastMap, drawn: Overlay, source: MapSource) -> str:
    """Write a contrast map as a page: the overlay, and under the pointer both luminances, contrast and CDP of an edge.

    Parameters
    ----------
    found : ContrastMap
        The map.
    drawn : Overlay
        Its overlay.
    source : MapSource
        Where it comes from.

    Returns
    -------
    str
        HTML 5, with the drawing program (plotly.js, 4.8 MB) inside; its security policy forbids to load anything.
    """
    from markupsafe import Markup

    # plotly's own button would send the map to its makers' servers.
    config = {"displaylogo": False, "responsive": True, "showSendToCloud": False, "scrollZoom": True}
    figure = _figure(found, drawn, source).to_html(full_html=False, include_plotlyjs=True, div_id="map", config=config)
    return (
        page_environment()
        .get_template("contrast_map.html")
        .render(
            kind="labcdp: contrast detection probability (CDP) at the edges of an image",
            title=printable(source.file),
            banner="The camera is simulated." if source.simulated else "",
            result=result_text(found),
            warnings=[*source.warnings, *found.warnings],
            figure=Markup(figure),  # noqa: S704 - plotly's own output of numbers and fixed texts
            weakest=weakest_table(found, source),
            facts=settings_facts(found, source),
        )
    )


def _figure(found: ContrastMap, drawn: Overlay, source: MapSource) -> Figure:
    from plotly.graph_objects import Figure

    width, height = drawn.extent_px
    least = percent(found.settings.minimum_contrast)
    groups = [
        ((EdgeKind.LOST,), "lost", COLOURS[0][1]),
        ((EdgeKind.SEEN,), "detected", COLOURS[-1][1]),
        ((EdgeKind.FAINT,), f"contrast below {least}", FAINT_COLOUR),
        ((EdgeKind.UNEVEN,), "not uniform", UNEVEN_COLOUR),
        ((EdgeKind.SATURATED, EdgeKind.BLACK), "saturated or black", UNMEASURABLE_COLOUR),
    ]
    figure = Figure()
    for kinds, name, colour in groups:
        if found.count(*kinds):
            figure.add_traces(_points(found, source, kinds, f"{name} ({found.count(*kinds)})", colour))
    figure.add_layout_image(
        source=_data_uri(drawn.rgb),
        x=0,
        y=0,
        sizex=width,
        sizey=height,
        xref="x",
        yref="y",
        sizing="stretch",
        layer="below",
    )
    figure.update_xaxes(title="x in pixels", range=[0, width], showgrid=False, zeroline=False, constrain="domain")
    figure.update_yaxes(
        title="y in pixels", range=[height, 0], showgrid=False, zeroline=False, scaleanchor="x", constrain="domain"
    )
    figure.update_layout(
        template="plotly_white",
        font_family=_FONT,
        margin={"t": 50, "r": 20},
        height=round(_ABOVE + (_WIDTH - _BESIDE) * min(max(height / width, 0.3), 1.5)),
        hovermode="closest",
        dragmode="pan",
        legend={
            "orientation": "h",
            "x": 0,
            "y": 1.0,
            "yanchor": "bottom",
            "bgcolor": "#c8c8c8",
            "itemsizing": "constant",
        },
        coloraxis={
            "colorscale": [list(pair) for pair in COLOURS],
            "cmin": 0,
            "cmax": 1,
            "colorbar": {"title": "CDP"},
        },
    )
    return figure


def _points(
    found: ContrastMap, source: MapSource, kinds: tuple[EdgeKind, ...], name: str, colour: str
) -> list[Scatter]:
    """Make a point in the middle of each edge of some kinds, which tells of it, and their entry in the legend."""
    from plotly.graph_objects import Scatter

    edges, step = found.edges, found.luminance.step
    chosen = np.flatnonzero(found.of_kind(*kinds))
    chosen = chosen[np.argsort(-edges.border_px[chosen], kind="stable")][:_MOST_POINTS]
    with_cdp = kinds[0] in (EdgeKind.LOST, EdgeKind.SEEN)
    marker: dict[str, Any] = {"size": 5, "line": {"width": 0.5, "color": "#222222"}}
    marker |= {"color": _rounded(edges.cdp[chosen], 3), "coloraxis": "coloraxis"} if with_cdp else {"color": colour}
    # Faint edges can be many; a click on the legend shows them.
    shown = "legendonly" if EdgeKind.FAINT in kinds else True
    unit = source.shown_unit
    rows = [
        f"bright side %{{customdata[0]:.4~g}} {unit}",
        f"dark side %{{customdata[1]:.4~g}} {unit}",
        "contrast %{customdata[2]:.1f} % ± %{customdata[3]:.1f} % (95 %)",
        "CDP %{customdata[4]:.3f} (95 %: %{customdata[5]:.3f} to %{customdata[6]:.3f})"
        if np.isfinite(edges.cdp[chosen]).any()
        else "",
        "border %{customdata[7]} pixels at x %{x:.0f}, y %{y:.0f}",
    ]
    points = Scatter(
        x=_rounded(edges.middle_px[chosen, 0] * step, 1),
        y=_rounded(edges.middle_px[chosen, 1] * step, 1),
        mode="markers",
        name=name,
        legendgroup=name,
        showlegend=False,
        visible=shown,
        marker=marker,
        customdata=_hover(found, chosen),
        hovertemplate="<br>".join(row for row in rows if row) + "<extra></extra>",
    )
    # A scale of colours has none of its own in the legend.
    entry = Scatter(
        x=[None],
        y=[None],
        mode="markers",
        name=name,
        legendgroup=name,
        visible=shown,
        marker={"size": 11, "color": colour},
    )
    return [points, entry]


def _hover(found: ContrastMap, chosen: NDArray[np.intp]) -> NDArray[np.float64]:
    edges, mean = found.edges, found.regions.mean
    columns = [
        mean[edges.bright[chosen]],
        mean[edges.dark[chosen]],
        _rounded(100 * edges.contrast[chosen], 2),
        _rounded(196 * edges.contrast_standard_uncertainty[chosen], 2),
        *(_rounded(values[chosen], 4) for values in (edges.cdp, edges.cdp_low, edges.cdp_high)),
        edges.border_px[chosen] * found.luminance.step,
    ]
    return np.stack(columns, axis=1).astype(np.float64)


def _rounded(values: NDArray[np.floating[Any]], n_decimals: int) -> NDArray[np.float64]:
    return np.array(np.round(values.astype(np.float64), n_decimals), dtype=np.float64)


def _data_uri(rgb: NDArray[np.uint8]) -> str:
    import cv2

    _, data = cv2.imencode(".png", rgb[:, :, ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 6])
    return f"data:image/png;base64,{b64encode(data.tobytes()).decode()}"
