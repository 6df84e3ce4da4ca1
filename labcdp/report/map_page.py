"""A map of CDP as an interactive HTML page that needs nothing else, not even a network."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..evaluate.map_axes import At, MapAxis, MapLayout, map_layout
from .digits import printable
from .map_page_curves import draw_page_curves
from .map_parts import axes_of, panels_of
from .map_plotly import axis_settings, escaped, hover_rows, hover_values
from .map_scales import cell_edges
from .map_wording import at_text, axis_label, conditions, notes, provenance, shown, title
from .page import page_environment

if TYPE_CHECKING:
    from plotly.graph_objects import Figure
    from xarray import Dataset

    from ..evaluate.maps import MapAnalysis


#: Dashes of the isolines, in rising order of their levels.
_DASHES = ("dot", "solid", "dash")

_FONT = 'system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, "Liberation Sans", sans-serif'


def map_page(dataset: Dataset, analysis: MapAnalysis) -> str:
    """Draw a map as an interactive page: all variables of a cell under the pointer, isolines and curves to switch.

    Parameters
    ----------
    dataset : xarray.Dataset
        The map.
    analysis : MapAnalysis
        Of the same map.

    Returns
    -------
    str
        HTML 5, with the drawing program (plotly.js, 4.8 MB) inside; its security policy forbids to load anything.

    Raises
    ------
    InputError
        If more than 12 heat maps or 8 curves would be needed.
    """
    from markupsafe import Markup

    layout, axes = map_layout(dataset), axes_of(dataset)
    draw = draw_page_curves if layout.y is None else _heat_maps
    figure = draw(dataset, analysis, layout, axes)
    figure.update_layout(template="plotly_white", font_family=_FONT, margin={"t": 50, "r": 20})
    # plotly's own button would send the map to its makers' servers.
    config = {"displaylogo": False, "responsive": True, "showSendToCloud": False}
    drawn = figure.to_html(full_html=False, include_plotlyjs=True, div_id="map", config=config)
    return (
        page_environment()
        .get_template("map.html")
        .render(
            kind="labcdp: map of contrast detection probability of a simulated chain",
            title=title(dataset),
            conditions=conditions(dataset),
            figure=Markup(drawn),  # noqa: S704 - plotly's own output, whose texts are escaped below
            notes=notes(analysis, axes),
            facts=provenance(dataset),
            chain="\n".join(printable(line) for line in str(dataset.attrs.get("chain", "")).splitlines()),
        )
    )


def _heat_maps(dataset: Dataset, analysis: MapAnalysis, layout: MapLayout, axes: dict[str, MapAxis]) -> Figure:
    """Draw one heat map for each section, of which one is shown at a time."""
    from plotly.graph_objects import Figure

    assert layout.y is not None
    panels = panels_of(dataset, layout)
    figure = Figure()
    owners = []
    for number, (at, section) in enumerate(panels):
        traces = [_heat_map(section, layout.x, layout.y), *_lines(analysis, at, layout.x, layout.y)]
        for trace in traces:
            trace.visible = number == 0
        figure.add_traces(traces)
        owners += [number] * len(traces)
    if len(panels) > 1:
        buttons = [
            {
                "label": escaped(at_text(at, axes)),
                "method": "update",
                "args": [{"visible": [owner == number for owner in owners]}],
            }
            for number, (at, _) in enumerate(panels)
        ]
        menu = {"buttons": buttons, "x": 0, "xanchor": "left", "y": 1.02, "yanchor": "bottom"}
        figure.update_layout(updatemenus=[menu])
    figure.update_xaxes(**axis_settings(layout.x), showgrid=False)
    figure.update_yaxes(**axis_settings(layout.y), showgrid=False)
    # The legend below, as plotly's buttons are above; missing values are grey.
    figure.update_layout(height=620, legend={"orientation": "h", "x": 0, "y": -0.14}, plot_bgcolor="#d9d9d9")
    return figure


def _heat_map(section: Dataset, x: MapAxis, y: MapAxis) -> Any:
    from plotly.graph_objects import Heatmap

    names = list(map(str, section.data_vars))
    up, across = np.meshgrid(shown(y, y.values), shown(x, x.values), indexing="ij")
    cells = np.stack([across, up, *hover_values(section, names)], axis=-1)
    rows = [
        f"{escaped(axis_label(x))}: %{{customdata[0]:.5~g}}",
        f"{escaped(axis_label(y))}: %{{customdata[1]:.5~g}}",
        *hover_rows(section, names, first=2),
    ]
    return Heatmap(
        x=shown(x, cell_edges(x)),
        y=shown(y, cell_edges(y)),
        z=section["cdp"].values,
        zmin=0,
        zmax=1,
        colorscale="Viridis",
        colorbar={"title": "CDP"},
        customdata=cells,
        hovertemplate="<br>".join(rows) + "<extra></extra>",
        hoverongaps=False,
    )


def _lines(analysis: MapAnalysis, at: At, x: MapAxis, y: MapAxis) -> list[Any]:
    """Isolines of a section; those of one level are one trace, which the legend switches."""
    from plotly.graph_objects import Scatter

    traces = []
    for number, level in enumerate(sorted({line.level for line in analysis.isolines})):
        points: list[tuple[float | None, float | None]] = []
        for line in analysis.isolines:
            if line.at == at and line.level == level:
                points += [*zip(shown(x, line.x).tolist(), shown(y, line.y).tolist(), strict=True), (None, None)]
        traces.append(
            Scatter(
                x=[point[0] for point in points],
                y=[point[1] for point in points],
                mode="lines",
                line={"color": "black", "width": 1.5, "dash": _DASHES[number % len(_DASHES)]},
                name=f"CDP {level:g}",
                hoverinfo="skip",
            )
        )
    return traces
