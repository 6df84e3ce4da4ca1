"""The tabs of camera and recording: settings and features, read back; and what guides a recording of the plan."""

from __future__ import annotations

import re
from dataclasses import astuple
from datetime import datetime
from math import ceil
from typing import Any

from ...core.dn import PIXEL_FORMATS
from ...core.errors import InputError
from ...drivers.camera_settings import CameraSettings, FeatureDescription, FeatureValue, Region
from ..html import column, items, row, table, table_row, text
from ..numbers import coordinates
from ..regions.page import WorkspacePage
from .live import LiveState
from .live_bench import LiveBench
from .live_camera import LiveCamera
from .recording import OperatorQuestion

#: Features that change how many pixels of the sensor are one of the image.
_OF_PIXELS = ("Binning", "Decimation")
#: Rows of the table of features.
_MOST_ROWS = 60


class CameraTab:
    """Pixel format, frame rate, black level, region, and any GenICam feature.

    Parameters
    ----------
    camera : LiveCamera
        The camera.
    page : WorkspacePage
        The tab of the browser.
    """

    def __init__(self, camera: LiveCamera, page: WorkspacePage) -> None:
        self._camera, self._page = camera, page
        self._settings, self._table = page.text("camera settings"), page.text("features")
        field, request = page.field, camera.request
        self._format = field("Select", "Pixel format", lambda name: request(pixel_format=name), width=150)
        self._rate = page.number("Frames per second", lambda hz: request(frame_rate_hz=hz), width=130)
        self._black = page.number("Black level", lambda dn: request(black_level=dn), unit="register", width=140)
        self._region = field("TextInput", "Region: x, y, width, height", self._set_region, width=210)
        self._find = field("TextInput", "Find features", placeholder="part of a name", width=140)
        self._feature = field("TextInput", "Set a feature", placeholder="Gamma = 1", width=180)
        self._refresh = page.button("Read again", camera.read_features, margin=(19, 4))
        self._shown: tuple[CameraSettings | None, tuple[FeatureDescription, ...], str] = (None, (), "")
        page.on_enter(self._feature, self._set_feature)
        self._find.param.watch(lambda _event: self._list(), "value")

    def layout(self) -> Any:
        """Return the tab."""
        return column(
            row(self._format, self._rate, self._black),
            row(self._region),
            row(self._feature, self._find, self._refresh),
            self._settings,
            self._table,
        )

    def update(self, live: LiveState, settings_text: str) -> None:
        """Refresh the tab."""
        self._settings.object = settings_text
        settings, features = live.settings, live.features
        if settings is None or (settings, features, live.error) == self._shown:
            return
        self._shown = (settings, features, live.error)
        choices = next((feature.choices for feature in features if feature.name == "PixelFormat"), ())
        formats = dict.fromkeys(
            [*(pixel_format for pixel_format in choices if pixel_format in PIXEL_FORMATS), settings.pixel_format]
        )
        rate_hz = settings.frame_rate_hz
        page = self._page
        with page.quietly():
            self._format.param.update(options=list(formats), value=settings.pixel_format)
            self._region.value = ", ".join(f"{n}" for n in astuple(settings.region))
        page.settle(self._region)
        page.show_number(self._rate, None if rate_hz is None else float(f"{rate_hz:.6g}"))
        page.show_number(self._black, settings.black_level)
        self._list()

    def _set_region(self, text: str) -> None:
        parts = coordinates(text, 4)
        if any(part != int(part) or part < 0 for part in parts):
            raise InputError("the region is four whole numbers: x, y, width, height")
        self._camera.request(region=Region(*map(int, parts)))

    def _set_feature(self, text: str) -> None:
        if not text:
            return
        name, _, given = (part.strip() for part in text.partition("="))
        known = {feature.name.lower(): feature for feature in self._camera.live.features}.get(name.lower())
        value = None if known is None else _value(known, given)
        if known is None or value is None:
            raise InputError(f"{text!r} is not understood: write NAME = VALUE as in the table below")
        n = len(self._page.workspace.drawing.shapes)
        if n and known.name.startswith(_OF_PIXELS):
            raise InputError(
                f"{known.name} changes the image, and the {n} regions would no longer match: delete the regions first, "
                "or set binning in [camera] of the plan"
            )
        self._camera.request(**{known.name: value})
        self._feature.value = ""

    def _list(self) -> None:
        wanted = self._find.value.lower()
        matches = [feature for feature in self._camera.live.features if wanted in feature.name.lower()]
        shown = matches[:_MOST_ROWS]
        rows = (
            table_row(text(feature.name), (f"{_number(feature.value)} {feature.unit}", _range(feature)))
            for feature in shown
        )
        more = f"<p class='quiet'>{len(matches) - _MOST_ROWS} more</p>" if len(matches) > _MOST_ROWS else ""
        self._table.object = table(("Feature", "value", "possible"), rows, "dense features") + more


def _value(feature: FeatureDescription, text: str) -> FeatureValue | None:
    """Read a text as a value of the feature's type; None if it is not such a value."""
    kind = type(feature.value)
    if kind is bool:
        return {"true": True, "1": True, "false": False, "0": False}.get(text.lower())
    try:
        return kind(text if kind is str else text.replace(",", ".")) if text else None
    except ValueError:
        return None


def _range(feature: FeatureDescription) -> str:
    if not feature.writable:
        return "read only"
    if feature.choices:
        return ", ".join(feature.choices)
    return "" if feature.limits is None else " to ".join(map(_number, feature.limits))


def _number(value: FeatureValue) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


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


#: Height of the answers of a question.
_ANSWER_PX = 60


class RecordTab:
    """Name of the session, the question of the moment, and progress.

    Parameters
    ----------
    bench : LiveBench
        State common to all tabs.
    page : WorkspacePage
        The tab of the browser.
    """

    def __init__(self, bench: LiveBench, page: WorkspacePage) -> None:
        self._bench = bench
        name = f"session-{datetime.now():%Y%m%d-%H%M}"
        self._name = page.field("TextInput", "Folder of the session", value=name, width=250)
        self._start = page.button("Record the plan", self._record, button_type="primary")
        self._pause = page.button("Pause recording", self._hold)
        self._stop = page.button("Stop recording", self._end)
        self._first = page.button("Done", lambda: self._press(0), button_type="primary", visible=False)
        self._second = page.button("Keep", lambda: self._press(1), button_type="primary", visible=False)
        self._typed = page.field("TextInput", "Reading, with Enter", width=250, visible=False)
        self._again = page.field("Select", "Record again", options=[_NOTHING], width=180)
        self._dismiss = page.button("Dismiss findings", self._forget_findings, visible=False)
        self._state = page.text("record")
        self._shown_question: OperatorQuestion | None = None
        page.on_enter(self._typed, lambda words: self._answer(words) if words else None)
        for widget in (self._first, self._typed):
            widget.jscallback(visible=_FOCUS)

    def layout(self) -> Any:
        """Return the tab."""
        return column(
            row(self._name, self._again),
            row(self._start, self._pause, self._stop),
            # Room for the question, so that nothing moves when one comes.
            row(self._typed, self._first, self._second, self._dismiss, margin=(0, 5), min_height=_ANSWER_PX),
            self._state,
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
        if question is not self._shown_question:
            self._shown_question, self._typed.value = question, ""
        self._typed.visible = question is not None and question.typed
        self._typed.disabled = not controlled
        self._dismiss.visible = recording is not None and bool(recording.operator.findings)
        answers = question.answers if question is not None else ()
        for index, button in enumerate((self._first, self._second)):
            button.visible, button.disabled = index < len(answers), not controlled
            if index < len(answers):
                button.name = answers[index]
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
        if question is not None and question.findings:
            # The question itself is above all tabs.
            parts.append(f"<div class='notice warning' role='alert'>{items(question.findings)}</div>")
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
        if self._shown_question is not None:
            self._answer(self._shown_question.answers[number])

    def _answer(self, words: str) -> None:
        if self._bench.recording is not None:
            if self._shown_question is not None and self._shown_question.typed:
                # A comma in a field is that of a decimal; the meter's driver refuses it where it might part thousands.
                words = re.sub(r"(?<=[0-9]),(?=[0-9])", ".", words)
            self._bench.recording.operator.answer(self._shown_question, words)


def _left(time_s: float | None) -> str:
    if time_s is None:
        return ""
    return f", about {ceil(time_s / 60)} min left" if time_s > 90 else f", about {ceil(time_s)} s left"
