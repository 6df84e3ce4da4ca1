"""State of the live bench, common to all tabs: camera, meter, regions, and what they show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from math import isfinite
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError, LabcdpError
from ...core.reading import ReadingSeries
from ...core.roi import Roi
from ...drivers.manual import ManualMeter, stated_accuracy
from ..regions.measurements import Measured
from ..regions.page_image import PageImage
from ..regions.workspace import Workspace
from .desk import BenchOfPage, MeterDesk
from .images import LiveImages, fit_exposure
from .live_camera import LiveCamera
from .pair import LiveMeasurements, Target, Trace, cdp_curve, pair_points
from .recording import PageOperator, Recording, with_regions

if TYPE_CHECKING:
    from ...acquire import Progress
    from ...evaluate.picture.conversion import PictureConversion
    from ...metrics.pair import PairResult
    from ..server import Server

#: Seconds between two curves of the CDP.
_CURVE_S = 2.0
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
        self.camera, self.plan = camera, devices.plan
        self.images = LiveImages(camera, conversion, server.call)
        self.desk = MeterDesk(devices.meter, devices.hands, self._seen, lambda: camera.ended)
        self.recording: Recording | None = None
        self.target = target
        self.trace = Trace()
        #: Contrasts, and the CDP of the pair at each.
        self.curve: tuple[NDArray[Any], NDArray[Any]] = (np.empty(0), np.empty(0))
        self._curve_s = 0.0
        #: Work in progress.
        self.busy = ""
        #: The one page that may change anything, and its name, which a tab of a browser keeps while it reloads.
        self.controller: tuple[object, str] = (None, "")
        self._devices, self._server = devices, server
        self._workspace: Workspace | None = None
        self._measured: Measured | None = None

    @property
    def workspace(self) -> Workspace:
        """Regions and their measurements."""
        assert self._workspace is not None, "the bench has begun"
        return self._workspace

    def measurements(self, image: PageImage) -> LiveMeasurements:
        """Return measurements of an image."""
        return LiveMeasurements(image, self.target.contrasts, self.target.epsilon)

    def begin(self, workspace: Workspace) -> None:
        """Start camera and page, in the server's thread."""
        self._workspace = workspace
        workspace.listen(self._follow)
        workspace.begin()
        self.camera.start()
        self.images.start(workspace, self._measure)

    def end(self) -> None:
        """Stop a recording, and release the camera."""
        if self.recording is not None:
            self.recording.stop()
            # What is being written is completed first.
            self.recording.ended.wait(_END_S)
        self.camera.stop()

    def aim(self, target: Target) -> None:
        """Change the target contrasts or their tolerance."""
        self.target = target
        self.trace = Trace()

    def take_readings(self, n: int) -> None:
        """Take readings of the meter, for the selected region."""
        meter = self.desk.meter
        if meter is not None and not self.busy:
            self._work("The meter measures …", self.desk.take(meter, self.workspace.selected or "", n))

    def enter_reading(self, text: str) -> bool:
        """Take a reading that a person typed, of another meter, for the selected region; False if it is none."""
        try:
            self.desk.enter(text, self.workspace.selected or "", None if self.plan is None else self.plan.meter)
        except LabcdpError as error:
            self.workspace.warn(error)
            return False
        self.workspace.changed()
        return True

    def fit_exposure(self) -> None:
        """Fit the exposure to the regions, or to the whole image if there are none."""
        if not self.busy:
            self._work("The exposure is fitted …", fit_exposure(self.camera, lambda: self.workspace.drawing.rois))

    @property
    def unrecordable(self) -> str:
        """Why no plan can be recorded; empty if one can."""
        if self.plan is None:
            return "Recording needs a plan: start labcdp bench with PLAN."
        if self.plan.meter.entry == "csv":
            return "The plan has readings from a CSV file: record it with labcdp acquire."
        by_hand = self.plan.meter.entry == "by hand"
        return "" if by_hand or self.desk.meter else "Recording needs a meter: start labcdp bench with --meter."

    def record(self, name: str, again: Sequence[str] = ()) -> None:
        """Record the plan with the regions of the page into a folder of the current one, or parts of it again."""
        if self.busy or self.plan is None:
            return
        operator = PageOperator(self._ask, self._devices.hands)
        meter = self.desk.meter
        try:
            if not name or Path(name).name != name or name.startswith("."):
                raise InputError("the session needs a plain name of a folder")
            plan = with_regions(self.plan, self.workspace.drawing.shapes)
        except LabcdpError as error:
            self.workspace.warn(error)
            return
        if plan.meter.entry == "by hand":
            meter = ManualMeter(operator.typed, plan.meter.identity, stated_accuracy(plan.meter)).open()
        assert meter is not None, "the page offers no recording without"
        recording = self.recording = Recording(Path(name), plan, operator, self._devices.begun)
        self._work(f"Recording {name}", recording.run(self.camera, meter, self._progressed, again))

    @property
    def results(self) -> Path | None:
        """Folder of the last report."""
        report = None if self.recording is None else self.recording.report
        return None if report is None else report.parent

    @property
    def question(self) -> str:
        """What the acquisition asks now; empty if nothing."""
        asked = None if self.recording is None or not self.busy else self.recording.operator.question
        return "" if asked is None else asked.text

    @property
    def pair(self) -> PairResult | None:
        """Contrast and CDP of the chosen pair in the newest image; None if they cannot be evaluated."""
        pair = self.workspace.measured.pair
        return None if pair is None else pair.result

    def _seen(self) -> tuple[PageImage, tuple[Roi, ...]]:
        return self.workspace.image, self.workspace.drawing.rois

    def _progressed(self, progress: Progress) -> None:
        if progress.reading is not None:
            # Shown like other readings, with what the camera sees in the patch.
            patch, reading = progress.reading
            self.desk.note(ReadingSeries((reading,)), patch)
        self._tell()

    def _tell(self) -> None:
        self._server.call(self.workspace.changed)

    def _ask(self) -> None:
        """Show the question of the acquisition, and select the patch that it is about."""
        question = None if self.recording is None else self.recording.operator.question
        patch = question.patch if question is not None else ""
        if patch:
            self._server.call(partial(self.workspace.select, patch))
        self._tell()

    def _work(self, what: str, steps: Iterator[str]) -> None:
        self.busy = what

        def done() -> None:
            self.busy = ""
            self.workspace.changed()

        self.workspace.changed()
        self._server.elsewhere(steps, self.workspace.say, done)

    def _measure(self, image: PageImage | None) -> None:
        if image is None:
            self.workspace.changed()
        else:
            self.workspace.renew(self.measurements(image))

    def _follow(self) -> None:
        """Add the newest result of the pair to the trace, and now and then compute its curve."""
        measured = self.workspace.measured
        if measured is self._measured:
            return
        self._measured, pair = measured, measured.pair
        result, now_s = self.pair, monotonic()
        names = () if pair is None else (pair.first.name, pair.second.name)
        points = () if result is None else pair_points(result, now_s)
        self.trace = self.trace.after(points, names)
        if pair is None or result is None or not points or now_s - self._curve_s < _CURVE_S:
            return
        if not isfinite(result.contrast.value):
            return
        self._curve_s = now_s
        image, rois = self.workspace.image, (pair.first, pair.second)
        curves = (cdp_curve(image, rois, result.contrast.value, epsilon) for epsilon in (self.target.epsilon,))
        self._server.elsewhere(curves, partial(setattr, self, "curve"), lambda: None)
