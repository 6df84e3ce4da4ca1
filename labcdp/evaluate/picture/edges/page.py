"""A contrast map as an interactive page that needs nothing else, not even a network."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ....core.result import Result
from ....core.table import Z_95
from ....metrics import DetectionInterval, Epsilon
from ....output import Destination, write_files
from ....report.files import dataset_bytes, envelope_json
from ....report.html import interactive, render_page
from ....report.layout import Block, Card, Facts, Page, Section
from ....report.sheets import result_workbook
from ....report.text import percent, share_percent
from .edges import FALSE_ALARM, EdgeKind
from .figure import STYLES, EdgeStyle, colours, overlay, overlay_figure
from .map import ContrastMap
from .result import MapSource, contrast_map_dataset, edge_table

if TYPE_CHECKING:
    from plotly.graph_objects import Figure, Scatter

#: Points under the pointer of one kind; more would make the page slow. The longest borders are kept.
_MOST_POINTS = 6000

#: Width of the drawing on a usual screen, and margins, in pixels; it is no higher than the screen.
_WIDTH, _BESIDE, _ABOVE, _HIGHEST = 1040, 90, 90, 600
_OWN_CONTRAST = (
    "Each edge is asked for the contrast that it has in this image. The map shows where noise and texture hide such "
    "contrasts; it cannot show contrast that was lost before, as by a veil of glare or fog, or by blur. A reference "
    "image of the scene, or the contrast of its objects, shows that, too."
)
_ASKED = "Each edge is asked for a contrast of the scene: {asked}. Contrast that a veil or blur took counts as lost."
_HELP = (
    "Warm colours: the camera loses the edge. Point at a dot for the values of its edge. A click in the legend shows "
    "or hides dots; the wheel zooms, dragging moves."
)


#: Why a border is neither detected nor lost although its contrast is large enough.
_LEFT_OUT = {
    EdgeKind.UNEVEN: "of regions that are not uniform",
    EdgeKind.SATURATED: "of saturated regions",
    EdgeKind.NOISE: "not distinguishable from noise",
    EdgeKind.SMALL: "too short",
}


def write_contrast_map(found: ContrastMap, source: MapSource, result: Result, folder: Destination) -> list[Path]:
    """Write a contrast map with all that it shows, into a folder as `write_files` takes it.

    Returns
    -------
    list of Path
        report.html, contrast-map.png, results.xlsx with a row for each edge, results.nc and results.json.

    Raises
    ------
    InputError
        If the folder cannot be made or a file cannot be written.
    """
    drawn = overlay(found)
    edges = replace(result, tables=(result.table("summary"), edge_table(found, source)))
    files = {
        "report.html": map_page(found, drawn, source, result).encode(),
        "contrast-map.png": overlay_figure(found, drawn, source.file, source.simulated),
        "results.xlsx": result_workbook(edges, datetime.now(UTC)),
        "results.nc": dataset_bytes(contrast_map_dataset(found, source, result), "contrast map"),
        "results.json": envelope_json(result).encode(),
    }
    return write_files(folder, "image-map", files)


def map_page(found: ContrastMap, drawn: NDArray[np.uint8], source: MapSource, result: Result) -> str:
    """Return a contrast map as a page: the overlay, and under the pointer luminances, contrast and CDP of an edge.

    Parameters
    ----------
    found : ContrastMap
        The map.
    drawn : ndarray of uint8, shape (height, width, 3)
        Its overlay.
    source : MapSource
        What it was made from.
    result : Result
        Its numbers.

    Returns
    -------
    str
        HTML 5, with the drawing program (plotly.js, 4.8 MB) inside; its security policy forbids to load anything.
    """
    own = found.settings.contrast is None and not found.has_reference
    meaning = _OWN_CONTRAST if own else _ASKED.format(asked=_asked_text(found).rstrip(","))
    weakest: list[Block] = [result.table("weakest")] if len(result.table("weakest")) else []
    return render_page(
        Page.of(
            result,
            "Contrast detection probability (CDP) at the edges of an image",
            cards=_cards(found),
            lead=[interactive(_figure(found, drawn, source), scroll_zoom=True)],
            sections=[
                Section("", [meaning, _HELP, *weakest]),
                Section("All edges", [result.table("summary")]),
                Section("Settings and provenance", [_facts(found, source)], collapsed=True),
            ],
        )
    )


def _cards(found: ContrastMap) -> list[Card]:
    asked, least = found.settings, percent(found.settings.minimum_contrast)
    seen, lost = found.count(EdgeKind.SEEN), found.count(EdgeKind.LOST)
    if seen + lost == 0:
        none = Card("Detected edges", "none", f"No edge has a measurable contrast of at least {least}.")
        return [none, *_left_out(found)]
    of_length = f"{share_percent(1 - found.detected_border_share)} of their length"
    return [
        Card(
            "Detected edges", share_percent(found.detected_share), f"{seen} of {seen + lost} edges of objects",
            (f"contrast of at least {least}", f"CDP of at least {asked.detected:g}"), state="plain" if lost else "good",
        ),
        Card("Lost edges", str(lost), of_length, (f"CDP below {asked.detected:g}",), state="bad" if lost else "good"),
        *_left_out(found),
    ]  # fmt: skip


def _left_out(found: ContrastMap) -> Iterator[Card]:
    """Yield the card of the borders whose contrast is large enough and that are neither detected nor lost, and why."""
    high = found.edges.contrast >= found.settings.minimum_contrast
    counts = {why: int(np.count_nonzero(high & found.of_kind(kind))) for kind, why in _LEFT_OUT.items()}
    n = sum(counts.values())
    if n:
        lines = tuple(f"{count} {why}" for why, count in counts.items() if count)
        every = n + int(np.count_nonzero(high & found.of_kind(EdgeKind.SEEN, EdgeKind.LOST)))
        least = percent(found.settings.minimum_contrast)
        yield Card("Left out", f"{n} of {every}", f"borders of {least} or more", lines)


def _facts(found: ContrastMap, source: MapSource) -> Facts:
    asked, (height, width) = found.settings, found.shape_px
    chance = f"{percent(FALSE_ALARM)} probability of one false edge in the whole image"
    return Facts(
        [
            ("image", f"{source.file}, {width} x {height} pixels"),
            ("luminance", source.conversion),
            ("regions", f"{found.regions.mean.size} superpixels of about {asked.size_px} x {asked.size_px} pixels"),
            ("contrast that counts as detected", f"{_asked_text(found)} {_tolerance(asked.epsilon)}"),
            ("minimum contrast of an object", percent(asked.minimum_contrast)),
            ("significant contrast", f"{found.threshold_sigmas:.2f} standard uncertainties: {chance}"),
            ("SHA-256 of the image", source.sha256),
            *((one.role, f"{one.path} (SHA-256 {one.sha256})") for one in source.inputs),
        ]
    )


def _asked_text(found: ContrastMap) -> str:
    """Say which contrast edges are asked for."""
    if found.has_reference:
        return "that of the edge in the reference image"
    given = found.settings.contrast
    return "that of the edge in this image" if given is None else f"{percent(given)}, as given for the scene,"


def _tolerance(epsilon: Epsilon) -> str:
    """Write a tolerance as it stands behind a contrast."""
    if not isinstance(epsilon, DetectionInterval):
        return f"± {percent(epsilon)} of it"
    below = "and all below" if epsilon.below is None else f"- {percent(epsilon.below)}"
    above = "and all above" if epsilon.above is None else f"+ {percent(epsilon.above)}"
    return f"{below}, {above} of it"


def _figure(found: ContrastMap, drawn: NDArray[np.uint8], source: MapSource) -> Figure:
    import cv2
    from plotly.graph_objects import Figure

    height, width = found.shape_px
    _, data = cv2.imencode(".png", drawn[:, :, ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 6])
    picture = f"data:image/png;base64,{b64encode(data.tobytes()).decode()}"
    figure = Figure()
    for style in STYLES[::-1]:
        if found.count(*style.kinds):
            figure.add_traces(_points(found, source, style))
    figure.add_layout_image(
        source=picture, x=0, y=0, sizex=width, sizey=height, xref="x", yref="y", sizing="stretch", layer="below"
    )
    figure.update_xaxes(title="x in pixels", range=[0, width], showgrid=False, zeroline=False, constrain="domain")
    figure.update_yaxes(
        title="y in pixels", range=[height, 0], showgrid=False, zeroline=False, scaleanchor="x", constrain="domain"
    )
    scale = [list(pair) for pair in colours(found.settings.detected)]
    legend = {"orientation": "h", "x": 0, "y": 1.0, "yanchor": "bottom", "bgcolor": "#c8c8c8", "itemsizing": "constant"}
    figure.update_layout(
        margin={"t": 50, "r": 20},
        height=min(round(_ABOVE + (_WIDTH - _BESIDE) * max(height / width, 0.3)), _HIGHEST),
        hovermode="closest",
        dragmode="pan",
        legend=legend,
        coloraxis={"colorscale": scale, "cmin": 0, "cmax": 1, "colorbar": {"title": "CDP"}},
    )
    return figure


def _points(found: ContrastMap, source: MapSource, style: EdgeStyle) -> list[Scatter]:
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
