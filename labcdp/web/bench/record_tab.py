"""The tab that guides a recording of the plan."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from html import escape
from typing import Any

import panel as pn

from ...report.digits import printable
from ..look import column, row
from .live_bench import LiveBench
from .recording import Question


class RecordTab:
    """Name of the session, the question of the moment, and progress.

    Parameters
    ----------
    bench : LiveBench
        State common to all tabs.
    html : function of a name
        Make a pane of HTML.
    guarded : function
        Make an action one that only the controlling page may do.
    """

    def __init__(
        self, bench: LiveBench, html: Any, guarded: Callable[[Callable[[Any], object]], Callable[[Any], None]]
    ) -> None:
        self._bench = bench
        self._name = pn.widgets.TextInput(
            name="Folder of the session", value=f"session-{datetime.now():%Y%m%d-%H%M}", width=250
        )
        self._start, self._pause, self._stop = (
            pn.widgets.Button(name=name, button_type=kind, margin=(3, 4))
            for name, kind in (
                ("Record the plan", "primary"),
                ("Pause recording", "default"),
                ("Stop recording", "default"),
            )
        )
        self._first, self._second = (
            pn.widgets.Button(name="Done", button_type="primary", visible=False) for _ in range(2)
        )
        self._state = html("record")
        self._asked: Question | None = None
        self._start.on_click(guarded(lambda _event: bench.record(self._name.value_input or self._name.value)))
        self._pause.on_click(guarded(lambda _event: self._hold()))
        self._stop.on_click(guarded(lambda _event: self._end()))
        for button in (self._first, self._second):
            button.on_click(guarded(lambda event: self._answer(event.obj.name)))

    def layout(self) -> Any:
        """Return the tab."""
        return column(
            row(self._name),
            row(self._start, self._pause, self._stop),
            self._state,
            row(self._first, self._second, margin=(0, 5)),
        )

    def update(self, controlled: bool) -> None:
        """Refresh the tab of a page that may change something, or only look on."""
        bench, recording = self._bench, self._bench.recording
        running = recording is not None and bool(bench.busy)
        self._start.disabled = not controlled or bool(bench.busy) or bench.plan is None or bench.desk.meter is None
        self._name.disabled = running or not controlled
        self._pause.disabled = self._stop.disabled = not (running and controlled)
        question = recording.operator.question if recording is not None and running else None
        self._asked = question
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
        if bench.plan is None or bench.desk.meter is None:
            return "<p class='quiet'>Recording needs a plan and a meter: start labcdp bench with PLAN and --meter.</p>"
        if recording is None:
            return (
                f"<p class='quiet'>Records the plan {_text(bench.plan.name)} with the regions of this page as "
                "patches, then calibrates the camera and writes the report. An interrupted session is resumed under "
                "its name.</p>"
            )
        parts = []
        question = recording.operator.question if bench.busy else None
        if question is not None:
            found = "".join(f"<li>{_text(one)}</li>" for one in question.findings)
            causes = f"<ul>{found}</ul>" if found else ""
            parts.append(f"<div class='notice warning' role='alert'><b>{_text(question.text)}</b>{causes}</div>")
        progress = recording.progress
        if progress is not None:
            parts.append(f"<p>{_text(progress.step)}: {progress.done} of {progress.total}</p>")
            parts.append(f"<progress max='{max(progress.total, 1)}' value='{progress.done}'></progress>")
            if progress.note:
                parts.append(f"<p>{_text(progress.note)}</p>")
        if bench.busy or recording.outcome:
            parts.append(f"<p role='status'>{_text(bench.busy or recording.outcome)}</p>")
        if recording.report is not None:
            parts.append("<p><a href='/report/report.html' target='_blank'>Open the report</a></p>")
        return "".join(parts)

    def _end(self) -> None:
        if self._bench.recording is not None:
            self._bench.recording.stop()

    def _hold(self) -> None:
        recording = self._bench.recording
        if recording is not None:
            (recording.control.resume if recording.control.paused else recording.control.pause)()
            self._bench.workspace.changed()

    def _answer(self, text: str) -> None:
        if self._bench.recording is not None:
            self._bench.recording.operator.answer(self._asked, text)


def _text(text: str) -> str:
    return escape(printable(text), quote=True)
