"""A map over one axis as interactive curves: CDP with its 95 % band, and SNR."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..evaluate.map_axes import At, MapAxis, MapLayout
from .digits import Z_95
from .drawing import ORANGE
from .map_parts import COLOURS, SNR_COLOURS, curves_of, decibels, snr_of
from .map_plotly import axis_settings, escaped, hover_rows, hover_values
from .map_wording import at_text, axis_label, shown, variable_name

if TYPE_CHECKING:
    from plotly.graph_objects import Figure
    from xarray import Dataset

    from ..evaluate.maps import MapAnalysis

#: Ends of the axis of CDP.
_CDP_ENDS = (-0.03, 1.05)


def draw_page_curves(dataset: Dataset, analysis: MapAnalysis, layout: MapLayout, axes: dict[str, MapAxis]) -> Figure:
    """Draw CDP along the axis, and below it the SNR of the map: all of them of one curve, one of several."""
    from plotly.subplots import make_subplots

    curves = curves_of(dataset, layout)
    snr = snr_of(dataset, analysis, len(curves))
    figure = make_subplots(rows=2 if snr else 1, cols=1, shared_xaxes=True, vertical_spacing=0.05)
    _mark_ranges(figure, analysis, layout.x)
    for number, (at, section) in enumerate(curves):
        where = escaped(at_text(at, axes)) if len(curves) > 1 else ""
        common = _common(section, layout.x, number)
        _add_band(figure, section, common["x"], COLOURS[number], "" if where else "95 % band")
        _add_curve(figure, 1, section["cdp"].values, where or "CDP", COLOURS[number], common)
        _add_dips(figure, 1, section["cdp"].values, at, analysis, layout.x, "cdp")
        for name in snr:
            text = where or escaped(variable_name(dataset, name))
            # Curves of several sections have the colours, and the legend, of their CDP above.
            colour = COLOURS[number] if where else SNR_COLOURS[name]
            values = decibels(section[name].values)
            _add_curve(figure, 2, values, text, colour, common | {"showlegend": not where})
            _add_dips(figure, 2, values, at, analysis, layout.x, name)
    _mark_level(figure, analysis.level, layout.x)
    figure.update_xaxes(**axis_settings(layout.x) | {"title": None})
    figure.update_xaxes(title=escaped(axis_label(layout.x)), row=2 if snr else 1, col=1)
    figure.update_yaxes(title="CDP", range=_CDP_ENDS, row=1, col=1)
    if snr:
        what = escaped(variable_name(dataset, snr[0])) if len(snr) == 1 else "SNR"
        figure.update_yaxes(title=f"{what} in dB (20 log<sub>10</sub>)", row=2, col=1)
    figure.update_layout(height=700 if snr else 450, legend_traceorder="normal")
    return figure


def _places(axis: MapAxis) -> Any:
    return shown(axis, axis.values) if axis.numeric else [escaped(str(value)) for value in axis.values]


def _common(section: Dataset, axis: MapAxis, number: int) -> dict[str, Any]:
    """Collect what all curves of a section share."""
    names = list(map(str, section.data_vars))
    rows = [f"{escaped(axis_label(axis))}: %{{x}}", *hover_rows(section, names, first=0)]
    return {
        "x": _places(axis),
        "mode": "lines" if axis.numeric and axis.values.size > 40 else "lines+markers",
        "legendgroup": str(number),
        "customdata": np.stack(hover_values(section, names), axis=-1),
        "hovertemplate": "<br>".join(rows),
    }


def _add_curve(
    figure: Figure, row: int, values: NDArray[np.float64], text: str, colour: str, common: dict[str, Any]
) -> None:
    from plotly.graph_objects import Scatter

    # A group of its own for each curve of a single section, so that the legend switches one curve at a time.
    group = {} if common.get("showlegend") is False else {"legendgroup": f"{common['legendgroup']} {text}"}
    figure.add_trace(Scatter(y=values, name=text, line={"color": colour}, **common | group), row=row, col=1)


def _add_band(figure: Figure, section: Dataset, place: Any, colour: str, text: str) -> None:
    """Draw the 95 % band of CDP, if the map has its standard error."""
    from plotly.graph_objects import Scatter

    if "standard_error" not in section or not np.isfinite(section["standard_error"].values).any():
        return
    cdp, half_width = section["cdp"].values, Z_95 * section["standard_error"].values
    common: dict[str, Any] = {
        "x": place,
        "mode": "lines",
        "line": {"width": 0, "color": colour},
        "legendgroup": "band",
        "hoverinfo": "skip",
    }
    low, high = np.clip([cdp - half_width, cdp + half_width], 0, 1)
    figure.add_trace(Scatter(y=low, showlegend=False, **common), row=1, col=1)
    figure.add_trace(Scatter(y=high, fill="tonexty", name=text, showlegend=bool(text), **common), row=1, col=1)


def _add_dips(
    figure: Figure,
    row: int,
    values: NDArray[np.float64],
    at: At,
    analysis: MapAnalysis,
    axis: MapAxis,
    variable: str,
) -> None:
    """Draw rings around the dips of a section."""
    from plotly.graph_objects import Scatter

    places = [dip.position for dip in analysis.dips if dip.at == at and dip.variable == variable]
    if places:
        rings = Scatter(
            x=shown(axis, places),
            y=values[np.searchsorted(axis.values, places)],
            mode="markers",
            marker={"symbol": "circle-open", "size": 14, "color": "black"},
            name="dip",
            legendgroup="dip",
            showlegend=all(trace.name != "dip" for trace in figure.data),
            hoverinfo="skip",
        )
        figure.add_trace(rings, row=row, col=1)


def _mark_level(figure: Figure, level: float, axis: MapAxis) -> None:
    from plotly.graph_objects import Scatter

    ends = axis_settings(axis).get("range")
    place = _places(axis)
    if ends is not None:
        place = np.power(10.0, ends) if axis.log else ends
    line = {"color": "grey", "width": 1, "dash": "dot"}
    trace = Scatter(x=place, y=[level] * len(place), mode="lines", line=line, name=f"CDP {level:g}", hoverinfo="skip")
    figure.add_trace(trace, row=1, col=1)


def _mark_ranges(figure: Figure, analysis: MapAnalysis, axis: MapAxis) -> None:
    """Shade the usable ranges of a single curve; one trace, which the legend switches."""
    from plotly.graph_objects import Scatter

    intervals = analysis.usable_ranges[0].intervals if len(analysis.usable_ranges) == 1 else ()
    if not intervals:
        return
    x: list[float | None] = []
    for interval in intervals:
        low, high = shown(axis, [interval.low, interval.high]).tolist()
        x += [low, low, high, high, None]
    bottom, top = _CDP_ENDS
    trace = Scatter(
        x=x,
        y=[bottom, top, top, bottom, None] * len(intervals),
        mode="lines",
        line={"width": 0, "color": ORANGE},
        fill="toself",
        fillcolor="rgba(230, 159, 0, 0.15)",
        name="usable range",
        hoverinfo="skip",
    )
    figure.add_trace(trace, row=1, col=1)
