"""One tab of the live bench."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import Any

import panel as pn
from bokeh.models import CustomJS

from ...core.errors import LabcdpError
from ...drivers.camera_settings import CameraSettings
from ...evaluate.contrasts import parse_contrasts
from ..html import TINTED, beside, column, row, text
from ..regions.display import DisplayScale
from ..regions.map_tab import MapTab
from ..regions.page import Page
from ..regions.wording import warning_list
from .cards import (
    Plots,
    camera_card,
    contrast_card,
    contrast_table,
    meter_card,
    pair_card,
    reading_table,
    settings_text,
)
from .live import Live
from .live_bench import LiveBench
from .pair import Target
from .tabs import CameraTab, RecordTab


def _contrasts(text: str) -> tuple[float, ...] | None:
    """Return contrasts as typed: a number, also with a decimal comma, or a list of percentages and ranges."""
    single = text.strip().removesuffix("%").strip().replace(",", ".")
    with suppress(ValueError):
        float(single)
        text = f"{single}%"
    return parse_contrasts(text.split(","), "the target contrast") if text.strip() else None


def _written(target: Target) -> str:
    """Return the target contrasts as a person would type them."""
    contrasts = [f"{100 * one:g}" for one in target.contrasts or ()]
    return "%,".join(contrasts) + "%" * (len(contrasts) > 1)


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
        self._page = page = Page(bench.workspace, document, self._may_change)
        self._picture, self._highest = page.picture, bench.images.highest_dn
        self._picture.show_scale(DisplayScale("gamma", 0.0, self._highest))
        self._picture.go_live()
        self._map = MapTab(page, False)
        names = ("strip", "table", "notice", "findings", "contrasts")
        self._strip, self._table, self._notice, self._findings, self._cdp = map(page.text, names)
        self._strip.styles = TINTED
        # The pane scrolls, not its content, which each frame replaces.
        self._cdp.styles = {"overflow": "auto", "max-height": "9.6rem"}
        self._record, self._camera = RecordTab(bench, page), CameraTab(bench.camera, page)
        self._plots = Plots(bench)
        self._control = pn.widgets.Button(name="Take control", button_type="primary", margin=(3, 8))
        self._control.on_click(lambda _event: self._take_control())
        field = page.field
        request = bench.camera.request
        self._exposure = page.number("Exposure (ms)", lambda ms: request(exposure_s=1e-3 * ms), width=130)
        self._gain = page.number("Gain (dB)", lambda db: request(gain_db=db), width=110)
        self._pause = field("Toggle", "Pause", lambda on: setattr(bench.images, "paused", on), margin=(3, 4))
        self._n_readings = page.number("Readings", limits=(1, 100), value=1, width=80)
        self._typed = field("TextInput", "Reading of another meter (cd/m²), with Enter", width=260)
        options: dict[str, Any] = {"placeholder": "measured", "value": _written(bench.target), "width": 170}
        self._contrast = field("TextInput", "Target contrast (%)", self._aim_contrast, **options)
        options = {"value": 100 * bench.target.epsilon, "width": 130}
        self._epsilon = page.number("Tolerance ε (%)", self._aim_epsilon, (0.001, 100), **options)
        self._shown: tuple[CameraSettings | None, str] = (None, "")
        #: What only the controlling page may use.
        self._controls: list[Any] = []
        self._controlled = True
        self._connect()

    def tab(self) -> tuple[Any, CustomJS]:
        """Return the layout of the tab, and the script that starts with it."""
        plots = [pn.pane.Bokeh(one, sizing_mode="stretch_width", margin=(4, 8)) for one in self._plots.figures]
        live = column(
            row(self._contrast, self._epsilon),
            self._cdp,
            plots[0],
            plots[1],
            row(self._exposure, self._gain),
            row(
                self._page.button("Fit exposure", self.bench.fit_exposure),
                self._page.button("Read meter", self._take_readings),
                self._pause,
                margin=(0, 3),
            ),
            self._findings,
            plots[2],
            row(self._n_readings, self._typed),
            self._table,
        )
        tabs = pn.Tabs(
            ("Live", live),
            ("Camera", self._camera.layout()),
            ("Regions", self._page.side()),
            ("Luminance", self._map.layout()),
            ("Record", self._record.layout()),
            sizing_mode="stretch_both",
        )
        self._controls = [one for place in (0, 1, 4) for one in tabs[place].select(pn.widgets.Widget)]
        self.update()
        side = (*self._page.head(), self._notice, self._control, tabs)
        return beside(self._picture.figure, side, self._strip), self._picture.script()

    def update(self) -> None:
        """Refresh the tab."""
        bench = self.bench
        cards = (camera_card(bench), pair_card(bench), contrast_card(bench), meter_card(bench))
        with self._page.quietly():
            self._pause.value = bench.images.paused
        self._strip.object = f"<div class='strip'>{''.join(cards)}</div>"
        self._show_settings(bench.camera.live)
        workspace = bench.workspace
        self._findings.object = warning_list(workspace.image, workspace.drawing, workspace.measured)
        self._table.object = reading_table(bench)
        self._cdp.object = contrast_table(bench)
        self._cdp.visible = bool(self._cdp.object)
        self._show_control()
        self._follow_bits()
        said = (bench.question or bench.busy, bench.images.mismatch, bench.camera.live.error)
        words = "<br>".join(text(one) for one in dict.fromkeys(said) if one)
        how = "class='notice warning' role='alert'" if bench.question else "class='notice' role='status'"
        self._notice.object = f"<div {how}>{words}</div>" if words else ""
        if self._plots.update(bench):
            self._camera.update(bench.camera.live, settings_text(bench.camera.live))

    def _show_newest(self) -> None:
        """Show the newest image, when it comes or when the browser has drawn the one before."""
        self._picture.renew(self.bench.images.newest)

    def _point(self, place: list[int]) -> None:
        if self._may_change():
            self.bench.images.pointer = place

    def _connect(self) -> None:
        self._page.on_enter(self._typed, self._enter)
        for end in (
            self.bench.camera.look(),
            self.bench.images.listen(lambda: self._page.soon(self._show_newest, 0)),
            self._leave,
        ):
            self._page.at_end(end)
        link = self._picture.link
        link.on_change("tab", lambda _attr, _old, _new: self._arrive())
        link.on_change("drawn", lambda _attr, _old, _new: self._show_newest())
        link.on_change("pointer", lambda _attr, _old, new: self._point(new))
        self._page.after_update.append(self.update)

    def _may_change(self) -> bool:
        """Whether this page controls the bench."""
        return self.bench.controller[0] is self

    def _arrive(self) -> None:
        """Control the bench if nobody does."""
        if self.bench.controller[1] in ("", self._picture.link.tab):
            self._take_control()

    def _take_control(self) -> None:
        self.bench.controller = (self, self._picture.link.tab)
        self.bench.workspace.changed()

    def _leave(self) -> None:
        if self._may_change():
            self.bench.controller = (None, "")
            self.bench.workspace.changed()

    def _show_control(self) -> None:
        """Enable or disable what changes something, and offer to take control."""
        controlled = self._may_change()
        if controlled != self._controlled:
            self._controlled = controlled
            for widget in self._controls:
                widget.disabled = not controlled
        self._control.visible = not controlled
        self._record.update(controlled)

    def _follow_bits(self) -> None:
        """Follow the highest DN, which changes with the pixel format."""
        highest = self.bench.images.highest_dn
        if highest != self._highest:
            self._highest = highest
            self._map.show_range(DisplayScale("gamma", 0.0, highest))

    def _enter(self, text: str) -> None:
        if text and self.bench.enter_reading(text):
            self._typed.value = ""

    def _aim_contrast(self, text: str) -> None:
        try:
            self.bench.aim(replace(self.bench.target, contrasts=_contrasts(text)))
        except LabcdpError as error:
            self.bench.workspace.warn(error)

    def _aim_epsilon(self, percent: float) -> None:
        self.bench.aim(replace(self.bench.target, epsilon=percent / 100))

    def _show_settings(self, live: Live) -> None:
        """Show what was read back when it has changed, also by another program, or when a request was rejected."""
        settings, shown = live.settings, (live.settings, live.error)
        if settings is None or shown == self._shown:
            return
        self._shown = shown
        with self._page.quietly():
            self._exposure.value, self._gain.value = float(f"{1e3 * settings.exposure_s:.6g}"), settings.gain_db

    def _take_readings(self) -> None:
        self.bench.take_readings(self._n_readings.value)
