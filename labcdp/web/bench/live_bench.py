"""State of the live bench, common to all tabs: camera, meter, regions, and what they show."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Event, Thread
from time import monotonic, sleep
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import CalibrationError, InputError, LabcdpError
from ...core.frame import Frame
from ...core.reading import Reading, ReadingSeries
from ...drivers.meter import Meter, MeterError, MeterLostError
from ..regions.measurements import Evaluated, Measurements
from ..regions.page_image import PageImage
from ..regions.workspace import Workspace
from .exposure import better_exposure_s
from .focus import sharpness
from .live_camera import LiveCamera
from .measured import BenchOfPage, LiveMeasurements, MeterReading, Target, meter_reading
from .pair import PairPoint, cdp_curve, pair_point
from .plan import with_regions
from .recording import PageOperator, Recording

if TYPE_CHECKING:
    from ...evaluate.picture.light.picture import PictureConversion
    from ..server import Server

#: Most images per second; more are not seen.
_MOST_HZ = 12.0
#: Length of the trace of the CDP.
TRACE_S = 180.0
#: How often the page looks whether frames are overdue.
_LOOK_S = 0.5
#: Attempts to fit the exposure, and time for a frame with the new one.
_MOST_ATTEMPTS, _ATTEMPT_S = 10, 20.0
#: Seconds between two curves of the CDP.
_CURVE_S = 1.0
#: Longest wait for a meter that was unplugged.
_METER_S = 60.0
#: Longest wait for a recording that was stopped.
_END_S = 120.0


class LiveBench:
    """Camera, meter and regions of the live page.

    Parameters
    ----------
    camera : LiveCamera
        Not started.
    conversion : PictureConversion
        To cd/m^2, or to relative luminance.
    devices : BenchOfPage
        Meter, plan and the simulated bench, as far as there are any.
    server : Server
        Runs the page.
    target : Target
        What is to be detected at first.
    """

    def __init__(
        self,
        camera: LiveCamera,
        conversion: PictureConversion,
        devices: BenchOfPage,
        server: Server,
        target: Target,
    ) -> None:
        self.camera, self.meter, self.plan = camera, devices.meter, devices.plan
        self.recording: Recording | None = None
        self.target = target
        self.readings: tuple[MeterReading, ...] = ()
        self.trace: tuple[PairPoint, ...] = ()
        #: Contrasts, and the CDP of the pair at each.
        self.curve: tuple[NDArray[Any], NDArray[Any]] = (np.empty(0), np.empty(0))
        self._curve_s = 0.0
        #: Work in progress, what to tell the person, and why there is no cd/m^2 with a calibration.
        self.busy, self.notice, self.mismatch = "", "", ""
        self.paused = False
        #: The one page that may change anything, and its name, which a tab of a browser keeps while it reloads.
        self.controller: tuple[object, str] = (None, "")
        #: Sharpness of the newest image, and the largest of the same part so far.
        self.focus = (0.0, 0.0)
        self._focus_of: str | None = None
        self._conversion, self._hands, self._server = conversion, devices.hands, server
        self._workspace: Workspace | None = None
        self._seen: Evaluated | None = None
        self._bit_depth = 16
        self._thread = Thread(target=self._watch, name="live images", daemon=True)

    @property
    def workspace(self) -> Workspace:
        """Regions and their measurements."""
        assert self._workspace is not None, "the bench has begun"
        return self._workspace

    @property
    def highest_dn(self) -> float:
        """Highest DN of the camera's converter."""
        return 2.0**self._bit_depth - 1

    def measurements(self, frame: Frame) -> Measurements:
        """Return measurements of a frame, in relative luminance where the calibration is not for it."""
        contrasts = None if self.target.contrast is None else (self.target.contrast,)
        self._bit_depth = frame.bit_depth
        try:
            image = PageImage.of_frame("live", frame, self._conversion)
            self.mismatch = ""
        except CalibrationError as error:
            from ...evaluate.picture.light.picture import picture_conversion

            image = PageImage.of_frame("live", frame, picture_conversion(None, None, None))
            self.mismatch = f"The calibration does not apply: {error}"
        return LiveMeasurements(image, contrasts, self.target.epsilon)

    def begin(self, workspace: Workspace) -> None:
        """Start camera and page, in the server's thread."""
        self._workspace = workspace
        workspace.listen(self._follow)
        workspace.begin()
        self.camera.start()
        self._thread.start()

    def end(self) -> None:
        """Stop a recording, and release the camera."""
        if self.recording is not None:
            self.recording.stop()
            # What is being written is completed first.
            self.recording.ended.wait(_END_S)
        self.camera.stop()

    def aim(self, **changes: float | None) -> None:
        """Change the target contrast, its tolerance or the limit."""
        self.target = replace(self.target, **changes)  # type: ignore[arg-type]
        self.trace = ()

    def take_readings(self, n: int) -> None:
        """Take readings of the meter, for the selected region."""
        workspace, meter = self.workspace, self.meter
        if meter is None or self.busy:
            return
        region = workspace.selected or ""
        self._work("The meter measures …", self._readings(meter, region, n))

    def enter_reading(self, luminance_cd_m2: float) -> None:
        """Take a reading that a person typed, of another meter, for the selected region."""
        self._note(luminance_cd_m2, self.workspace.selected or "")
        self.workspace.changed()

    def record(self, name: str) -> None:
        """Record the plan with the regions of the page, into a folder of the current one."""
        if self.busy:
            return
        try:
            if self.plan is None or self.meter is None:
                raise InputError("a plan and a meter are needed: start labcdp bench with PLAN and --meter")
            if not name or Path(name).name != name or name.startswith("."):
                raise InputError("the session needs a plain name of a folder")
            plan = with_regions(self.plan, self.workspace.drawing.shapes)
        except LabcdpError as error:
            self._say(str(error))
            self.workspace.changed()
            return
        self.notice = ""
        recording = self.recording = Recording(Path(name), plan, PageOperator(self._ask, self._hands))
        self._work(f"Recording {name}", recording.run(self.camera, self.meter, self._tell))

    @property
    def results(self) -> Path | None:
        """Folder of the last report."""
        report = None if self.recording is None else self.recording.report
        return None if report is None else report.parent

    def _tell(self) -> None:
        self._server.call(self.workspace.changed)

    def _ask(self) -> None:
        """Show the question of the acquisition, and select the patch that it is about."""
        question = None if self.recording is None else self.recording.operator.question
        patch = question.patch if question is not None else ""
        if patch:
            self._server.call(partial(self.workspace.select, patch))
        self._tell()

    def fit_exposure(self) -> None:
        """Fit the exposure to the regions, or to the whole image if there are none."""
        if not self.busy:
            self._work("The exposure is fitted …", self._fitting())

    def _work(self, what: str, steps: Iterator[str]) -> None:
        self.busy = what

        def done() -> None:
            self.busy = ""
            self.workspace.changed()

        self.workspace.changed()
        self._server.elsewhere(steps, self._say, done)

    def _say(self, text: str) -> None:
        self.notice = text

    def _readings(self, meter: Meter, region: str, n: int) -> Iterator[str]:
        try:
            if self._hands is not None and region:
                self._hands.point_meter(region)
            taken: list[Reading] = []
            while len(taken) < n:
                try:
                    taken.append(meter.measure())
                except MeterLostError as error:
                    yield f"The meter is lost and waited for: {error}"
                    self._reopen(meter, error)
            self._note(ReadingSeries(tuple(taken)), region)
            yield ""
        except LabcdpError as error:
            yield f"No reading: {error}"

    def _reopen(self, meter: Meter, lost: MeterLostError) -> None:
        """Wait for a meter that was unplugged; raises `lost` if it does not come back."""
        until_s = monotonic() + _METER_S
        while monotonic() < until_s and not self.camera.ended:
            meter.close()
            sleep(_LOOK_S)
            with suppress(MeterError):
                meter.open()
                return
        raise lost

    def _note(self, taken: ReadingSeries | float, region: str) -> None:
        """Add what the meter says, or a person typed, with what the camera sees there now."""
        one = meter_reading(taken, region, self.workspace.image, self.workspace.drawing.rois)
        self.readings = (one, *self.readings[:19])

    def _fitting(self) -> Iterator[str]:
        for _ in range(_MOST_ATTEMPTS):
            live = self.camera.live
            if live.frame is None or live.settings is None:
                break
            frame = live.frame
            rois = self.workspace.drawing.rois
            inside = [roi.select(frame.dn) for roi in rois] or [frame.dn.ravel()]
            brightest = max(inside, key=lambda values: float(values.mean()))
            better_s = better_exposure_s(brightest, frame.exposure_s, frame.bit_depth, live.exposure_range_s)
            if better_s is None:
                yield ""
                return
            self.camera.request(exposure_s=better_s)
            if not self._has_another_exposure(frame.exposure_s):
                yield "The exposure cannot be fitted: the camera does not take it"
                return
        yield "The exposure cannot be fitted: there is too much or too little light"

    def _has_another_exposure(self, exposure_s: float) -> bool:
        """Wait for a frame with another exposure; False if none comes."""
        until_s = monotonic() + _ATTEMPT_S
        while (live := self.camera.live).frame is None or live.frame.exposure_s == exposure_s:
            if live.error or monotonic() > until_s:
                return False
            self.camera.wait_for_news(live, _LOOK_S)
        return True

    def _follow(self) -> None:
        """Add the newest result of the pair to the trace."""
        evaluated = self.workspace.evaluated
        if evaluated is self._seen:
            return
        same = self._seen is not None and _names(self._seen) == _names(evaluated)
        self._seen = evaluated
        kept = self.trace if same else ()
        result = None if evaluated.pair is None else evaluated.pair.result
        point = None if result is None else pair_point(result, monotonic(), self.target.limit)
        if point is not None:
            self.trace = (*(one for one in kept if point.time_s - one.time_s < TRACE_S), point)

    def _focus(self, frame: Frame) -> None:
        """Compare the sharpness of the selected region, or of the middle of the image, with the best so far."""
        selected = self.workspace.selected
        height, width = frame.dn.shape
        rows, columns = (slice(length // 4, length - length // 4) for length in (height, width))
        for roi in self.workspace.drawing.rois:
            if roi.name == selected:
                (left, top), (right, bottom) = (
                    np.clip(edge(roi.corners, axis=0), 0, (width, height)) for edge in (np.min, np.max)
                )
                rows, columns = slice(int(top), int(bottom)), slice(int(left), int(right))
        now = sharpness(frame.dn[rows, columns])
        best = self.focus[1] if selected == self._focus_of else 0.0
        self.focus, self._focus_of = (now, max(now, best)), selected

    def _draw_curve(self, measurements: Measurements) -> None:
        """Compute, now and then, the CDP of the pair over the contrast to be detected."""
        pair, point = self.workspace.drawing.pair_rois, self.trace[-1] if self.trace else None
        if len(pair) < 2 or point is None or monotonic() - self._curve_s < _CURVE_S:
            return
        self._curve_s = monotonic()
        self.curve = cdp_curve(measurements.image.luminance, pair, point.contrast, self.target.epsilon)

    def _watch(self) -> None:
        """Hand the newest frame to the page, and tell it when frames are overdue."""
        live, frame, shown = self.camera.live, None, Event()
        while not self.camera.ended:
            live = self.camera.wait_for_news(live, _LOOK_S)
            if live.frame is None or live.frame is frame or self.paused:
                self._server.call(self.workspace.changed)
                continue
            began_s, frame = monotonic(), live.frame
            self._focus(frame)
            try:
                measurements = self.measurements(frame)
                self._server.call(partial(self.workspace.renew, measurements))
                self._draw_curve(measurements)
            except LabcdpError as error:
                self.notice = str(error)
            # Not faster than the page's thread, and not faster than anybody sees.
            shown.clear()
            self._server.call(shown.set)
            shown.wait(5)
            sleep(max(0.0, 1 / _MOST_HZ - (monotonic() - began_s)))


def _names(evaluated: Evaluated) -> tuple[str, str] | None:
    pair = evaluated.pair
    return None if pair is None else (pair.first.name, pair.second.name)
