"""The tab that guides a recording of the plan."""

from __future__ import annotations

from datetime import datetime
from math import ceil
from typing import Any

import panel as pn

from ..html import items, text
from ..look import column, row
from ..regions.page import Page
from .live_bench import LiveBench
from .recording import Question

#: In the browser: give the focus to the answer of a question once it is shown, so that Enter answers it, except while
#: somebody types elsewhere.
_FOCUS = """
let focused = document.activeElement
while (focused?.shadowRoot?.activeElement)
  focused = focused.shadowRoot.activeElement
if (cb_obj.visible && !["INPUT", "SELECT", "TEXTAREA"].includes(focused?.tagName))
  setTimeout(() => Bokeh.index.find_one(cb_obj)?.el.shadowRoot.querySelector("button, input")?.focus(), 100)
"""
#: What may be recorded again, besides patches.
_NOTHING, _UNITS = "nothing", ("light frames", "dark frames")


class RecordTab:
    """Name of the session, the question of the moment, and progress.

    Parameters
    ----------
    bench : LiveBench
        State common to all tabs.
    page : Page
        The tab of the browser.
    """

    def __init__(self, bench: LiveBench, page: Page) -> None:
        self._bench = bench
        self._name = pn.widgets.TextInput(
            name="Folder of the session", value=f"session-{datetime.now():%Y%m%d-%H%M}", width=250
        )
        self._start = page.button("Record the plan", self._record, button_type="primary")
        self._pause = page.button("Pause recording", self._hold)
        self._stop = page.button("Stop recording", self._end)
        self._first = page.button("Done", lambda: self._press(0), button_type="primary", visible=False)
        self._second = page.button("Keep", lambda: self._press(1), button_type="primary", visible=False)
        self._typed = pn.widgets.TextInput(name="Reading, with Enter", width=250, visible=False)
        self._again = pn.widgets.Select(name="Record again", options=[_NOTHING], width=180)
        self._dismiss = page.button("Dismiss findings", self._forget_findings, visible=False)
        self._state = page.text("record")
        self._asked: Question | None = None
        page.on_enter(self._typed, lambda words: self._answer(words) if words else None)
        for widget in (self._first, self._typed):
            widget.jscallback(visible=_FOCUS)

    def layout(self) -> Any:
        """Return the tab."""
        return column(
            row(self._name, self._again),
            row(self._start, self._pause, self._stop),
            self._state,
            row(self._typed, self._first, self._second, margin=(0, 5)),
            self._dismiss,
        )

    def update(self, controlled: bool) -> None:
        """Refresh the tab of a page that may change something, or only look on."""
        bench, recording = self._bench, self._bench.recording
        running = recording is not None and bool(bench.busy)
        self._start.disabled = not controlled or bool(bench.busy or bench.unrecordable)
        self._name.disabled = self._again.disabled = running or not controlled
        self._again.options = [_NOTHING, *_UNITS, *(roi.name for roi in bench.workspace.drawing.rois)]
        self._pause.disabled = self._stop.disabled = not (running and controlled)
        question = recording.operator.question if recording is not None and running else None
        if question is not self._asked:
            self._asked, self._typed.value = question, ""
        self._typed.visible = question is not None and question.typed
        self._typed.disabled = not controlled
        self._dismiss.visible = recording is not None and bool(recording.operator.findings)
        answers = question.answers if question is not None else ()
        for place, button in enumerate((self._first, self._second)):
            button.visible, button.disabled = place < len(answers), not controlled
            if place < len(answers):
                button.name = answers[place]
        if recording is not None:
            self._pause.name = "Resume recording" if recording.control.paused else "Pause recording"
        self._state.object = self._text()

    def _text(self) -> str:
        bench, recording = self._bench, self._bench.recording
        if recording is None:
            if bench.unrecordable or bench.plan is None:
                return f"<p class='quiet'>{text(bench.unrecordable)}</p>"
            return (
                f"<p class='quiet'>Records the plan “{text(bench.plan.name)}” with the regions of this page as "
                "patches, then calibrates the camera and writes the report. An interrupted session is resumed under "
                "its name.</p>"
            )
        parts = []
        question = recording.operator.question if bench.busy else None
        if question is not None:
            asked = f"<b>{text(question.text)}</b>{items(question.findings)}"
            parts.append(f"<div class='notice warning' role='alert'>{asked}</div>")
        progress = recording.progress
        if progress is not None:
            left = _left(recording.remaining_s) if bench.busy else ""
            parts.append(f"<p>{text(progress.step)}: {progress.done} of {progress.total}{left}</p>")
            parts.append(f"<progress max='{max(progress.total, 1)}' value='{progress.done}'></progress>")
        if recording.operator.findings:
            parts.append(f"<h2>Findings</h2>{items(recording.operator.findings)}")
        if recording.outcome:
            parts.append(f"<p role='status'>{text(recording.outcome)}</p>")
        if recording.report is not None:
            parts.append("<p><a href='/report/report.html' target='_blank'>Open the report</a></p>")
        return "".join(parts)

    def _record(self) -> None:
        again = [] if self._again.value == _NOTHING else [self._again.value]
        self._again.value = _NOTHING
        self._bench.record(self._name.value_input or self._name.value, again)

    def _forget_findings(self) -> None:
        if self._bench.recording is not None:
            self._bench.recording.operator.findings = ()
            self._bench.workspace.changed()

    def _end(self) -> None:
        if self._bench.recording is not None:
            self._bench.recording.stop()

    def _hold(self) -> None:
        recording = self._bench.recording
        if recording is not None:
            (recording.control.resume if recording.control.paused else recording.control.pause)()
            self._bench.workspace.changed()

    def _press(self, number: int) -> None:
        if self._asked is not None:
            self._answer(self._asked.answers[number])

    def _answer(self, words: str) -> None:
        if self._bench.recording is not None:
            self._bench.recording.operator.answer(self._asked, words)


def _left(time_s: float | None) -> str:
    if time_s is None:
        return ""
    return f", about {ceil(time_s / 60)} min left" if time_s > 90 else f", about {ceil(time_s)} s left"
