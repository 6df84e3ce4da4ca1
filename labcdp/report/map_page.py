"""A map of CDP as an interactive HTML page that needs nothing else, not even a network."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..evaluate.map_axes import At, MapAxis, MapLayout, map_layout
from .digits import Z_95, printable
from .map_parts import COLOURS, axes_of, curves_of, decibels, panels_of, snr_of
from .map_scales import cell_edges
from .map_wording import at_text, axis_label, conditions, notes, provenance, shown, title, variable_name

if TYPE_CHECKING:
    from plotly.graph_objects import Figure
    from xarray import Dataset

    from ..evaluate.maps import MapAnalysis

_TEMPLATES = Path(__file__).with_name("templates")

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
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from markupsafe import Markup

    layout, axes = map_layout(dataset), axes_of(dataset)
    draw = _curves if layout.y is None else _heat_maps
    figure = draw(dataset, analysis, layout, axes)
    figure.update_layout(template="plotly_white", font_family=_FONT, margin={"t": 50, "r": 20})
    # plotly's own button would send the map to its makers' servers.
    config = {"displaylogo": False, "responsive": True, "showSendToCloud": False}
    drawn = figure.to_html(full_html=False, include_plotlyjs=True, div_id="map", config=config)
    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("map.html").render(
        title=title(dataset),
        conditions=conditions(dataset),
        figure=Markup(drawn),  # noqa: S704 - plotly's own output, whose texts are escaped below
        notes=notes(analysis, axes),
        facts=provenance(dataset),
        chain="\n".join(printable(line) for line in str(dataset.attrs.get("chain", "")).splitlines()),
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
                "label": _text(at_text(at, axes)),
                "method": "update",
                "args": [{"visible": [owner == number for owner in owners]}],
            }
            for number, (at, _) in enumerate(panels)
        ]
        menu = {"buttons": buttons, "x": 0, "xanchor": "left", "y": 1.02, "yanchor": "bottom"}
        figure.update_layout(updatemenus=[menu])
    figure.update_xaxes(**_axis(layout.x), showgrid=False)
    figure.update_yaxes(**_axis(layout.y), showgrid=False)
    # The legend below, as plotly's buttons are above; missing values are grey.
    figure.update_layout(height=620, legend={"orientation": "h", "x": 0, "y": -0.14}, plot_bgcolor="#d9d9d9")
    return figure


def _axis(axis: MapAxis) -> dict[str, Any]:
    kind = ("log" if axis.log else "linear") if axis.numeric else "category"
    settings: dict[str, Any] = {"title": _text(axis_label(axis)), "type": kind}
    if axis.numeric:
        ends = shown(axis, cell_edges(axis)[[0, -1]])
        settings |= {"tickformat": "~g", "range": (np.log10(ends) if axis.log else ends).tolist()}
    return settings


def _heat_map(section: Dataset, x: MapAxis, y: MapAxis) -> Any:
    from plotly.graph_objects import Heatmap

    names = list(section.data_vars)
    up, across = np.meshgrid(shown(y, y.values), shown(x, x.values), indexing="ij")
    cells = np.stack([across, up, *(section[name].values for name in names)], axis=-1)
    rows = [
        f"{_text(axis_label(x))}: %{{customdata[0]:.5~g}}",
        f"{_text(axis_label(y))}: %{{customdata[1]:.5~g}}",
        *_hover_rows(section, names, first=2),
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


def _hover_rows(section: Dataset, names: list[Any], first: int) -> list[str]:
    """Lines of what is shown under the pointer; the values are columns of the custom data from `first` on."""
    return [
        f"{_text(variable_name(section, name))}: %{{customdata[{number}]:.4~g}}"
        for number, name in enumerate(names, start=first)
    ]


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


def _curves(dataset: Dataset, analysis: MapAnalysis, layout: MapLayout, axes: dict[str, MapAxis]) -> Figure:
    """Draw CDP along the axis, and below it each SNR of the map."""
    from plotly.graph_objects import Scatter
    from plotly.subplots import make_subplots

    curves = curves_of(dataset, layout)
    snr = snr_of(dataset, analysis, len(curves))
    figure = make_subplots(rows=2 if snr else 1, cols=1, shared_xaxes=True, vertical_spacing=0.05)
    place = shown(layout.x, layout.x.values) if layout.x.numeric else [_text(str(v)) for v in layout.x.values]
    for number, (at, section) in enumerate(curves):
        names = list(section.data_vars)
        rows = [f"{_text(axis_label(layout.x))}: %{{x}}", *_hover_rows(section, names, first=0)]
        common: dict[str, Any] = {
            "x": place,
            "mode": "lines" if layout.x.numeric and layout.x.values.size > 40 else "lines+markers",
            "legendgroup": str(number),
            "customdata": np.stack([section[name].values for name in names], axis=-1),
            "hovertemplate": "<br>".join(rows),
        }
        where = _text(at_text(at, axes))
        figure.add_traces(_band(section, place, COLOURS[number], str(number)), rows=1, cols=1)
        cdp = Scatter(y=section["cdp"].values, name=where or "CDP", line={"color": COLOURS[number]}, **common)
        figure.add_trace(cdp, row=1, col=1)
        figure.add_traces(_dips(section["cdp"].values, at, analysis, layout.x, "cdp"), rows=1, cols=1)
        for kind, name in enumerate(snr):
            line = {"color": COLOURS[kind if len(curves) == 1 else number], "dash": ("solid", "dash", "dot")[kind]}
            text = _text(variable_name(dataset, name)) + (where and f", {where}")
            trace = Scatter(y=decibels(section[name].values), name=text, line=line, **common)
            figure.add_trace(trace, row=2, col=1)
            dips = _dips(decibels(section[name].values), at, analysis, layout.x, name)
            figure.add_traces(dips, rows=2, cols=1)
    figure.add_hline(y=analysis.level, line={"color": "grey", "width": 1, "dash": "dot"}, row=1, col=1)
    _mark_range(figure, analysis, layout.x)
    figure.update_xaxes(**_axis(layout.x) | {"title": None})
    figure.update_xaxes(title=_text(axis_label(layout.x)), row=2 if snr else 1, col=1)
    figure.update_yaxes(title="CDP", range=[-0.03, 1.05], row=1, col=1)
    if snr:
        figure.update_yaxes(title="SNR in dB (20 log<sub>10</sub>)", row=2, col=1)
    figure.update_layout(height=700 if snr else 450, legend_traceorder="normal")
    return figure


def _band(section: Dataset, place: Any, colour: str, group: str) -> list[Any]:
    """95 % band of CDP, if the map has its standard error."""
    from plotly.graph_objects import Scatter

    if "standard_error" not in section or not np.isfinite(section["standard_error"].values).any():
        return []
    cdp, half_width = section["cdp"].values, Z_95 * section["standard_error"].values
    common: dict[str, Any] = {
        "x": place,
        "mode": "lines",
        "line": {"width": 0, "color": colour},
        "legendgroup": group,
        "showlegend": False,
        "hoverinfo": "skip",
    }
    return [
        Scatter(y=np.clip(cdp - half_width, 0, 1), **common),
        Scatter(y=np.clip(cdp + half_width, 0, 1), fill="tonexty", **common),
    ]


def _dips(values: NDArray[np.float64], at: At, analysis: MapAnalysis, axis: MapAxis, variable: str) -> list[Any]:
    """Rings around the dips of a section."""
    from plotly.graph_objects import Scatter

    places = [dip.position for dip in analysis.dips if dip.at == at and dip.variable == variable]
    if not places:
        return []
    marker = {"symbol": "circle-open", "size": 14, "color": "black"}
    heights = values[np.searchsorted(axis.values, places)]
    return [
        Scatter(x=shown(axis, places), y=heights, mode="markers", marker=marker, showlegend=False, hoverinfo="skip")
    ]


def _mark_range(figure: Figure, analysis: MapAnalysis, axis: MapAxis) -> None:
    for interval in analysis.usable_ranges[0].intervals if len(analysis.usable_ranges) == 1 else ():
        low, high = shown(axis, [interval.low, interval.high]).tolist()
        figure.add_vrect(x0=low, x1=high, fillcolor="#E69F00", opacity=0.15, line_width=0, layer="below", row=1, col=1)


def _text(text: str) -> str:
    """Escape what plotly would take for a tag or, in a template of the hover, for a variable."""
    return escape(text, quote=False).replace("%{", "% {")
