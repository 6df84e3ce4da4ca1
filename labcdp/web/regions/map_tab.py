"""The page of a recorded image, and its tab of the luminance map: scale, isolines, profile, limits, export."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from math import inf
from time import monotonic
from typing import Any

import numpy as np
import panel as pn
from bokeh.models import ColumnDataSource, CustomJS, Range1d

from ...core.errors import InputError, LabcdpError
from ..html import beside, column, row, small_plot
from ..numbers import coordinates, number_list
from .display import LARGEST_RATIO, SCALES, DisplayScale, ScaleName
from .map_data import EXPORTS, export_map, isolines, profile
from .page import WorkspacePage
from .wording import statistics_table
from .workspace import Workspace

#: Seconds between two profiles, sets of isolines and statistics of a live image.
_EVERY_S = 0.5
_VALUES, _COLOURS, _GREY = "Values of the camera", "Luminance in false colours", "Luminance in grey"


class MapTab:
    """The tab.

    Parameters
    ----------
    page : WorkspacePage
        Picture and regions of the tab of the browser.
    coloured : bool
        Whether the luminance is shown in false colours at first.
    """

    def __init__(self, page: WorkspacePage, coloured: bool) -> None:
        self._page, self._picture, self._workspace = page, page.picture, page.workspace
        self._dn_scale = page.picture.scale
        self._levels: tuple[float, ...] = ()
        self._ends: tuple[float, ...] = ()
        self._refreshed_s, self._refreshed_for = 0.0, page.workspace.image
        unit = page.workspace.image.unit_text
        field, example = page.field, "for example 1, 10, 100"
        self._shown = field("Select", "Picture", options=[_VALUES, _COLOURS, _GREY], width=220)
        self._kind = field("Select", "Scale", options=list(SCALES), value=self._dn_scale.name, width=110)
        self._low, self._high = (
            page.number(name, lambda _value: page.soon(self._rescale), (0.0, inf), view_only=True, width=110)
            for name in ("From", "To")
        )
        tip = "Span the luminances of the picture"
        self._fit = field("Button", "Fit scale", description=tip, margin=(19, 4))
        self._isolines = field("TextInput", f"Isolines ({unit})", placeholder=example, width=190)
        self._line = field("TextInput", "Profile from x, y to x, y", placeholder="or draw a line (L)", width=190)
        limits, example = "Limits of the selected region (cd/m²), with Enter", "for example 10 to 12"
        self._limits = field("TextInput", limits, placeholder=example, width=250)
        name = f"{page.workspace.files.output.stem}.png"
        self._file = field("TextInput", f"Export as {', '.join(EXPORTS)}", value=name, width=250)
        self._save = page.button("Export", self._export, margin=(19, 4))
        self._table = page.text("statistics")
        self._profile = ColumnDataSource(data={"d": [], "l": [], "low": [], "high": []})
        self._plot = self._new_plot()
        self._connect()
        page.after_update.append(self.update)
        self._enable(coloured)
        if coloured:
            self._shown.value = _COLOURS
        self.update()

    def layout(self) -> Any:
        """Return the tab."""
        return column(
            row(self._shown, self._kind),
            row(self._low, self._high, self._fit),
            row(self._isolines, self._line),
            pn.pane.Bokeh(self._plot, sizing_mode="stretch_width", margin=(4, 8)),
            self._table,
            row(self._limits),
            row(self._file, self._save),
        )

    def update(self) -> None:
        """Refresh statistics and what is drawn; of a live image not with every one, which would slow it down."""
        workspace = self._workspace
        live = workspace.image is not self._refreshed_for
        if live and monotonic() - self._refreshed_s < _EVERY_S:
            return
        self._refreshed_s, self._refreshed_for = monotonic(), workspace.image
        drawing, measured = workspace.drawing, workspace.measured
        self._table.object = statistics_table(workspace.image, drawing, measured, workspace.selected)
        if live and (self._levels or self._ends):
            self._draw()

    def _connect(self) -> None:
        page = self._page
        later = page.soon
        self._shown.param.watch(lambda event: later(partial(self._show, event.new)), "value")
        self._kind.param.watch(lambda _event: later(self._rescale), "value")
        self._fit.on_click(lambda _event: later(self._fit_scale))
        page.watch_view(self._isolines, self._set_levels)
        page.watch_view(self._line, self._set_ends)
        self._picture.link.on_change(
            "line",
            lambda _attr, _old, new: self._line.param.update(
                value=", ".join(f"{coordinate:.1f}" for coordinate in new)
            ),
        )
        page.on_enter(self._limits, self._limit)

    def show_range(self, scale: DisplayScale) -> None:
        """Show other values of the camera from black to white, as after a change of its bits."""
        self._dn_scale = scale
        self._show(self._shown.value)

    def _show(self, what: str) -> None:
        is_dn = what == _VALUES
        self._enable(not is_dn)
        kinds = list(SCALES) if is_dn else ["logarithm", "linear"]
        self._kind.param.update(options=kinds, value=self._dn_scale.name if is_dn else kinds[0])
        if not (is_dn or self._high.value):
            self._fit_scale()
        self._rescale()

    def _rescale(self) -> None:
        if self._shown.value == _VALUES:
            self._picture.show_scale(replace(self._dn_scale, name=self._kind.value))
            return
        self._picture.show_scale(self._scale(), shows_light=True, coloured=self._shown.value == _COLOURS)

    def _scale(self) -> DisplayScale:
        kind: ScaleName = self._kind.value
        high = float(self._high.value or 1.0)
        low = min(float(self._low.value or 0.0), 0.999 * high)
        # No more decades than the colours can show.
        return DisplayScale(kind, max(low, high / LARGEST_RATIO) if kind == "logarithm" else low, high, ends_apart=True)

    def _fit_scale(self) -> None:
        light = self._workspace.image.light_display
        low, high = np.percentile(light[np.isfinite(light)], (0.5, 99.9)) if np.isfinite(light).any() else (0.0, 1.0)
        # Noise about 0 would take most colours of a logarithm.
        low = max(low, high / (LARGEST_RATIO if low > 0 else 1000.0), 0.0)
        for field, value in ((self._low, low), (self._high, max(high, 1e-6))):
            self._page.show_number(field, float(f"{value:.3g}"))
        self._page.soon(self._rescale)
        if self._shown.value == _VALUES:
            self._shown.value = _COLOURS

    def _enable(self, is_light: bool) -> None:
        """Allow ends of the scale where luminance is shown."""
        for field in (self._low, self._high):
            field.widget.disabled = not is_light

    def _set_levels(self, text: str) -> None:
        self._levels = number_list(text)
        self._page.soon(self._draw)

    def _set_ends(self, text: str) -> None:
        ends = coordinates(text, 4) if text.strip() else ()
        if ends:
            profile(self._workspace.image, ends)  # refuses what is outside
        self._ends = ends
        self._page.soon(self._draw)

    def _draw(self) -> None:
        """Draw profile and isolines of the image of this moment."""
        image, picture = self._workspace.image, self._picture
        lines = isolines(image.luminance, self._levels) if self._levels else []
        picture.isolines.data = {"xs": [line.x for line in lines], "ys": [line.y for line in lines]}
        # Noise makes many lines of a level: the longest has the label.
        longest = {line.level: line for line in sorted(lines, key=lambda line: len(line.x))}.values()
        # At different places, as the lines about an object lie on each other.
        places = [(line, len(line.x) * (at + 1) // (len(longest) + 1)) for at, line in enumerate(longest)]
        picture.isoline_labels.data = {
            "x": [line.x[index] for line, index in places],
            "y": [line.y[index] for line, index in places],
            "text": [f"{line.level:g}" for line, _ in places],
        }
        ends = self._ends
        picture.profile_line.data = {"x": list(ends[::2]), "y": list(ends[1::2])}
        if not ends:
            self._profile.data = {name: [] for name in self._profile.data}
            return
        along = profile(image, ends)
        half = np.nan_to_num(along.expanded)
        low, high = float((along.luminance - half).min()), float((along.luminance + half).max())
        self._plot.x_range.end = max(float(along.distance_px[-1]), 1.0)
        self._plot.y_range.update(start=min(low, 0.0), end=1.05 * high if high > 0 else 1.0)
        self._profile.data = {
            "d": along.distance_px,
            "l": along.luminance,
            "low": along.luminance - half,
            "high": along.luminance + half,
        }

    def _limit(self, text: str) -> None:
        if not text:
            return
        if self._workspace.selected is None:
            raise InputError("select a region first, then give its limits; - for none")
        given = None if text.strip() == "-" else [*coordinates(text, 2)]
        self._page.do({"do": "limits", "name": self._workspace.selected, "of": given})
        self._limits.value = ""

    def _export(self) -> None:
        workspace, image, scale = self._workspace, self._workspace.image, self._scale()

        def steps() -> Iterator[str]:
            try:
                path = workspace.files.beside(self._file.value_input or self._file.value, EXPORTS)
                export_map(image, path, scale)
                yield f"Exported: {path}"
            except LabcdpError as error:
                yield str(error)

        workspace.run_elsewhere(steps(), workspace.say, workspace.changed)

    def _new_plot(self) -> Any:
        # Ranges of its own: an empty plot cannot find any.
        ranges = {"x_range": Range1d(0, 1), "y_range": Range1d(0, 1)}
        plot = small_plot(150, **ranges)
        plot.xaxis.axis_label, plot.yaxis.axis_label = "pixels along the line", self._workspace.image.unit_text
        plot.varea("d", "low", "high", source=self._profile, fill_alpha=0.3, fill_color="#0072b2")
        plot.line("d", "l", source=self._profile, line_color="#0072b2")
        return plot


def map_page(workspace: Workspace, document: Any, *, map_first: bool) -> tuple[Any, CustomJS]:
    """Return the layout of a tab of the browser, and the script that starts with it.

    Parameters
    ----------
    workspace : Workspace
        State common to all tabs.
    document : bokeh.document.Document
        The tab.
    map_first : bool
        Whether the luminance is shown first, in false colours, instead of the regions.
    """
    page = WorkspacePage(workspace, document)
    luminance = MapTab(page, map_first)
    tabs = pn.Tabs(
        ("Regions", page.side()), ("Luminance", luminance.layout()), active=int(map_first), sizing_mode="stretch_both"
    )
    return beside(page.picture.figure, (*page.head(), tabs)), page.picture.script()
