"""Record the plan of a session with the regions of the page, guided by it: the same acquisition as on the terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Condition, Event
from time import monotonic
from typing import TYPE_CHECKING

from ...acquire import AcquisitionStoppedError, Control, acquire, forget
from ...acquire.control import STOPPED, no_bare_session, warnings_to
from ...acquire.operator import AskedOperator
from ...core.disk.text import numbered
from ...core.errors import InputError, LabcdpError, SessionError
from ...drivers.meter import Meter
from ...regions import Shape
from ...session import Session, SessionConfiguration
from ...session.configuration import PatchConfiguration, TargetConfiguration
from .live_camera import PATIENCE_S, LiveCamera

if TYPE_CHECKING:
    from ...acquire import CheckFinding, Operator
    from ...acquire.control import Progress


@dataclass(frozen=True)
class OperatorQuestion:
    """Question to the person at the bench.

    Parameters
    ----------
    text : str
        One sentence.
    patch : str
        Patch it is about; empty if none.
    answers : tuple of str
        Labels of the buttons; the first one continues.
    findings : tuple of str
        Findings that led to the question.
    typed : bool
        Whether the answer is typed instead.
    """

    text: str
    patch: str = ""
    answers: tuple[str, ...] = ("Done",)
    findings: tuple[str, ...] = ()
    typed: bool = False


class PageOperator(AskedOperator):
    """The person at the bench, asked on the page.

    Parameters
    ----------
    changed : function
        Called when there is another question.
    hands : Operator or None
        The simulated bench, which then does what the person confirmed.
    """

    def __init__(self, changed: Callable[[], None], hands: Operator | None) -> None:
        super().__init__(hands)
        self._changed = changed
        self._condition = Condition()
        self._question: OperatorQuestion | None = None
        self._answer: str | None = None
        self._ended = False
        #: What was found so far, until it is dismissed.
        self.findings: tuple[str, ...] = ()

    @property
    def question(self) -> OperatorQuestion | None:
        """The question that waits for its answer."""
        return self._question

    def answer(self, question: OperatorQuestion | None, text: str) -> None:
        """Answer a question; a late answer to an earlier one is ignored."""
        with self._condition:
            if question is not None and question is self._question:
                self._answer = text
                self._condition.notify_all()

    def end(self) -> None:
        """Stop asking: a question that waits ends the acquisition."""
        with self._condition:
            self._ended = True
            self._condition.notify_all()

    def request(self, step: str, patch: str = "") -> None:
        """Ask for a step."""
        self._ask(OperatorQuestion(f"{step}.", patch))

    def typed(self, prompt: str) -> str:
        """Ask for a text, as the reading of a meter without an interface."""
        return self._ask(OperatorQuestion(prompt, answers=(), typed=True))

    def find(self, text: str) -> None:
        """Show a finding until it is dismissed."""
        if text not in self.findings:
            self.findings = (*self.findings, text)
        self._changed()

    def repeat(self, what: str, findings: Sequence[CheckFinding]) -> bool:
        """Ask whether to repeat a unit; the findings stay on the page."""
        for finding in findings:
            self.find(f"{what}: {finding}")
        question = OperatorQuestion(f"Fix it and repeat the {what}?", "", ("Repeat", "Keep"), tuple(map(str, findings)))
        return self._ask(question) == "Repeat"

    def _ask(self, question: OperatorQuestion) -> str:
        with self._condition:
            self._question, self._answer = question, None
        self._changed()
        with self._condition:
            self._condition.wait_for(lambda: self._answer is not None or self._ended)
            self._question = None
        self._changed()
        return self._answered()

    def _answered(self) -> str:
        answer = self._answer
        if answer is None:
            raise AcquisitionStoppedError(STOPPED)
        return answer


class Recording:
    """An acquisition of a plan, its calibration and its report.

    Parameters
    ----------
    folder : Path
        Folder of the session; an interrupted one is resumed.
    configuration : SessionConfiguration
        The plan.
    operator : PageOperator
        Asks for manual steps.
    begun : function of a session
        Records in the session what its devices are, before they are used.
    """

    def __init__(
        self,
        folder: Path,
        configuration: SessionConfiguration,
        operator: PageOperator,
        begun: Callable[[Session], None] = lambda _session: None,
    ) -> None:
        self.folder, self.operator, self.control = folder, operator, Control()
        self.progress: Progress | None = None
        #: Page of the results, once there is one.
        self.report: Path | None = None
        #: How it ended; empty until then.
        self.outcome = ""
        self.ended = Event()
        self._configuration, self._begun = configuration, begun
        self._waiting: tuple[LiveCamera | Meter, ...] = ()
        #: When the current step began, and with how many done.
        self._since: tuple[str, float, int] = ("", 0.0, 0)

    @property
    def remaining_s(self) -> float | None:
        """Time that the current step still needs at its pace so far; None if that is not known."""
        progress, (_, since_s, before) = self.progress, self._since
        if progress is None or not before < progress.done < progress.total:
            return None
        return (progress.total - progress.done) * (monotonic() - since_s) / (progress.done - before)

    def stop(self) -> None:
        """Stop after the current frame; the same folder resumes."""
        self.control.stop()
        self.operator.end()
        for device in self._waiting:
            device.be_patient(0.0)

    def run(
        self,
        camera: LiveCamera,
        meter: Meter,
        changed: Callable[[Progress], None],
        again: Sequence[str] = (),
    ) -> Iterator[str]:
        """Record, calibrate and evaluate; yields what to tell the person meanwhile.

        Parameters
        ----------
        camera : LiveCamera
            Lends its camera meanwhile.
        meter : Meter
            Open.
        changed : function of the progress
            Called after each frame and reading.
        again : sequence of str
            Parts to record again, see `labcdp.acquire.forget`.
        """

        def report(progress: Progress) -> None:
            if progress.step != self._since[0]:
                self._since = (progress.step, monotonic(), progress.done)
            if progress.note:
                self.operator.find(progress.note)
            self.progress = progress
            changed(progress)

        try:
            with no_bare_session(self.folder), self._session() as session:
                self._begun(session)
                forget(session, again)
                self._waiting = camera, meter
                # One that did not come back in time was closed.
                meter.open()
                meter.be_patient(PATIENCE_S)
                with camera.lent() as lent, warnings_to(self.operator.find):
                    self.control.checkpoint()
                    acquire(session, lent, meter, self.operator, report, control=self.control)
                yield "Calibrating and evaluating …"
                self.report = _report(session)
        except LabcdpError as error:
            # Stopping also ends the wait for a lost device, which is no error then.
            why = STOPPED if self.control.stopped and not isinstance(error, SessionError) else error
            kept = f"; {self.folder} holds what was recorded" if self.folder.exists() else ""
            self.outcome = f"Stopped: {why}{kept}"
        else:
            self.outcome = f"Recorded in {self.folder}; report: {self.report}"
        finally:
            meter.be_patient(0.0)
            self.ended.set()
        yield ""

    def _session(self) -> Session:
        if not self.folder.exists():
            return Session.create(self.folder, self._configuration)
        session = Session.open(self.folder, writable=True)
        if session.configuration != self._configuration:
            session.close()
            raise LabcdpError(f"{self.folder} was started with another plan: choose another folder")
        return session


def _report(session: Session) -> Path:
    """Calibrate and evaluate a session into a new folder ``NAME-evaluate`` of the current one; returns its page."""
    from ...calibration import save
    from ...evaluate.bench.session import evaluate_session, observe_calibrated
    from ...evaluate.bench.session_page import session_files
    from ...evaluate.bench.session_result import session_result
    from ...output import ResultsFolder

    evaluation = evaluate_session(*observe_calibrated(session))
    result = session_result(evaluation)
    with ResultsFolder(_new_folder(f"{session.path.name}-evaluate"), "evaluate") as results:
        save(evaluation.calibration, results.path("calibration.json"))
        results.add(session_files(evaluation, result))
    return results.folder / "report.html"


def _new_folder(name: str) -> Path:
    """Return a folder that does not exist: earlier results stay."""
    paths = (Path(f"{name}{ending}") for ending in numbered("-{}"))
    return next(path for path in paths if not path.exists())


def with_regions(plan: SessionConfiguration, shapes: Sequence[Shape]) -> SessionConfiguration:
    """Return a plan whose patches are these regions, with the nominal luminances and contrasts of the names it has.

    Limits are those of the region, or of the patch where the region has none.

    Raises
    ------
    InputError
        If there is no region.
    """
    if not shapes:
        raise InputError("there are no regions: draw the patches of the target first")
    known = {patch.name: patch for patch in plan.target.patches}
    drawn = []
    for shape in shapes:
        for roi in shape.rois():
            old = known.get(roi.name)
            nominal, limits = (None, None) if old is None else (old.nominal_luminance_cd_m2, old.limits_cd_m2)
            if old is None or old.region() != roi:
                old = PatchConfiguration(
                    name=roi.name, roi=None, corners=roi.corners, nominal_luminance_cd_m2=nominal, limits_cd_m2=None
                )
            drawn.append(old.model_copy(update={"limits_cd_m2": shape.limits_cd_m2 or limits}))
    patches = tuple(drawn)
    if patches == plan.target.patches:
        return plan
    names = {patch.name for patch in patches}
    target = TargetConfiguration(name=plan.target.name, presentation=plan.target.presentation, patches=patches)
    contrasts = tuple(pair for pair in plan.contrasts if {pair.bright, pair.dark} <= names)
    return plan.model_copy(update={"target": target, "contrasts": contrasts})
