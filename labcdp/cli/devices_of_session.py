"""The devices of an acquisition: real ones with a person as operator, or the simulated bench."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..errors import DeviceError
from .terminal import Bars, say

if TYPE_CHECKING:
    from ..acquire import Operator
    from ..drivers.camera import Camera
    from ..drivers.meter import Meter
    from ..drivers.simulated.bench import SimulatedBench
    from ..session import SessionConfiguration

#: Time the simulated meter takes for a reading; the real one takes about 0.8 s.
SIMULATED_RESPONSE_S = 0.05


@dataclass(frozen=True)
class Devices:
    """Camera and meter, open, and who does what is done by hand.

    Parameters
    ----------
    camera : Camera
        Open.
    meter : Meter
        Open.
    operator : Operator
        A person, or the simulated bench.
    transport : str
        How the camera is reached, for a person.
    """

    camera: Camera
    meter: Meter
    operator: Operator
    transport: str


class ConsoleOperator:
    """A person at the terminal.

    Parameters
    ----------
    bars : Bars
        Taken away while the person is asked.
    """

    def __init__(self, bars: Bars) -> None:
        self._bars = bars

    def cover_lens(self) -> None:
        """Ask for the lens cap."""
        self._ask("Put the cap on the lens")

    def uncover_lens(self) -> None:
        """Ask to take off the lens cap."""
        self._ask("Take the cap off the lens and light the target")

    def point_meter(self, patch: str) -> None:
        """Ask to point the meter."""
        self._ask(f"Point the luminance meter at the middle of patch {patch}")

    def _ask(self, request: str) -> None:
        with self._bars.paused():
            say(f"{request}, then press Enter.")
            try:
                input()
            except EOFError:
                raise DeviceError(
                    "nobody answers at the terminal: run the command where a person can press Enter; what was "
                    "recorded is safe"
                ) from None


@contextmanager
def connected(
    configuration: SessionConfiguration, camera: str | None, meter: str | None, simulated: bool, bars: Bars
) -> Iterator[Devices]:
    """Open the devices of a session while the context lasts.

    Raises
    ------
    DeviceError
        If a device is absent, busy or silent.
    """
    from ..drivers.aravis_camera import AravisCamera

    if simulated:
        from ..drivers.simulated.bench import BenchDevices, SimulatedBench

        with simulated_devices(configuration, SimulatedBench(configuration, BenchDevices.standard())) as devices:
            yield devices
        return
    port = meter or configuration.meter.port
    assert port is not None, "checked before the session is made"
    wanted = configuration.camera
    selector = camera or wanted.serial or wanted.address or wanted.model
    with AravisCamera(selector) as opened, _meter(configuration, port) as ls:
        yield Devices(opened, ls, ConsoleOperator(bars), "Aravis")


@contextmanager
def simulated_devices(configuration: SessionConfiguration, bench: SimulatedBench) -> Iterator[Devices]:
    """Open the devices of a simulated bench: GigE Vision on loopback, or in this process where that fails."""
    with ExitStack() as stack:
        pty = stack.enter_context(bench.pty_meter(SIMULATED_RESPONSE_S))
        ls = stack.enter_context(_meter(configuration, pty.port))
        camera, transport = _simulated_camera(bench, stack)
        yield Devices(camera, ls, bench, transport)


def _simulated_camera(bench: SimulatedBench, stack: ExitStack) -> tuple[Camera, str]:
    from ..drivers.aravis_camera import AravisCamera
    from ..drivers.camera import CameraError

    try:
        with ExitStack() as trial:
            trial.enter_context(bench.gige_camera())
            camera = trial.enter_context(AravisCamera(bench.device.serial))
            _try(camera)
            stack.push(trial.pop_all())
            return camera, "GigE Vision on loopback"
    except CameraError as error:
        say(f"The camera is simulated in this process, not over GigE Vision: {error}")
        return stack.enter_context(bench.in_process_camera()), "in this process"


def _try(camera: Camera) -> None:
    """Take a frame; one that comes incomplete says little, two in a row that the network cannot carry them."""
    from ..drivers.camera import IncompleteFrameError

    try:
        camera.snap()
    except IncompleteFrameError:
        camera.snap()


def _meter(configuration: SessionConfiguration, port: str) -> Meter:
    from ..drivers.minolta_ls import MinoltaLS100, MinoltaLS110
    from ..reading import MeterIdentity

    wanted = configuration.meter
    identity = MeterIdentity(
        wanted.model,
        wanted.serial,
        None if wanted.calibration_date is None else wanted.calibration_date.isoformat(),
        # Meters have serial lines; a pseudo-terminal is a program's.
        simulated=port.startswith("/dev/pts/"),
    )
    driver = {"LS-100": MinoltaLS100, "LS-110": MinoltaLS110}[wanted.model]
    return driver(port, identity)
