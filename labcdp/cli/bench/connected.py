"""Devices of an acquisition: real ones with an operator, the simulated bench, or a recorded session."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from ipaddress import AddressValueError, IPv4Address
from pathlib import Path

from ...acquire import Announced, Operator, ShutterOperator, Unattended, repeated_units
from ...core.clock import Clock
from ...core.disk import read_text
from ...core.errors import InputError
from ...drivers.aravis.camera import AravisCamera
from ...drivers.camera import Camera, CameraError, take_again
from ...drivers.file_meter import FileMeter
from ...drivers.manual import ManualMeter, stated_accuracy
from ...drivers.meter import Meter
from ...drivers.minolta.models import configured_meter
from ...drivers.minolta.port import Port
from ...drivers.replay import ReplayCamera, ReplayMeter
from ...drivers.shutter import SerialShutter
from ...drivers.simulated.bench import SimulatedBench
from ...drivers.simulated.commands import parse_schedule
from ...drivers.simulated.control import free_loopback_address
from ...drivers.simulated.devices import SimulatedBenchFile
from ...session import EventRecord, MeterConfiguration, Session, SessionConfiguration
from ...session.records import SIMULATED_BENCH
from ..terminal import say
from .operators import Console, ConsoleOperator, FileMeterOperator, RecordingOperator, UnpointedOperator
from .options import DeviceOptions, Replay

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
    bench : Announced or None
        The simulated bench, which is told what is recorded next.
    """

    camera: Camera
    meter: Meter
    operator: Operator
    transport: str
    bench: Announced | None = None


@contextmanager
def connected(
    session: Session,
    options: DeviceOptions,
    replay: Replay,
    clock: Clock,
    console: Console,
    unattended_operator: Unattended | None,
) -> Iterator[Devices]:
    """Open the devices of a session while the context lasts.

    Parameters
    ----------
    session : Session
        Says which devices.
    options : DeviceOptions
        Which they are.
    replay : Replay
        Recorded session instead of devices.
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
    if replay.replay is not None:
        opened = _replayed(session, replay.replay, replay.speed, clock)
    elif options.simulating:
        opened = _simulated(session, options, clock, console)
    else:
        opened = _real(session, options, console)
    with opened as devices, ExitStack() as stack:
        operator: Operator = unattended_operator or devices.operator
        if options.shutter is not None:
            operator = ShutterOperator(stack.enter_context(SerialShutter(options.shutter)), operator)
        # Readings from a file need no pointing.
        if isinstance(devices.meter, FileMeter):
            operator = FileMeterOperator(operator, devices.meter, session)
        yield replace(devices, operator=operator)


@contextmanager
def _real(session: Session, options: DeviceOptions, console: Console) -> Iterator[Devices]:
    configuration = session.configuration
    wanted = configuration.camera
    selector = options.camera or wanted.serial or wanted.address or wanted.model
    with ExitStack() as stack:
        camera = stack.enter_context(AravisCamera(selector, patience_s=options.patience))
        described = configuration.meter
        meter: Meter
        if described.entry == "by hand":
            meter = stack.enter_context(ManualMeter(console.ask, described.identity, stated_accuracy(described)))
        elif described.entry == "csv":
            assert described.file is not None
            meter = stack.enter_context(FileMeter(described.file, described.identity, stated_accuracy(described)))
        else:
            port = options.meter or described.port
            assert port is not None, "checked before the session is made"
            meter = serial_meter(stack, described, port, options)
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


def _refuse_other_replay(session: Session, recorded: Session) -> None:
    """Refuse to replay a session with another target or plan."""
    if session.frames() or session.readings():
        raise InputError(
            f"{session.path} already has frames or readings, but a replay starts from the beginning: choose a new "
            "folder"
        )
    both = (session.configuration, recorded.configuration)
    # What determines the frames and readings and their order.
    plans = [
        configuration.plan.model_dump(exclude={"interval_s", "largest_flicker_rel", "largest_drift_rel"})
        for configuration in both
    ]
    for key, same in (("target", both[0].target == both[1].target), ("plan", plans[0] == plans[1])):
        if not same:
            raise InputError(
                f"[{key}] of the configuration differs from the recording {recorded.path}: use the session.toml of the "
                "recording"
            )


@contextmanager
def _simulated(session: Session, options: DeviceOptions, clock: Clock, console: Console) -> Iterator[Devices]:
    faults = "" if options.faults is None else read_text(options.faults, "a schedule of faults", 2**20)
    parse_schedule(faults, str(options.faults))
    described, begun = simulated_bench_file(options.simulated_bench), _begun_bench(session)
    if begun is not None:
        described = described.with_camera(begun.sensor.get("device_seed"))
    elif not options.virtual_clock:
        described = with_own_camera(described, options.simulated_bench)
    devices = described.devices(options.simulated_bench)
    with (
        SimulatedBench(session.configuration, devices, clock=clock, repeated=repeated_units(session)) as bench,
        simulated_devices(session.configuration, bench, options, console if options.rehearse else None) as opened,
    ):
        note_bench(session, described)
        bench.schedule(faults, str(options.faults))
        operator: Operator = opened.operator
        if options.rehearse:
            operator = ConsoleOperator(console, bench)
            if session.configuration.meter.entry == "csv":
                operator = UnpointedOperator(operator, bench)
        yield replace(opened, operator=operator)


def simulated_bench_file(path: Path | None, seed: int | None = None) -> SimulatedBenchFile:
    """Read the file of a simulated bench, None for the standard one, with another seed if there is one."""
    described = SimulatedBenchFile() if path is None else SimulatedBenchFile.load(path)
    return described if seed is None else described.model_copy(update={"seed": seed})


def with_own_camera(described: SimulatedBenchFile, path: Path | None, address: str | None = None) -> SimulatedBenchFile:
    """Return the bench with a camera of its own for each loopback address, by default the first free one."""
    try:
        number = int(IPv4Address(address or free_loopback_address())) - int(IPv4Address("127.0.0.1"))
    except AddressValueError:
        raise InputError(f"--address is {address!r}: give an IPv4 address such as 127.0.0.2") from None
    except CameraError:
        return described  # it will be in this process
    return described.with_camera(described.devices(path).chain.sensor.device_seed + number) if number > 0 else described


def _begun_bench(session: Session) -> SimulatedBenchFile | None:
    """Return the simulated bench that a session was begun with."""
    begun = [r.content for r in session.records if isinstance(r, EventRecord) and r.kind == SIMULATED_BENCH]
    return SimulatedBenchFile.model_validate(begun[-1]) if begun else None


def note_bench(session: Session, described: SimulatedBenchFile) -> None:
    """Record which simulated bench it is; refuse to resume a session with another one."""
    begun = _begun_bench(session)
    if begun is None:
        session.add_event(SIMULATED_BENCH, described.model_dump(mode="json"))
    elif begun != described:
        raise InputError(f"{session.path} was started with another simulated bench: use that one, or a new folder")


@contextmanager
def simulated_devices(
    configuration: SessionConfiguration,
    bench: SimulatedBench,
    options: DeviceOptions | None = None,
    console: Console | None = None,
) -> Iterator[Devices]:
    """Open the devices of a simulated bench: GigE Vision on loopback, or in this process if that fails or is faster.

    With a console, a person types what a meter without an interface shows, which the question says.
    """
    options = options or DeviceOptions(patience=0.0)
    virtual, camera, transport = options.virtual_clock, None, "in this process"
    with ExitStack() as stack:
        meter: Meter
        if configuration.meter.is_connected:
            pty = None if virtual else stack.enter_context(bench.pty_meter(SIMULATED_RESPONSE_S))
            port = bench.in_process_port() if pty is None else pty.port
            meter = serial_meter(stack, configuration.meter, port, options)
        else:
            meter = stack.enter_context(_written_meter(configuration.meter, bench, console))
        if not virtual:
            try:
                camera, transport = _gige_camera(bench, stack, options.patience), "GigE Vision on loopback"
            except CameraError as error:
                say(f"The simulated camera runs inside this process instead of on the network: {error}")
        if camera is None:
            camera = stack.enter_context(bench.in_process_camera(patience_s=options.patience))
        yield Devices(camera, meter, bench, transport, bench)


def _written_meter(described: MeterConfiguration, bench: SimulatedBench, console: Console | None) -> Meter:
    """Return a simulated meter whose readings are typed, or would be in a file; without a console they are taken."""
    display = bench.display()

    def ask(question: str) -> str:
        shown = display.shown()
        if console is None or described.entry == "csv":
            return shown
        return console.ask(f"The simulated meter shows {shown} cd/m2. {question}")

    return ManualMeter(ask, replace(described.identity, simulated=True), stated_accuracy(described))


def _gige_camera(bench: SimulatedBench, stack: ExitStack, patience_s: float) -> Camera:
    """Open the simulated GigE Vision camera, which `stack` closes, and take a frame: not every loopback lets it in."""
    with ExitStack() as trial:
        server = trial.enter_context(bench.gige_camera(free_loopback_address()))
        camera = trial.enter_context(AravisCamera(server.address, patience_s=patience_s))
        camera.snap(on_refused=take_again)
        stack.push(trial.pop_all())
    return camera


def serial_meter(stack: ExitStack, described: MeterConfiguration, port: str | Port, options: DeviceOptions) -> Meter:
    """Open the meter on a port in the modes of the configuration; `stack` closes it."""
    meter = configured_meter(
        described, port, attempts=_METER_ATTEMPTS, patience_s=options.patience, transcript=options.transcript
    )
    stack.enter_context(meter).ask_if_simulated()
    return meter
