"""One tab of the live bench."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import panel as pn
from bokeh.models import CustomJS

from ...core.errors import LabcdpError
from ...drivers.camera_settings import CameraSettings
from ...evaluate.contrasts import parse_contrasts
from ...report.text import capitalised
from ..html import TINTED, beside, column, row
from ..numbers import parted
from ..regions.display import DisplayScale
from ..regions.map_tab import MapTab
from ..regions.page import WorkspacePage
from ..regions.wording import warning_list
from .cards import (
    Plots,
    camera_card,
    contrast_card,
    contrast_table,
    flicker_card,
    matrix_card,
    meter_card,
    pair_card,
    planned_table,
    reading_table,
    settings_text,
    uncalibrated_note,
)
from .live import LiveState
from .live_bench import LiveBench
from .matrix import MatrixPlot
from .pair import Target
from .tabs import CameraTab, RecordTab


def _contrasts(text: str) -> tuple[float, ...] | None:
    """Return contrasts as typed: a number, or a list of percentages and ranges; a comma may be that of a decimal."""
    parts = parted(text)
    if len(parts) == 1 and ":" not in parts[0]:
        parts = [f"{parts[0].removesuffix('%')}%"]
    elif len(parts) == 2 and parts[1] == "%":
        parts = ["".join(parts)]
    return parse_contrasts(parts, "the target contrast") if parts else None


def _written(target: Target) -> str:
    """Return the target contrasts as a person would type them."""
    contrasts = [f"{100 * contrast:g}" for contrast in target.contrasts or ()]
    return "%, ".join(contrasts) + "%" * (len(contrasts) > 1)


#: Height of the table of readings, which scrolls.
_READINGS_PX = 110
#: Height of the table of the plan's pairs by their number; of more it scrolls.
_PAIRS_PX = (0, 72, 112, 152, 192)
#: Choice of no region.
_NONE = "none"


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
        self._page = page = WorkspacePage(bench.workspace, document, self._may_change)
        self._picture, self._highest = page.picture, bench.images.highest_dn
        self._picture.show_scale(DisplayScale("gamma", 0.0, self._highest))
        self._picture.go_live()
        self._map = MapTab(page, False)
        names = ("strip", "readings", "findings", "contrasts", "pairs", "note")
        self._strip, self._table, self._findings, self._cdp, self._pairs, self._note = map(page.text, names)
        self._strip.styles = TINTED
        # The panes scroll, not their content, which each frame replaces.
        self._cdp.styles = {"overflow": "auto", "max-height": "9.6rem"}
        self._table.styles = {"overflow": "auto"}
        self._table.height = _READINGS_PX
        # Of one height whatever its numbers, which may need a second line.
        self._pairs.height, self._pairs.visible = _PAIRS_PX[min(len(bench.planned), 4)], bool(bench.planned)
        self._record, self._camera = RecordTab(bench, page), CameraTab(bench.camera, page)
        self._plots, self._matrix = Plots(bench), MatrixPlot()
        self._control = pn.widgets.Button(name="Take control", button_type="primary", margin=(3, 8))
        self._control.on_click(lambda _event: self._take_control())
        field = page.field
        request = bench.camera.request
        close: dict[str, Any] = {"margin": (3, 5)}
        self._first, self._second = (
            field("Select", name, self._choose, options=[_NONE], **close | {"width": 205})
            for name in ("Contrast of", "and of")
        )
        self._exposure = page.number(
            "Exposure", lambda ms: request(exposure_s=1e-3 * ms), unit="ms", width=100, **close
        )
        self._gain = page.number("Gain", lambda db: request(gain_db=db), unit="dB", value=0.0, width=65, **close)
        self._pause = field("Toggle", "Pause", lambda on: setattr(bench.images, "paused", on), margin=(3, 4))
        self._n_readings = page.number("Readings", limits=(1, 100), value=1, width=60, **close)
        self._typed = field("TextInput", "Reading of another meter (cd/m²), with Enter", width=250, **close)
        options: dict[str, Any] = {"placeholder": "measured", "width": 125, **close}
        self._contrast = field("TextInput", "Target contrast (%)", self._aim_contrast, **options)
        self._epsilon = page.number(
            "Tolerance ε", self._aim_epsilon, (0.001, 100), unit="%", value=50.0, width=100, **close
        )
        self._aimed: tuple[object, ...] = ()
        self._shown: tuple[CameraSettings | None, str] = (None, "")
        #: What only the controlling page may use.
        self._controls: list[Any] = []
        self._controlled = True
        self._connect()

    def tab(self) -> tuple[Any, CustomJS]:
        """Return the layout of the tab, and the script that starts with it."""
        plots = [pn.pane.Bokeh(figure, sizing_mode="stretch_width", margin=(4, 8)) for figure in self._plots.figures]
        self._matrix_pane = pn.pane.Bokeh(
            self._matrix.figure, sizing_mode="stretch_width", margin=(4, 8), visible=False
        )
        button = self._page.button
        live = column(
            self._pairs,
            row(self._first, self._second),
            row(self._contrast, self._epsilon, self._exposure, self._gain),
            row(
                button("Fit exposure", self.bench.fit_exposure),
                button("Read meter", self._take_readings),
                button("Note CDP", self._note_cdp),
                self._pause,
                margin=(0, 3),
            ),
            plots[0],
            row(self._n_readings, self._typed, button("Export log", self.bench.export_log, margin=(22, 4))),
            self._table,
            plots[1],
            plots[2],
            self._matrix_pane,
            # What comes and goes is below all that is pressed.
            self._cdp,
            self._note,
            self._findings,
        )
        tabs = pn.Tabs(
            ("Live", live),
            ("Camera", self._camera.layout()),
            ("Regions", self._page.side()),
            ("Luminance", self._map.layout()),
            ("Record", self._record.layout()),
            sizing_mode="stretch_both",
        )
        self._controls = [tab_index for control in (0, 1, 4) for tab_index in tabs[control].select(pn.widgets.Widget)]
        self.update()
        side = (*self._page.head(self._control), tabs)
        return beside(self._picture.figure, side, self._strip), self._picture.script()

    def update(self) -> None:
        """Refresh the tab."""
        bench = self.bench
        makers = (camera_card, pair_card, contrast_card, flicker_card, matrix_card, meter_card)
        cards = (make(bench) for make in makers)
        with self._page.quietly():
            self._pause.value = bench.images.paused
        self._strip.object = f"<div class='strip'>{''.join(cards)}</div>"
        self._show_settings(bench.camera.live)
        workspace = bench.workspace
        self._findings.object = warning_list(workspace.image, workspace.drawing, workspace.measured)
        self._table.object = reading_table(bench)
        self._cdp.object = contrast_table(bench)
        self._pairs.object = planned_table(bench)
        self._note.object = uncalibrated_note(bench)
        self._show_pair()
        self._show_control()
        self._follow_bits()
        self._matrix_pane.visible = bench.matrix is not None
        self._matrix.update(bench.matrix)
        if self._plots.update(bench):
            self._camera.update(bench.camera.live, settings_text(bench.camera.live))

    def _show_newest(self) -> None:
        """Show the newest image, when it comes or when the browser has drawn the one before."""
        self._picture.renew(self.bench.images.newest)

    def _point(self, position: list[int]) -> None:
        if self._may_change():
            self.bench.images.pointer = position

    def _connect(self) -> None:
        self._page.on_enter(self._typed, self._enter)
        self._page.messages_above, self._page.messages_below = self._question_messages, self._status_messages
        self._page.acts["delete reading"] = self._delete
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

    def _question_messages(self) -> list[tuple[str, str]]:
        """Return the question of a recording, which is shown above all other messages."""
        return [("question", self.bench.question)]

    def _status_messages(self) -> list[tuple[str, str]]:
        """Return the messages about work, camera and log."""
        bench = self.bench
        busy = "" if bench.question else bench.busy
        return [
            (kind, words)
            for kind, words in (
                ("info", busy),
                ("warning", capitalised(bench.displaced)),
                ("warning", bench.images.mismatch),
                ("warning", bench.camera.live.error),
                ("warning", bench.log.error),
            )
        ]

    def _enter(self, text: str) -> None:
        if text:
            self.bench.enter_reading(text)
            self._typed.value = ""

    def _delete(self, message: dict[str, Any]) -> None:
        number = message.get("number")
        if type(number) is int:
            self.bench.delete_reading(number)

    def _choose(self, _name: str) -> None:
        first, second = (
            None if selector.value == _NONE else selector.value for selector in (self._first, self._second)
        )
        self._page.do({"do": "pair", "first": first, "second": second})

    def _aim_contrast(self, text: str) -> None:
        self.bench.aim(replace(self.bench.target, contrasts=_contrasts(text)))

    def _aim_epsilon(self, percent: float) -> None:
        self.bench.aim(replace(self.bench.target, epsilon=percent / 100))

    def _note_cdp(self) -> None:
        try:
            n = self.bench.snapshot()
        except LabcdpError as error:
            self.bench.workspace.warn(error)
            return
        self.bench.workspace.say(f"{n} CDP noted in {self.bench.log.path}")

    def _show_pair(self) -> None:
        """Show the chosen pair and its target contrasts when one of these has changed."""
        drawing, target = self.bench.workspace.drawing, self.bench.target
        names = [_NONE, *(roi.name for roi in drawing.rois)]
        if (*names, *drawing.pair, target) == self._aimed:
            return
        self._aimed = (*names, *drawing.pair, target)
        with self._page.quietly():
            for widget, chosen in zip((self._first, self._second), drawing.pair, strict=True):
                widget.param.update(options=names, value=chosen or _NONE)
            self._contrast.value = _written(target)
        self._page.settle(self._contrast)
        self._page.show_number(self._epsilon, float(f"{100 * target.epsilon:.9g}"))

    def _show_settings(self, live: LiveState) -> None:
        """Show what was read back when it has changed, also by another program, or when a request was rejected."""
        settings, shown = live.settings, (live.settings, live.error)
        if settings is None or shown == self._shown:
            return
        self._shown = shown
        low, high = live.exposure_range_s
        self._exposure.limits = 1e3 * low, 1e3 * high
        self._page.show_number(self._exposure, float(f"{1e3 * settings.exposure_s:.6g}"))
        self._page.show_number(self._gain, settings.gain_db)

    def _take_readings(self) -> None:
        self.bench.take_readings(self._n_readings.value)
