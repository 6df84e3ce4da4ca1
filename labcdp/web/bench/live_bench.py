"""State of the live bench, common to all tabs: camera, meter, regions, and what they show."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from functools import partial
from itertools import cycle, product
from math import isfinite
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError, LabcdpError
from ...core.frame import Readout
from ...core.reading import ReadingSeries
from ...core.roi import Roi
from ...drivers.camera_settings import CameraSettings
from ...drivers.manual import ManualMeter, stated_accuracy
from ..regions.drawing import Drawing
from ..regions.measurements import Measured, PairEvaluation, is_saturated
from ..regions.page_image import PageImage
from ..regions.workspace import Workspace
from .day_log import DayLog, SettingsInForce
from .desk import BenchOfPage, MeterDesk, name_of
from .flicker import FlickerTrace
from .images import LiveImages, fit_exposure
from .live_camera import LiveCamera
from .matrix import FEWEST_REGIONS, LiveMatrix, live_matrix
from .pair import LiveMeasurements, PairPoint, PlannedPair, Target, Trace, cdp_curve, pair_points, snapshots_of
from .recording import PageOperator, Recording, with_regions

if TYPE_CHECKING:
    from ...acquire import Progress
    from ...evaluate.picture.converter import Converter
    from ...metrics.modulation import Flicker
    from ...metrics.pair import Pair
    from ..server import Server

#: Seconds between two curves of the CDP.
_CURVE_S = 2.0
#: Seconds between the beginnings of two matrices of all regions.
_MATRIX_S = 0.25
#: Seconds between two evaluations of flicker.
_FLICKER_S = 3.0
#: Longest wait for a recording that was stopped.
_END_S = 120.0


class LiveBench:
    """Camera, meter and regions of the live page.

    Parameters
    ----------
    camera : LiveCamera
        Not started.
    converter : Converter
        To cd/m^2, or to relative luminance.
    devices : BenchOfPage
        Meter, plan and the simulated bench, as far as there are any.
    server : Server
        Runs the page.
    target : Target
        Target contrasts and tolerance of pairs that are not in the plan.
    planned : sequence of PlannedPair
        Pairs that are shown at a glance.
    log : DayLog
        Keeps readings, snapshots and settings.
    flicker : bool
        Whether the flicker of the chosen regions is shown.
    """

    def __init__(
        self,
        camera: LiveCamera,
        converter: Converter,
        devices: BenchOfPage,
        server: Server,
        target: Target,
        planned: Sequence[PlannedPair],
        log: DayLog,
        flicker: bool = False,
    ) -> None:
        self.camera, self.plan = camera, devices.plan
        lens = None if devices.plan is None else devices.plan.optics
        self.images = LiveImages(camera, converter, lens, server.call)
        self.desk = MeterDesk(devices.meter, devices.hands, self._seen, lambda: camera.ended, log)
        self.log = log
        self.recording: Recording | None = None
        self._noted: CameraSettings | None = None
        #: How the sensor was read out when regions were drawn.
        self._drawn_with: Readout | None = None
        self.planned = tuple(planned)
        #: The plan's pairs by turns, one for an image: all of them would take a second. Each as last measured, and the
        #: exposure and gain at which it was.
        self._turns = cycle(self.planned)
        self._evaluations: dict[PlannedPair, tuple[PairEvaluation, tuple[float, float] | None]] = {}
        self._target = target
        #: What a person wants to be detected, by the names of the regions.
        self._targets: dict[frozenset[str | None], Target] = {}
        self.trace = Trace()
        self._curve: tuple[tuple[object, ...], NDArray[Any], NDArray[Any]] = ((), np.empty(0), np.empty(0))
        self._curve_s = 0.0
        #: Flicker of the chosen regions, by their names, in the frames so far; None if it is not wanted.
        self.flicker: Mapping[str, Flicker] | None = {} if flicker else None
        self.flicker_trace = FlickerTrace(self._chosen_rois, lambda: self.images.black_dn)
        self._flicker_s = 0.0
        if flicker:
            camera.watchers.append(self.flicker_trace.add)
        #: All regions against all, where they are many; None of few.
        self.matrix: LiveMatrix | None = None
        self._matrix_s, self._matrix_begun = 0.0, False
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
        assert self._workspace is not None, "bench started"
        return self._workspace

    def measurements(self, image: PageImage) -> LiveMeasurements:
        """Return measurements of an image."""
        return LiveMeasurements(image, self.target_of, self._besides())

    def _besides(self) -> PlannedPair | None:
        """Return the pair of the plan whose turn it is, besides the chosen one."""
        if self._workspace is None:
            return None
        chosen = set(self.workspace.drawing.pair), self.target
        in_turn = (next(self._turns) for _ in self.planned)
        return next(
            (planned for planned in in_turn if ({planned.first, planned.second}, planned.target) != chosen), None
        )

    def target_of(self, drawing: Drawing) -> Target:
        """Return target contrasts and tolerance of the pair of a drawing: as typed, else by the plan."""
        pair = frozenset(drawing.pair)
        if pair in self._targets:
            return self._targets[pair]
        planned = [planned.target for planned in self.planned if {planned.first, planned.second} == pair]
        if not planned:
            return self._target
        same = [target for target in planned if target.epsilon == planned[0].epsilon]
        contrasts = sorted({contrast for target in same for contrast in target.contrasts or ()})
        return Target(tuple(contrasts) or None, planned[0].epsilon)

    @property
    def target(self) -> Target:
        """Target contrasts and tolerance of the chosen pair."""
        return self.target_of(self.workspace.drawing)

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
        """Change the target contrasts of the chosen pair, or their tolerance."""
        self._targets[frozenset(self.workspace.drawing.pair)] = target
        self.workspace.measure()
        self.workspace.changed()

    def take_readings(self, n: int) -> None:
        """Take readings of the meter, for the selected region."""
        meter = self.desk.meter
        if meter is not None and not self.busy:
            self._work("Reading the meter …", self.desk.take(meter, self.workspace.selected or "", n))

    def enter_reading(self, text: str) -> None:
        """Take a reading that a person typed, of another meter, for the selected region; raises InputError."""
        self.desk.enter(text, self.workspace.selected or "", None if self.plan is None else self.plan.meter)
        self.workspace.changed()

    def delete_reading(self, number: int) -> None:
        """Delete a reading; the log keeps it as deleted. Raises InputError if there is none."""
        self.log.delete(number)
        self.workspace.changed()

    def snapshot(self) -> int:
        """Note contrast and CDP of the chosen pair and of the plan's pairs in the log; returns how many.

        Raises
        ------
        InputError
            If nothing is measured.
        """
        measured = self.workspace.measured
        pairs_measured = [self.newest_evaluation(planned) for planned in self.planned]
        pairs_measured += [measured.pair] if self.pair is not None else []
        # The chosen pair may be one of the plan.
        pairs = {id(pair): pair for pair in pairs_measured if pair is not None and pair.result is not None}.values()
        if not pairs or measured.taken is None:
            raise InputError("there is no CDP to note: choose two regions first")
        unit, time = self.workspace.image.unit, self.log.time()
        notes = [note for pair in pairs for note in snapshots_of(pair, time, measured.taken, unit)]
        self.log.add(*dict.fromkeys(notes))
        return len(set(notes))

    def export_log(self) -> None:
        """Write the log of the day as a workbook, and say where."""
        frame = self.camera.live.frame

        def steps() -> Iterator[str]:
            try:
                path = self.log.export(frame is not None and frame.camera.simulated)
                yield f"Exported: {path}; the log itself is {self.log.path}"
            except LabcdpError as error:
                yield str(error)

        self._server.elsewhere(steps(), self.workspace.say, self.workspace.changed)

    @property
    def displaced(self) -> str:
        """Why the regions are at other places than they were drawn at; empty if they are not."""
        settings, drawn = self.camera.live.settings, self._drawn_with
        if settings is None or drawn is None or not self.workspace.drawing.shapes:
            return ""
        words = (
            f"{name} is {now[0]} x {now[1]}, but the regions were drawn with {before[0]} x {before[1]} and no "
            "longer match: set it back, or redraw them"
            for name in ("binning", "decimation")
            if (before := getattr(drawn, name)) != (now := getattr(settings.readout, name))
        )
        return "; ".join(words)

    def _note_settings(self) -> None:
        """Note settings that are in force since now."""
        settings = self.camera.live.settings
        if settings is not None and (self._drawn_with is None or not self.workspace.drawing.shapes):
            self._drawn_with = settings.readout
        if settings is None or settings == self._noted:
            return
        self._noted = settings
        names = [field.name for field in fields(SettingsInForce) if field.name != "time"]
        self.log.add(SettingsInForce(self.log.time(), **{name: getattr(settings, name) for name in names}))

    def fit_exposure(self) -> None:
        """Fit the exposure to the regions, or to the whole image if there are none."""
        if not self.busy:
            self._work("Fitting the exposure …", fit_exposure(self.camera, lambda: self.workspace.drawing.rois))

    @property
    def unrecordable(self) -> str:
        """Why no plan can be recorded; empty if one can."""
        if self.plan is None:
            return "Recording needs a plan: start labcdp bench with PLAN."
        if self.plan.meter.entry == "csv":
            return "The plan has readings from a file: record it with labcdp acquire."
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
        """The open question of the acquisition; empty without one."""
        current = None if self.recording is None or not self.busy else self.recording.operator.question
        return "" if current is None else current.text

    @property
    def pair(self) -> Pair | None:
        """Contrast and CDP of the chosen pair in the newest image; None until they are measured as asked for now."""
        pair, chosen, target = self.workspace.measured.pair, self.workspace.drawing.pair_rois, self.target
        is_current = pair is not None and pair.answers(chosen, target.contrasts, target.epsilon)
        return pair.result if pair is not None and is_current else None

    def newest_evaluation(self, pair: PlannedPair) -> PairEvaluation | None:
        """Return what was last measured of a pair of the plan with these settings; None if nothing was."""
        request = pair.rois(self.workspace.drawing), pair.target.contrasts, pair.target.epsilon
        chosen, (besides, taken) = self.workspace.measured.pair, self._evaluations.get(pair, (None, None))
        if chosen is not None and chosen.answers(*request):
            return chosen
        is_current = besides is not None and besides.answers(*request) and taken == self.workspace.measured.taken
        return besides if is_current else None

    @property
    def points(self) -> tuple[PairPoint, ...]:
        """The chosen pair in the newest image at each target contrast; empty until it is measured as asked for now."""
        return self.trace.newest if self.pair is not None and self.trace.of == self._request else ()

    @property
    def curve(self) -> tuple[NDArray[Any], NDArray[Any]]:
        """Contrasts, and the CDP of the chosen pair at each; empty until they are computed."""
        of, contrasts, values = self._curve
        return (contrasts, values) if of == self._request else (np.empty(0), np.empty(0))

    @property
    def _request(self) -> tuple[object, ...]:
        """The chosen regions as drawn now, with their target contrasts and tolerance."""
        return (*self.workspace.drawing.pair_rois, self.target)

    def _seen(self) -> tuple[PageImage, tuple[Roi, ...]]:
        return self.workspace.image, self.workspace.drawing.rois

    def _progressed(self, progress: Progress) -> None:
        if progress.reading is not None:
            # Shown like other readings, with what the camera sees in the patch.
            patch, reading = progress.reading
            self.desk.note(ReadingSeries((reading,)), f"{name_of(reading.meter)}, recording", patch)
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

    def _chosen_rois(self) -> tuple[Roi, ...]:
        """Return the regions of the chosen pair, or else the selected one."""
        if self._workspace is None:
            return ()
        drawing, selected = self._workspace.drawing, self._workspace.selected
        return drawing.pair_rois or tuple(roi for roi in drawing.rois if roi.name == selected)

    def _follow_flicker(self) -> None:
        """Evaluate the flicker of the chosen regions now and then."""
        if self.flicker is None or monotonic() - self._flicker_s < _FLICKER_S:
            return
        self._flicker_s = monotonic()
        self._server.elsewhere(self.flicker_trace.measured(), partial(setattr, self, "flicker"), lambda: None)

    def _follow_matrix(self) -> None:
        """Compute the matrix of all regions of the newest image, four times a second if the computer is fast enough."""
        rois = self.workspace.drawing.rois
        if len(rois) < FEWEST_REGIONS:
            self.matrix = None
            return
        if self._matrix_begun or monotonic() - self._matrix_s < _MATRIX_S:
            return
        self._matrix_s, self._matrix_begun = monotonic(), True
        steps = live_matrix(self.workspace.image, rois, self.target)
        done = partial(setattr, self, "_matrix_begun", False)
        self._server.elsewhere(steps, partial(setattr, self, "matrix"), done)

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
        self._note_settings()
        self._follow_flicker()
        self._follow_matrix()
        measured = self.workspace.measured
        if measured is self._measured:
            return
        for pair, evaluation in product(self.planned, measured.others):
            if evaluation.answers(pair.rois(self.workspace.drawing), pair.target.contrasts, pair.target.epsilon):
                self._evaluations[pair] = evaluation, measured.taken
        self._measured, result, now_s, of = measured, self.pair, monotonic(), self._request
        points = () if result is None else pair_points(result, now_s)
        self.trace = self.trace.after(points, of)
        if result is None or not points or (of == self._curve[0] and now_s - self._curve_s < _CURVE_S):
            return
        if not isfinite(result.contrast.value) or is_saturated(result.a, result.b):
            self._curve = ((), np.empty(0), np.empty(0))
            return
        self._curve_s = now_s
        image, rois, epsilon = self.workspace.image, self.workspace.drawing.pair_rois, self.target.epsilon
        curves = ((of, *cdp_curve(image, rois, result.contrast.value, tolerance)) for tolerance in (epsilon,))
        self._server.elsewhere(curves, partial(setattr, self, "_curve"), lambda: None)
