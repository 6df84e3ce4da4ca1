"""A map of CDP as an interactive figure: all variables of a cell under the pointer, lines to switch on and off."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape
from typing import Any

import numpy as np
from plotly.graph_objects import Figure, Heatmap, Scatter
from plotly.subplots import make_subplots
from xarray import Dataset

from ....report.html import interactive
from ....report.layout import Script
from .axes import At, MapAxis, known_values
from .labels import axis_label, shown, variable_column
from .view import MISSING, SCALE, USABLE, WIDEST, Line, MapView, cell_edges

#: Dashes of the isolines, in rising order of their levels.
_DASHES = ("dot", "solid", "dash")

#: Decades of an axis below which plotly would write all of 1 to 9; it writes 1, 2 and 5.
_FEW_DECADES = 2.5

#: Below the figure, as a phone is too narrow for it beside.
_LEGEND = {"orientation": "h", "x": 0}

#: Ends of the axis of CDP.
_CDP_ENDS = (-0.03, 1.05)


def map_script(view: MapView) -> Script:
    """Draw a map; over two axes of numbers as heat maps, else as curves."""
    figure = _heat_maps(view) if view.map.y is not None else _curves(view)
    figure.update_layout(margin={"t": 45, "r": 20, "l": 70, "b": 10})
    return interactive(figure)


def _heat_maps(view: MapView) -> Figure:
    """Draw one heat map for each section, of which one is shown at a time."""
    assert view.map.y is not None
    figure, owners = Figure(), []
    for number, (at, section) in enumerate(view.parts):
        traces = [_heat_map(view, section), *_overlays(view, at)]
        figure.add_traces([trace.update(visible=number == 0) for trace in traces])
        owners += [number] * len(traces)
    if len(view.parts) > 1:
        buttons = [
            {
                "label": _escaped(view.text_of(at)),
                "method": "update",
                "args": [{"visible": [owner == number for owner in owners]}],
            }
            for number, (at, _) in enumerate(view.parts)
        ]
        menu = {"buttons": buttons, "x": 0, "xanchor": "left", "y": 1.02, "yanchor": "bottom"}
        figure.update_layout(updatemenus=[menu])
    figure.update_xaxes(**_axis_settings(view.map.x), showgrid=False)
    figure.update_yaxes(**_axis_settings(view.map.y), showgrid=False)
    figure.update_layout(height=520, legend={**_LEGEND, "y": -0.16}, plot_bgcolor=MISSING)
    return figure


def _heat_map(view: MapView, section: Dataset) -> Any:
    x, y = view.map.x, view.map.y
    assert y is not None
    up, across = np.meshgrid(shown(y, y.values), shown(x, x.values), indexing="ij")
    coordinates = [(f"{_escaped(axis_label(axis))}: ", ".5~g") for axis in (x, y)]
    rows, values = _under_pointer(section)
    return Heatmap(
        x=cell_edges(x),
        y=cell_edges(y),
        z=section["cdp"].values,
        zmin=0,
        zmax=1,
        colorscale=SCALE,
        colorbar={"title": "CDP"},
        customdata=np.stack([across, up, *values], axis=-1),
        hovertemplate=_template([*coordinates, *rows]) + "<extra></extra>",
        hoverongaps=False,
    )


def _overlays(view: MapView, at: At) -> Iterator[Any]:
    """Yield the lines over a section; isolines of one level are one trace, which the legend switches."""
    for text, number, lines in view.overlays(at):
        isoline = {"color": "black", "width": 1.5, "dash": _DASHES[(number or 0) % len(_DASHES)]}
        yield Scatter(
            x=[value for x, _ in lines for value in (*x.tolist(), None)],
            y=[value for _, y in lines for value in (*y.tolist(), None)],
            mode="lines",
            line={"color": WIDEST, "width": 4} if number is None else isoline,
            name=_escaped(text),
            hoverinfo="skip",
        )


def _curves(view: MapView) -> Figure:
    """Draw CDP along the axis, and below it the SNR of the map."""
    cdp, snr = view.curves()
    axis, level = view.map.x, view.analysis.level
    figure = make_subplots(rows=2 if snr else 1, cols=1, shared_xaxes=True, vertical_spacing=0.05)
    for row, lines in enumerate((cdp, snr), start=1):
        traces = list(_traces(view, lines))
        if row == 2:  # only what the curves of CDP do not have already
            known = {trace.name for trace in figure.data}
            traces = [trace.update(showlegend=trace.name not in known) for trace in traces]
        figure.add_traces(traces, rows=row, cols=1)
    of_cdp = {"row": 1, "col": 1, "layer": "below"}
    line = {"color": "grey", "width": 1, "dash": "dot"}
    figure.add_hline(level, line=line, name=f"CDP {level:g}", showlegend=True, **of_cdp)
    for number, ends in enumerate(view.usable):
        area = {"fillcolor": USABLE, "opacity": 0.15, "line_width": 0, "name": "usable range", "legendgroup": "usable"}
        figure.add_vrect(*ends, showlegend=number == 0, **area, **of_cdp)
    figure.update_xaxes(**_axis_settings(axis) | {"title": None})
    figure.update_xaxes(title=_escaped(axis_label(axis)), row=2 if snr else 1, col=1)
    figure.update_yaxes(title="CDP", range=_CDP_ENDS, row=1, col=1)
    if snr:
        figure.update_yaxes(title="SNR in dB (20 log<sub>10</sub>)", row=2, col=1)
    # The legend, which tells curves apart, shall be on the first screen.
    place = {"y": 1.0, "yanchor": "bottom"} if len(view.parts) > 1 else {"y": -0.16}
    figure.update_layout(height=560 if snr else 420, legend={**_LEGEND, **place, "traceorder": "normal"})
    return figure


def _traces(view: MapView, lines: Sequence[Line]) -> Iterator[Any]:
    """Yield curves with their bands and dips; curves of one section are switched together."""
    axis, with_dips = view.map.x, [line for line in lines if line.dips[0].size]
    places = shown(axis, axis.values) if axis.numeric else _texts(axis)
    for line in lines:
        text, skip = _escaped(line.text), {"hoverinfo": "skip"}
        if line.band is not None:
            edge = {"mode": "lines", "line": {"width": 0, "color": line.colour}, "legendgroup": "band"}
            single = len(lines) == 1
            yield Scatter(x=places, y=line.band[0], showlegend=False, **edge, **skip)
            name = "95 % intervals" if single else ""
            yield Scatter(x=places, y=line.band[1], fill="tonexty", name=name, showlegend=single, **edge, **skip)
        rows, values = _under_pointer(line.section)
        yield Scatter(
            x=places,
            y=line.values,
            name=text,
            mode="lines+markers" if view.marked else "lines",
            line={"color": line.colour},
            legendgroup=text,
            customdata=np.stack(values, axis=-1),
            hovertemplate="<br>".join([f"{_escaped(axis_label(axis))}: %{{x}}", _template(rows)]),
        )
        if line.dips[0].size:
            ring = {"symbol": "circle-open", "size": 14, "color": "black"}
            named = {"name": "dip", "legendgroup": "dip", "showlegend": line is with_dips[0]}
            yield Scatter(x=line.dips[0], y=line.dips[1], mode="markers", marker=ring, **named, **skip)


def _axis_settings(axis: MapAxis) -> dict[str, Any]:
    """Title, kind and ends of a drawn axis."""
    kind = ("log" if axis.log else "linear") if axis.numeric else "category"
    settings: dict[str, Any] = {"title": _escaped(axis_label(axis)), "type": kind}
    if axis.numeric:
        ends = cell_edges(axis)[[0, -1]]
        ends = np.log10(ends) if axis.log else ends
        settings |= {"tickformat": "~g", "range": ends.tolist()}
        if axis.log and np.ptp(ends) < _FEW_DECADES:
            settings["dtick"] = "D2"
    return settings


def _texts(axis: MapAxis) -> list[str]:
    return [_escaped(str(value)) for value in axis.values]


def _under_pointer(section: Dataset) -> tuple[list[tuple[str, str]], list[Any]]:
    """Return name and format of each variable, and its values; an SNR without noise is not a number."""
    rows, values = [], []
    for name in map(str, section.data_vars):
        column = variable_column(section, name)
        rows.append((_escaped(f"{column.label}{column.unit and f' in {column.unit}'}: "), ".4~g"))
        values.append((100 if column.unit == "%" else 1) * known_values(name, section[name].values))
    return rows, values


def _template(rows: Sequence[tuple[str, str]]) -> str:
    return "<br>".join(f"{text}%{{customdata[{number}]:{form}}}" for number, (text, form) in enumerate(rows))


def _escaped(text: str) -> str:
    """Escape text that plotly would interpret as a tag or, in a hover template, as a variable."""
    return escape(text, quote=False).replace("%{", "% {")
