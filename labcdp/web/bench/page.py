"""One tab of the live bench."""

from __future__ import annotations

from collections.abc import Callable
from importlib.resources import files
from math import isfinite
from time import monotonic
from typing import Any

import numpy as np
import panel as pn
from bokeh.models import ColumnDataSource, CustomJS, Range1d, Span
from bokeh.plotting import figure

from ...drivers.camera import CameraSettings
from ..regions.display import DisplayScale
from ..regions.page import Page
from ..regions.wording import warning_list
from .live_bench import TRACE_S, LiveBench
from .record_tab import RecordTab
from .wording import camera_card, contrast_card, meter_card, pair_card, reading_table, settings_text

_WIDTH = 440
#: Bins of the histogram, and pixels of which it is made.
_N_BINS, _SAMPLE = 128, 200_000
#: Seconds between two plots, and points of the trace in one: more slow the images down.
_PLOT_S, _MOST_POINTS = 0.5, 400


class BenchPage:
    """One tab.

    Parameters
    ----------
    bench : LiveBench
        State common to all tabs.
    document : bokeh.document.Document
        The tab.
    """

    def __init__(self, bench: LiveBench, document: Any) -> None:
        self.bench = bench
        self._regions = Page(bench.workspace, document)
        self._picture = self._regions.picture
        highest = bench.highest_dn
        self._picture.show_scale(DisplayScale.of_range(highest))
        self._picture.mark_ends()
        css = "".join(
            files("labcdp").joinpath(f"data/roi-page/{name}").read_text(encoding="utf-8")
            for name in ("page.css", "bench.css")
        )

        def html(name: str) -> Any:
            return pn.pane.HTML("", name=name, stylesheets=[css], sizing_mode="stretch_width", margin=(2, 8))

        names = ("strip", "settings", "table", "notice", "findings")
        self._strip, self._settings, self._table, self._notice, self._findings = map(html, names)
        self._record = RecordTab(bench, html)
        self._exposure = pn.widgets.FloatInput(name="Exposure (ms)", start=0.0, step=1.0, width=130)
        self._gain = pn.widgets.FloatInput(name="Gain (dB)", step=1.0, width=110)
        self._pause = pn.widgets.Toggle(name="Pause", margin=(3, 4))
        self._typed = pn.widgets.TextInput(name="Reading of another meter (cd/m²), with Enter", width=260)
        self._contrast = pn.widgets.TextInput(name="Contrast to detect (%)", placeholder="measured", width=170)
        self._epsilon = pn.widgets.FloatInput(
            name="Tolerance ε (%)", value=100 * bench.target.epsilon, start=0.1, width=130
        )
        if bench.target.contrast is not None:
            self._contrast.value = f"{100 * bench.target.contrast:g}"
        self._trace_source = ColumnDataSource(data={"t": [], "cdp": [], "low": [], "high": []})
        self._histogram_source = ColumnDataSource(data={"dn": [], "n": []})
        self._plotted_s = 0.0
        self._highest = highest
        self._shown: CameraSettings | None = None
        self._filling = False
        self._connect()
        for end in (bench.camera.look(), bench.workspace.listen(self._changed)):
            document.on_session_destroyed(_ending(end))
        self._document, self._waits = document, False
        self.update()

    def tab(self) -> tuple[Any, CustomJS]:
        """Return the layout of the tab, and the script that starts with it."""
        live = pn.Column(
            self._notice,
            pn.Row(self._contrast, self._epsilon, margin=0),
            pn.pane.Bokeh(self._trace_figure(), sizing_mode="stretch_width", margin=(4, 8)),
            pn.Row(self._exposure, self._gain, margin=0),
            pn.Row(*self._buttons(), self._pause, margin=(0, 3)),
            self._settings,
            self._findings,
            pn.pane.Bokeh(self._histogram_figure(), sizing_mode="stretch_width", margin=(4, 8)),
            pn.Row(self._typed, margin=0),
            self._table,
            width=_WIDTH,
            sizing_mode="stretch_height",
            scroll="y",
            margin=0,
        )
        side = pn.Tabs(
            ("Live", live),
            ("Regions", self._regions.side()),
            ("Record", self._record.layout()),
            width=_WIDTH,
            sizing_mode="stretch_height",
        )
        row = pn.Row(self._regions.picture_pane(), side, sizing_mode="stretch_both", min_height=380, margin=0)
        return pn.Column(self._strip, row, sizing_mode="stretch_both", margin=0), self._picture.script()

    def update(self) -> None:
        """Refresh the tab."""
        self._waits = False
        bench = self.bench
        cards = (camera_card(bench), pair_card(bench), contrast_card(bench), meter_card(bench))
        self._strip.object = f"<div class='strip'>{''.join(cards)}</div>"
        self._settings.object = settings_text(bench.camera.live)
        self._show_settings(bench.camera.live.settings)
        workspace = bench.workspace
        self._findings.object = warning_list(workspace.image, workspace.drawing, workspace.means, workspace.evaluated)
        self._table.object = reading_table(bench)
        self._record.update()
        words = bench.busy or bench.notice or bench.mismatch
        self._notice.object = f"<div class='notice' role='status'>{words}</div>" if words else ""
        now_s = monotonic()
        if now_s - self._plotted_s > _PLOT_S:
            self._plotted_s = now_s
            points = bench.trace[:: 1 + len(bench.trace) // _MOST_POINTS]
            self._trace_source.data = {
                "t": [one.time_s - now_s for one in points],
                **{name: [getattr(one, name) for one in points] for name in ("cdp", "low", "high")},
            }
            self._histogram_source.data = _histogram(bench.workspace.image.values, self._highest)

    def _changed(self) -> None:
        if not self._waits:
            self._waits = True
            self._document.add_next_tick_callback(self.update)

    def _connect(self) -> None:
        self._exposure.param.watch(lambda event: self._request("exposure_s", event.new, 1e-3), "value")
        self._gain.param.watch(lambda event: self._request("gain_db", event.new, 1.0), "value")
        self._contrast.param.watch(lambda event: self._aim_contrast(event.new), "value")
        self._pause.param.watch(lambda event: setattr(self.bench, "paused", event.new), "value")
        self._typed.param.watch(lambda event: self._enter(event.new), "value")
        self._epsilon.param.watch(lambda event: self._aim_epsilon(event.new), "value")

    def _request(self, name: str, value: float | None, unit: float) -> None:
        if not self._filling and value is not None and isfinite(value):
            self.bench.camera.request(**{name: value * unit})

    def _enter(self, text: str) -> None:
        if not text:
            return
        try:
            luminance_cd_m2 = float(text.replace(",", "."))
        except ValueError:
            luminance_cd_m2 = -1.0
        if not 0 <= luminance_cd_m2 < 1e9:
            self._say("A reading is a number of cd/m², 0 or more")
            return
        self.bench.enter_reading(luminance_cd_m2)
        self._typed.value = ""

    def _aim_contrast(self, text: str) -> None:
        words = text.replace("%", "").strip()
        try:
            contrast = float(words) / 100 if words else None
        except ValueError:
            contrast = float("nan")
        if contrast is not None and not 0 < contrast < 1e7:
            self._say("The contrast is a percentage above 0; empty for the measured contrast")
            return
        self.bench.aim(contrast=contrast)

    def _aim_epsilon(self, percent: float | None) -> None:
        if percent is None or not 0 < percent < 1e4:
            self._say("The tolerance is a percentage above 0")
            return
        self.bench.aim(epsilon=percent / 100)

    def _say(self, text: str) -> None:
        self.bench.notice = text
        self.bench.workspace.changed()

    def _show_settings(self, settings: CameraSettings | None) -> None:
        """Update the fields when the settings have changed, also by another program."""
        if settings is None or settings == self._shown:
            return
        self._shown, self._filling = settings, True
        self._exposure.value, self._gain.value = float(f"{1e3 * settings.exposure_s:.6g}"), settings.gain_db
        self._filling = False

    def _buttons(self) -> list[Any]:
        buttons = []
        for name, action in (("Fit exposure", self.bench.fit_exposure), ("Read meter", self.bench.take_reading)):
            button = pn.widgets.Button(name=name, margin=(3, 4))
            button.on_click(lambda _event, action=action: action())
            buttons.append(button)
        return buttons

    def _trace_figure(self) -> Any:
        plot = figure(
            height=130, toolbar_location=None, tools="", y_range=Range1d(-0.02, 1.02), x_range=Range1d(-TRACE_S, 0)
        )
        plot.yaxis.axis_label, plot.xaxis.axis_label = "CDP", "s"
        plot.varea("t", "low", "high", source=self._trace_source, fill_alpha=0.3, fill_color="#0072b2")
        plot.line("t", "cdp", source=self._trace_source, line_color="#0072b2", line_width=2)
        plot.add_layout(Span(location=self.bench.target.limit, dimension="width", line_dash="dotted"))
        return plot

    def _histogram_figure(self) -> Any:
        plot = figure(height=110, toolbar_location=None, tools="", x_range=Range1d(0, self._highest), y_axis_type="log")
        plot.y_range.start = 0.5
        plot.xaxis.axis_label, plot.yaxis.axis_label = "DN", "pixels"
        plot.step("dn", "n", source=self._histogram_source, mode="after", line_color="#555555")
        return plot


def _histogram(values: Any, highest: float) -> dict[str, Any]:
    step = max(1, round((values.size / _SAMPLE) ** 0.5))
    counts, edges = np.histogram(values[::step, ::step], bins=_N_BINS, range=(0, highest + 1))
    # Empty bins are below the axis, which is logarithmic.
    return {"dn": edges[:-1], "n": np.maximum(counts, 0.1)}


def _ending(end: Callable[[], None]) -> Callable[[Any], None]:
    return lambda _session: end()
