"""Devices of an acquisition: real ones with an operator, the simulated bench, or a recorded session."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from ...acquire import Operator, Unattended
from ...core.clock import Clock
from ...core.disk import read_text
from ...core.errors import InputError
from ...drivers.aravis.camera import AravisCamera
from ...drivers.camera import Camera, CameraError, IncompleteFrameError
from ...drivers.manual import CsvMeter, ManualMeter, stated_accuracy
from ...drivers.meter import Meter
from ...drivers.minolta_ls.line import NamedPort, Port
from ...drivers.minolta_ls.meter import DRIVERS
from ...drivers.minolta_ls.protocol import MeterMode
from ...drivers.replay import ReplayCamera, ReplayMeter
from ...drivers.simulated.bench import SimulatedBench
from ...drivers.simulated.control import free_loopback_address
from ...drivers.simulated.devices import SimulatedBenchFile
from ...session import EventRecord, MeterConfiguration, PlanConfiguration, Session, SessionConfiguration
from ...session.records import SIMULATED_BENCH
from ..terminal import say
from .device_options import DeviceChoice
from .operators import Console, ConsoleOperator, CsvOperator, RecordingOperator

#: Duration of a reading of the simulated meter; the real one needs about 0.8 s.
SIMULATED_RESPONSE_S = 0.05
#: Attempts for a reading that arrives late, incomplete or garbled.
_METER_ATTEMPTS = 3


@dataclass(frozen=True)
class Devices:
    """Open camera and meter, and the operator for manual steps.

    Parameters
    ----------
    camera : Camera
        Open.
    meter : Meter
        Open.
    operator : Operator
        The user, or the simulated bench.
    transport : str
        Description of how the camera is connected.
    """

    camera: Camera
    meter: Meter
    operator: Operator
    transport: str


@contextmanager
def connected(
    session: Session, choice: DeviceChoice, clock: Clock, console: Console, unattended_operator: Unattended | None
) -> Iterator[Devices]:
    """Open the devices of a session while the context lasts.

    Parameters
    ----------
    session : Session
        Says which devices.
    choice : DeviceChoice
        What the options say.
    clock : Clock
        Of simulated and recorded devices.
    console : Console
        Where the user is asked.
    unattended_operator : Unattended or None
        Replaces the operator of an unattended acquisition.

    Raises
    ------
    DeviceError
        If a device is absent, busy or silent.
    InputError
        If a file given as an option cannot be read or is not valid.
    """
    if choice.replay is not None:
        opened = _replayed(session, choice.replay, choice.speed, clock)
    elif choice.simulated:
        opened = _simulated(session, choice, clock, console)
    else:
        opened = _real(session, choice, console)
    with opened as devices:
        operator: Operator = unattended_operator or devices.operator
        # Readings from a file need no pointing.
        if isinstance(devices.meter, CsvMeter):
            operator = CsvOperator(operator, devices.meter, session)
        yield replace(devices, operator=operator)


@contextmanager
def _real(session: Session, choice: DeviceChoice, console: Console) -> Iterator[Devices]:
    configuration = session.configuration
    wanted = configuration.camera
    selector = choice.camera or wanted.serial or wanted.address or wanted.model
    with ExitStack() as stack:
        camera = stack.enter_context(AravisCamera(selector, patience_s=choice.patience))
        described = configuration.meter
        meter: Meter
        if described.entry == "by hand":
            meter = stack.enter_context(ManualMeter(console.ask, described.identity, stated_accuracy(described)))
        elif described.entry == "csv":
            assert described.file is not None
            meter = stack.enter_context(CsvMeter(described.file, described.identity, stated_accuracy(described)))
        else:
            port = choice.meter or described.port
            assert port is not None, "checked before the session is made"
            meter = serial_meter(stack, described, port, choice)
        yield Devices(camera, meter, ConsoleOperator(console), "Aravis")


@contextmanager
def _replayed(session: Session, path: Path, speed: float | None, clock: Clock) -> Iterator[Devices]:
    recorded = Session.open(path)
    _refuse_other_replay(session, recorded)
    if session.exposures_s is None and recorded.exposures_s is not None:
        # Result of the recorded search, whose frames were not kept.
        session.add_event("exposures", {"exposures_s": list(recorded.exposures_s), "found in": str(path)})
    with ReplayCamera(recorded, speed, clock) as camera, ReplayMeter(recorded, speed, clock) as meter:
        yield Devices(camera, meter, RecordingOperator(), "a recorded session")


def _taken(plan: PlanConfiguration) -> dict[str, object]:
    """Return the parts of a plan that determine its frames and readings and their order."""
    return plan.model_dump(exclude={"interval_s", "largest_flicker_rel", "largest_drift_rel"})


def _refuse_other_replay(session: Session, recorded: Session) -> None:
    """Refuse to replay a session with another target or plan."""
    if session.frames() or session.readings():
        raise InputError(
            f"{session.path} already has frames or readings, but a replay starts from the beginning: give a new folder"
        )
    both = (session.configuration, recorded.configuration)
    here, there = ({"target": c.target, "plan": _taken(c.plan)} for c in both)
    for key in here:
        if here[key] != there[key]:
            raise InputError(
                f"[{key}] of the configuration differs from the recording {recorded.path}: use the session.toml of the "
                "recording"
            )


@contextmanager
def _simulated(session: Session, choice: DeviceChoice, clock: Clock, console: Console) -> Iterator[Devices]:
    faults = "" if choice.faults is None else read_text(choice.faults, "a schedule of faults", 2**20)
    described = simulated_bench_file(choice.simulated_bench)
    devices = described.devices(choice.simulated_bench)
    with (
        SimulatedBench(session.configuration, devices, clock=clock, n_records=len(session.records)) as bench,
        ExitStack() as stack,
    ):
        if choice.virtual_clock:
            camera = stack.enter_context(bench.in_process_camera(patience_s=choice.patience))
            meter = serial_meter(stack, session.configuration.meter, bench.in_process_port(), choice)
            opened = Devices(camera, meter, bench, "in this process")
        else:
            opened = stack.enter_context(
                simulated_devices(session.configuration, bench, choice.patience, choice.transcript)
            )
        note_bench(session, described)
        bench.schedule(faults, str(choice.faults))
        yield replace(opened, operator=ConsoleOperator(console, bench)) if choice.rehearse else opened


def simulated_bench_file(path: Path | None, seed: int | None = None) -> SimulatedBenchFile:
    """Read the file of a simulated bench, None for the standard one, with another seed if there is one."""
    described = SimulatedBenchFile() if path is None else SimulatedBenchFile.load(path)
    return described if seed is None else described.model_copy(update={"seed": seed})


def note_bench(session: Session, described: SimulatedBenchFile) -> None:
    """Record which simulated bench it is; refuse to resume a session with another one."""
    begun = [r.content for r in session.records if isinstance(r, EventRecord) and r.kind == SIMULATED_BENCH]
    if not begun:
        session.add_event(SIMULATED_BENCH, described.model_dump(mode="json"))
    elif SimulatedBenchFile.model_validate(begun[-1]) != described:
        raise InputError(f"{session.path} was begun with another simulated bench: use that one, or a new folder")


@contextmanager
def simulated_devices(
    configuration: SessionConfiguration, bench: SimulatedBench, patience_s: float = 0.0, transcript: Path | None = None
) -> Iterator[Devices]:
    """Open the devices of a simulated bench: GigE Vision on loopback, or in this process if that fails."""
    with ExitStack() as stack:
        pty = stack.enter_context(bench.pty_meter(SIMULATED_RESPONSE_S))
        choice = DeviceChoice(patience=patience_s, transcript=transcript)
        meter = serial_meter(stack, configuration.meter, pty.port, choice)
        camera, transport = _simulated_camera(bench, stack, patience_s)
        yield Devices(camera, meter, bench, transport)


def _simulated_camera(bench: SimulatedBench, stack: ExitStack, patience_s: float) -> tuple[Camera, str]:
    try:
        with ExitStack() as trial:
            server = trial.enter_context(bench.gige_camera(free_loopback_address()))
            camera = trial.enter_context(AravisCamera(server.address, patience_s=patience_s))
            _try(camera)
            stack.push(trial.pop_all())
            return camera, "GigE Vision on loopback"
    except CameraError as error:
        say(f"The camera is simulated in this process, not over GigE Vision: {error}")
        return stack.enter_context(bench.in_process_camera(patience_s=patience_s)), "in this process"


def _try(camera: Camera) -> None:
    """Take a frame; fail only if two in a row are incomplete."""
    try:
        camera.snap()
    except IncompleteFrameError:
        camera.snap()


def serial_meter(stack: ExitStack, described: MeterConfiguration, port: str | Port, choice: DeviceChoice) -> Meter:
    """Open the meter on a port in the modes of the configuration; `stack` closes it."""
    corrections = {"colour": MeterMode.VARI_CCF, "luminance": MeterMode.VARI_LUMI, "both": MeterMode.VARI_CCF_LUMI}
    modes = [corrections.get(described.correction, MeterMode.PRESET), MeterMode[described.response.upper()]]
    meter = DRIVERS[described.model](
        NamedPort(port, described.rtscts) if isinstance(port, str) else port,
        described.identity,
        modes=modes,
        attempts=_METER_ATTEMPTS,
        patience_s=choice.patience,
        transcript=choice.transcript,
    )
    stack.enter_context(meter).ask_if_simulated()
    return meter
