"""Run the plan of a session: light frames, readings and dark frames that are not recorded yet."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from datetime import UTC, datetime

from ..core.clock import Clock, SystemClock, exposure_text
from ..core.errors import InputError, SessionError
from ..core.roi import Roi
from ..drivers.camera import Camera
from ..drivers.camera_settings import json_features
from ..drivers.meter import Meter
from ..report.text import finding_text
from ..session import EventRecord, Session
from ..session.records import EXPOSURES
from .checks import (
    CheckFinding,
    check_darkness,
    check_flicker,
    check_levels,
    check_meter_drift,
    check_repeats,
    check_scatter,
)
from .control import AcquisitionStoppedError, Announced, Control, Progress, Report
from .frames import FrameRecorder
from .live import measured_black_dn
from .operator import HandNeededError, LensCap, Operator
from .plan import (
    CHECK,
    Unit,
    before_and_after,
    certificate_findings,
    check_devices,
    check_plan,
    check_room,
    contrast_findings,
    prepare_camera,
    readings_wanted,
    records_of,
    remaining,
    shown_patches,
    units,
    was_checked,
)
from .recording import ReadingRecorder
from .search import LONGEST_S, SearchFrame, choose_exposures, measure_rates

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Left:
    """A skipped part of a plan that needs a manual step.

    Parameters
    ----------
    what : str
        The part of the plan.
    hand : str
        The manual step it needs.

    Examples
    --------
    >>> from labcdp.acquire import Left
    >>> Left("dark frames", "cover the lens").hand
    'cover the lens'
    """

    what: str
    hand: str


def acquire(
    session: Session,
    camera: Camera,
    meter: Meter,
    operator: Operator,
    report: Report = lambda _progress: None,
    clock: Clock | None = None,
    control: Control | None = None,
    bench: Announced | None = None,
) -> tuple[Left, ...]:
    """Record the missing parts of a session's plan.

    Frames are written while others are taken. After an interruption, calling this again takes only the rest.

    Parameters
    ----------
    session : Session
        Open for writing.
    camera, meter : Camera, Meter
        Open.
    operator : Operator
        Performs manual steps.
    report : callable
        Called after each frame and reading. It must not access the session, which another thread writes to.
    clock : Clock or None
        Clock for the schedule of the frames; None for the system clock.
    control : Control or None
        Pauses or stops the run from another thread.
    bench : Announced or None
        Simulated bench whose noise is to be the same in a resumed run.

    Returns
    -------
    tuple of Left
        Skipped parts that need a manual step, see `Unattended`; empty if the plan is complete.

    Raises
    ------
    DeviceError
        If a device fails.
    SessionError
        If data cannot be recorded, the disk is full, or recorded files are missing or have another size at the end.
    AcquisitionStoppedError
        If `control` requests a stop.

    Examples
    --------
    >>> from labcdp.acquire import Unattended, acquire
    >>> from labcdp.drivers import ReplayCamera, ReplayMeter
    >>> from labcdp.session import Session, example_session
    >>> session = Session.open(example_session())
    >>> with ReplayCamera(session) as camera, ReplayMeter(session) as meter:
    ...     acquire(session, camera, meter, Unattended())  # nothing is left of this plan
    ()
    """
    check_devices(camera, meter, session.configuration)
    if is_complete(session):
        session.require_files()
        return ()
    with _losses_named(session):
        _begin(session, camera, meter, report)
        control = control or Control()
        frames = FrameRecorder(session, camera, report, clock or SystemClock(), control, bench)
        frames.warm_up()
        run = _Run(session, operator, frames, ReadingRecorder(session, meter, operator, report, control, bench))
        left: list[Left] = []
        if session.exposures_s is None:
            try:
                _search(session, camera, operator, run.cap, frames, report)
            except HandNeededError as hand:
                left.append(Left("exposure search", str(hand)))
        left += run.all_units()
    # Anything may have been deleted since it was recorded.
    session.require_files()
    if not left:
        session.add_event("complete", {})
    return tuple(left)


@contextmanager
def _losses_named(session: Session) -> Iterator[None]:
    """Where the block ends early, name recorded files that were deleted or altered meanwhile.

    Who stops the block learns that data are not safe, by the SessionError; with another error, it is a warning.
    """
    try:
        yield
    except SessionError:
        raise
    except BaseException as error:
        try:
            session.require_files()
        except SessionError as lost:
            if isinstance(error, AcquisitionStoppedError) or not isinstance(error, Exception):
                raise
            _log.warning("%s", lost)
        raise


def _begin(session: Session, camera: Camera, meter: Meter, report: Report) -> None:
    """Prepare the camera, check the plan with it, and record the devices."""
    setup = prepare_camera(camera, session.configuration.camera)
    check_plan(camera, session.configuration)
    check_room(camera, session)
    now = datetime.now(UTC)
    for finding in (*contrast_findings(session.configuration), *certificate_findings(session.configuration, now)):
        report(Progress("plan", 0, 1, note=f"Warning: {finding_text(finding)}"))
    session.add_event("devices", {"camera": asdict(camera.identity), "meter": asdict(meter.identity)})
    session.add_event("camera setup", asdict(setup))
    not_understood = list(camera.not_understood)
    features = {"features": json_features(camera.features()), "not understood": not_understood}
    session.add_event("camera features", features | {"driver": camera.driver})
    if not_understood:
        _log.info("camera features left unchanged: %s", ", ".join(not_understood))


def is_complete(session: Session) -> bool:
    """Whether the whole plan is recorded and checked.

    Examples
    --------
    >>> from labcdp.acquire import is_complete
    >>> from labcdp.session import Session, example_session
    >>> is_complete(Session.open(example_session()))
    True
    """
    ended = any(isinstance(r, EventRecord) and r.kind == "complete" for r in session.records)
    return ended and remaining(session).complete


def _search(
    session: Session, camera: Camera, operator: Operator, cap: LensCap, frames: FrameRecorder, report: Report
) -> None:
    """Find exposures, record and report them."""
    shortest_s, longest_s = camera.exposure_range_s
    range_s = (shortest_s, max(min(longest_s, LONGEST_S), shortest_s))
    looks: list[float] = []
    cap.off()
    rates = []
    for shown in shown_patches(session.configuration):
        regions = frames.regions(shown)
        if shown is not None:
            operator.show_patch(shown)

        def look(exposure_s: float, regions: list[Roi] = regions) -> SearchFrame:
            looks.append(exposure_s)
            return SearchFrame.at(frames.preview(exposure_s), regions)

        rates += measure_rates(look, [region.name for region in regions], range_s)
    choice = choose_exposures(rates, range_s)
    applied = [frames.configure(exposure_s).exposure_s for exposure_s in choice.exposures_s]
    findings = [asdict(finding) for finding in choice.findings]
    content = {"exposures_s": applied, "frames": len(looks), "shares": choice.shares, "findings": findings}
    session.add_event(EXPOSURES, content)
    note = f"Exposures found: {', '.join(map(exposure_text, applied))}"
    report(Progress("exposure search", len(looks), len(looks), note=note))
    for finding in choice.findings:
        _log.warning("%s", finding)
    check_room(camera, session)


class _Run:
    """Units of a plan: each is taken, checked, and repeated if the operator decides so."""

    def __init__(self, session: Session, operator: Operator, frames: FrameRecorder, readings: ReadingRecorder) -> None:
        self.cap = LensCap(operator)
        self._session = session
        self._operator = operator
        self._frames = frames
        self._readings = readings
        self._plan = session.configuration.plan
        self._first = session.configuration.target.patches[0].name

    def all_units(self) -> list[Left]:
        """Take all units whose manual steps are possible; returns the others."""
        left = []
        for unit in units(self._session.configuration):
            if unit.kind != "readings" and self._session.exposures_s is None:
                left.append(Left(unit.name, "have the exposures searched first"))
                continue
            try:
                self._do(unit)
            except HandNeededError as hand:
                left.append(Left(unit.name, str(hand)))
        self.cap.leave_off()
        return left

    def _do(self, unit: Unit) -> None:
        again = True
        while again:
            taken = self._take(unit)
            if not taken and was_checked(self._session, unit):
                return
            findings = self._check(unit)
            again = bool(findings) and self._operator.repeat(unit.name, findings)
            for finding in () if again else findings:
                _log.warning("%s: %s", unit.name, finding)
            if again:
                # Before the check is recorded: if the run ends in between, the unit is repeated.
                reason = "; ".join(str(finding) for finding in findings)
                self._session.supersede(records_of(self._session, unit), reason)
                self._frames.forget()
            content = {"unit": unit.name, "findings": [asdict(f) for f in findings], "repeat": again}
            self._session.add_event(CHECK, content)

    def _take(self, unit: Unit) -> bool:
        """Take the missing data of a unit; returns whether any was missing."""
        rest = remaining(self._session)
        if unit.kind == "readings":
            assert unit.patch is not None
            return self._readings.point_and_record(unit.patch, readings_wanted(self._session.configuration)[unit.patch])
        if unit.kind == "dark":
            if rest.dark:
                self.cap.on()
                self._frames.record("dark", None, rest.dark)
            return bool(rest.dark)
        light = {exposure_s: n for (patch, exposure_s), n in rest.light.items() if patch == unit.patch}
        if unit.patch is None:
            return self._take_together(light)
        if light or unit.patch in rest.readings:
            self._take_patch(unit.patch, light)
            return True
        return False

    def _take_together(self, light: Mapping[float, int]) -> bool:
        n = self._plan.readings_per_patch
        if light:
            self.cap.off()
            self._look_first(None)
            if self._plan.drift_check:
                self._readings.point_and_record(self._first, n)
            self._frames.record("light", None, light)
        read = self._plan.drift_check and self._readings.point_and_record(self._first, 2 * n)
        return bool(light) or read

    def _take_patch(self, patch: str, light: Mapping[float, int]) -> None:
        n = self._plan.readings_per_patch
        self.cap.off()
        self._operator.show_patch(patch)
        if light:
            self._look_first(patch)
            self._readings.record(patch, n)
            self._frames.record("light", patch, light)
        self._readings.record(patch, 2 * n)

    def _look_first(self, shown: str | None) -> None:
        """Before the first frame is recorded, find patches that are saturated even at the shortest planned exposure.

        Raises
        ------
        InputError
            If all patches are: nothing of use would be recorded.
        """
        exposures_s = self._plan.exposures_s
        if exposures_s is None or any(frame.patch == shown for frame in self._session.frames("light")):
            return
        again = True
        while again:
            numbers = self._frames.preview_statistics(min(exposures_s), shown)
            findings = [finding for finding in check_levels(numbers) if finding.check == "saturation"]
            if shown is None and len(findings) == len(self._frames.regions(shown)):
                raise InputError(
                    f"all patches are saturated at {exposure_text(min(exposures_s))}, the shortest planned: "
                    "give shorter exposures, in s (0.005 is 5 ms), or dim the light; nothing was recorded"
                )
            again = bool(findings) and self._operator.repeat("look at the shortest exposure", findings)
            for finding in () if again else findings:
                _log.warning("%s", finding)

    def _check(self, unit: Unit) -> list[CheckFinding]:
        plan, findings = self._plan, []
        if unit.kind in ("light", "patch"):
            numbers = self._frames.numbers(unit.patch)
            findings += check_levels(numbers) + check_flicker(numbers, plan.largest_flicker_rel)
            findings += check_repeats(*self._frames.repeats(unit.patch, "light"))
        if unit.kind == "dark":
            light = [n for shown in shown_patches(self._session.configuration) for n in self._frames.numbers(shown)]
            dark = self._frames.numbers(None, "dark")
            findings += check_darkness(dark, light)
            if measured_black_dn((), light) is None:
                # Unknown when the light frames were checked.
                findings += [finding for finding in check_levels(light) if finding.check == "darkness"]
            findings += check_repeats(*self._frames.repeats(None, "dark"))
        if unit.kind == "readings":
            assert unit.patch is not None
            readings = [r.reading for r in self._session.readings() if r.patch == unit.patch]
            findings += check_scatter(unit.patch, readings, plan.largest_drift_rel)
        elif unit.kind == "patch" or (unit.kind == "light" and plan.drift_check):
            patch = unit.patch or self._first
            before, after = before_and_after(self._session, patch)
            for series in (before, after):
                findings += check_scatter(patch, series, plan.largest_drift_rel)
            findings += check_meter_drift(patch, before, after, plan.largest_drift_rel)
        return findings
