"""Figures of the sharpness of a picture: its edges, their responses and profiles, and MTF50 over the field."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ...core.luminance import LuminanceMap
from ...report import drawing
from ...report.layout import Card, ReportFigure
from ...report.maps import add_scale, draw_regions, drawn_pixels, image_extent, image_figure
from ...report.text import fixed, shortened, with_half_width
from .measure import FieldEdge, MeasuredSharpness

#: Edges that are named in a figure, and length at which their names are cut; more have the colour of their direction.
_MOST_NAMED, _LONGEST_NAME = 8, 24
#: Pictures that are drawn.
_MOST_PICTURES = 6
#: How dark parts of the picture are brightened, and share of its pixels that may be brighter than its white.
_GAMMA, _WHITE_SHARE = 0.45, 0.001
#: Markers by direction.
_MARKERS = {"horizontal": ("o", drawing.BLUE), "vertical": ("^", drawing.VERMILLION)}


def picture_figures(
    measured: MeasuredSharpness, pictures: Sequence[tuple[str, str, LuminanceMap]]
) -> Iterator[ReportFigure]:
    """Draw the first pictures with their edges; each has its name among the edges, its title and its light."""
    for number, (name, title, luminance) in enumerate(pictures[:_MOST_PICTURES], start=1):
        edges = [edge for edge in measured.edges if edge.picture == name]
        yield _picture(edges, luminance, title, "picture" if number == 1 else f"picture-{number}")


def sharpness_figures(measured: MeasuredSharpness) -> Iterator[ReportFigure]:
    """Draw the responses, the profiles and, of several edges, MTF50 over the field."""
    yield _responses(measured)
    yield _profiles(measured)
    if len(measured.edges) > 1:
        yield _field(measured)


def _picture(edges: Sequence[FieldEdge], luminance: LuminanceMap, title: str, name: str) -> ReportFigure:
    from matplotlib.colors import PowerNorm

    drawn, _ = drawn_pixels(luminance)
    finite = drawn[np.isfinite(drawn)]
    white = max(float(np.quantile(finite, 1 - _WHITE_SHARE)), 1e-300)
    regions = [edge.roi for edge in edges]
    figure = image_figure(luminance, shortened(title, 60), False, regions)
    norm = PowerNorm(_GAMMA, 0, white)
    extent = image_extent(luminance)
    shown = figure.axes[0].imshow(np.clip(drawn, 0, white), cmap="gray", norm=norm, extent=extent)
    add_scale(figure, shown, "luminance", extend="max")
    draw_regions(figure, luminance, regions)
    for edge in edges:
        figure.axes[0].plot(*edge.sfr.line_px.T, color=_MARKERS[edge.sfr.direction][1], linewidth=1.6)
    figure.axes[0].set(xlim=extent[:2], ylim=extent[2:])
    return drawing.reported(
        name, figure, "Regions and the edges found in them: blue those that show the sharpness along the rows, "
        "red those along the columns. Dark parts are brightened.",
    )  # fmt: skip


def _responses(measured: MeasuredSharpness) -> ReportFigure:
    figure = drawing.new_figure(6.6, 4.2)
    axes = figure.add_subplot()
    named = len(measured.edges) <= _MOST_NAMED
    for edge in measured.edges:
        label, colour = _name_and_colour(edge, named)
        dashed = "--" if edge.sfr.direction == "vertical" else "-"
        axes.plot(edge.sfr.frequency, edge.sfr.response.value, dashed, linewidth=1.0, label=label, color=colour)
    mean = measured.means[0].sfr
    if len(measured.edges) > 1:
        axes.plot(mean.frequency, mean.response.value, color="black", linewidth=1.8, label="mean")
    low, high = mean.response.interval
    axes.fill_between(mean.frequency, low, high, color="black", alpha=0.15, linewidth=0)
    for level in (0.5, 0.1):
        axes.axhline(level, color="0.4", linewidth=0.8, linestyle=":")
    axes.axvline(mean.frequency[-1] / 2, color="0.4", linewidth=0.8, linestyle=":")
    axes.set(xlim=(0, mean.frequency[-1]), ylim=(-0.03, max(1.05, 1.05 * float(np.max(mean.response.value)))))
    drawing.finish(axes, "spatial frequency in cycles/pixel", "response", "Spatial frequency response")
    return drawing.reported(
        "response", figure, "Response of each edge (dashed: of those that show the sharpness along the columns), and "
        "95 % interval of the mean. Dotted: 50 % and 10 %, and the highest frequency that pixels can show.",
    )  # fmt: skip


def _name_and_colour(edge: FieldEdge, named: bool) -> tuple[str | None, str | None]:
    """Label and colour of the curve of an edge; None for none, and for the next colour."""
    if named:
        return shortened(edge.name, _LONGEST_NAME), None
    return None, _MARKERS[edge.sfr.direction][1]


def _profiles(measured: MeasuredSharpness) -> ReportFigure:
    figure = drawing.new_figure(6.6, 3.4)
    axes = figure.add_subplot()
    known = [edge.sfr.mtf50.value for edge in measured.edges if edge.sfr.mtf50.value > 0]
    reach = min(1.5 / min(known, default=0.1), max(edge.sfr.distance_px[-1] for edge in measured.edges))
    named = len(measured.edges) <= _MOST_NAMED
    for edge in measured.edges:
        step = edge.sfr.bright - edge.sfr.dark
        label, colour = _name_and_colour(edge, named)
        relative = (edge.sfr.profile - edge.sfr.dark) / step
        axes.plot(edge.sfr.distance_px, relative, linewidth=1.0, label=label, color=colour)
    axes.set_xlim(-reach, reach)
    drawing.finish(axes, "distance from the edge in pixels", "light, in steps", "Profiles of the edges")
    return drawing.reported(
        "profile", figure, "Light across each edge: 0 its dark side, 1 its bright one. What lies beyond is overshoot."
    )


def _field(measured: MeasuredSharpness) -> ReportFigure:
    figure = drawing.new_figure(6.6, 3.4)
    axes = figure.add_subplot()
    for direction, (marker, colour) in _MARKERS.items():
        edges = [edge for edge in measured.edges if edge.sfr.direction == direction]
        if edges:
            field = [100 * edge.field for edge in edges]
            mtf50, expanded = ([getattr(edge.sfr.mtf50, name) for edge in edges] for name in ("value", "U"))
            how: dict[str, Any] = {"color": colour, "markersize": 5, "capsize": 2, "linestyle": "none"}
            axes.errorbar(field, mtf50, np.nan_to_num(expanded), marker=marker, label=direction, **how)
    axes.set_ylim(bottom=0)
    where = "distance from the middle of the image in % of half its diagonal"
    drawing.finish(axes, where, "MTF50 in cycles/pixel", "MTF50 over the field")
    return drawing.reported("field", figure, "MTF50 of each edge with its 95 % interval, over its place in the field.")


def sharpness_cards(measured: MeasuredSharpness) -> list[Card]:
    """Make a card for the mean of all edges, and for that in each direction if there are both."""
    cards = []
    for mean in measured.means:
        title = "MTF50" if mean.name == "all" else f"MTF50, {mean.name}"
        quantity, low = mean.sfr.mtf50, mean.sfr.mtf10
        n_pictures = len({edge.picture for edge in measured.edges})
        in_pictures = f" in {n_pictures} pictures" if n_pictures > 1 else ""
        lines = [f"{mean.n_edges} edge{'s' * (mean.n_edges > 1)}{in_pictures}"]
        if np.isfinite(low.value):
            lines.append(f"MTF10 {with_half_width(low.value, low.U)} cycles/pixel")
        overshoot = mean.sfr.overshoot
        lines.append(f"overshoot {with_half_width(100 * overshoot.value, 100 * overshoot.U)} %")
        known = np.isfinite(quantity.value)
        value = with_half_width(quantity.value, quantity.U) if known else "not known"
        detail = "cycles/pixel" if measured.pixel_pitch_m is None or not known else (
            f"cycles/pixel, {fixed(1e-3 * quantity.value / measured.pixel_pitch_m, 1)} lp/mm"
        )  # fmt: skip
        cards.append(Card(title, value, detail, tuple(lines)))
    return cards
