"""The simulated bench: target, camera, meter and operator."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from math import copysign
from typing import Self

from ...chain import ImagingChain, Optics
from ...core.clock import Clock, SystemClock
from ...core.errors import ConfigurationError
from ...core.photometry import THESIS_SPECTRUM
from ...core.spectra import chromaticity
from ...session import SessionConfiguration
from ..manual import stated_accuracy
from ..minolta.cs100a import MinoltaCS100A
from ..minolta.meter import SerialMeter
from ..minolta.models import configured_meter
from ..minolta.program import ProgramMeter
from .commands import Command, parse_command, parse_schedule
from .device import SimulatedDevice
from .devices import SimulatedDevices
from .faults import Drifts, Misfortune
from .genicam import standard_features
from .gige_camera import SimulatedGigECamera
from .in_process import InProcessCamera
from .meter import SimulatedCS100A, SimulatedDisplay, SimulatedLS, SimulatedMeter, SimulatedProgram
from .port import InProcessPort
from .pty import PtyMeter
from .target import SimulatedTarget

__all__ = ["SimulatedBench", "SimulatedDevices"]


class SimulatedBench:
    """One simulated target, seen by camera and meter alike.

    The target has the patches of a session's configuration, at their nominal luminance. The bench does what an operator
    does: `cover_lens`, `uncover_lens`, `point_meter`, `show_patch`. Faults of `run_command` and `schedule` affect all
    devices it has created. The context manager cancels the schedule.

    Parameters
    ----------
    configuration : SessionConfiguration
        Its target, lens and spectrum are simulated; each patch needs a nominal luminance.
    devices : SimulatedDevices
        The specimens.
    sensor_shape : (int, int) or None
        Height and width for a smaller sensor; None keeps the camera's own.
    clock : Clock or None
        Clock of drifts, schedules and the devices in this process; None for the system clock.
    repeated : iterable of str
        Units that `repeat` has had repeated, in an earlier run of a resumed acquisition.

    Raises
    ------
    ConfigurationError
        If a patch has no nominal luminance, lies outside the sensor, or overlaps another.
    """

    def __init__(
        self,
        configuration: SessionConfiguration,
        devices: SimulatedDevices,
        sensor_shape: tuple[int, int] | None = None,
        clock: Clock | None = None,
        repeated: Iterable[str] = (),
    ) -> None:
        self._clock = SystemClock() if clock is None else clock
        self._configuration = configuration
        self._plan = configuration.model_dump_json()
        self._devices = devices
        self._chain = _chain(configuration, devices.chain, sensor_shape)
        self._drifts = Drifts(self._clock, devices.temperature_c)
        self._source = SimulatedTarget(configuration, self._chain, self._drifts, devices.seed, devices.colour_filter)
        self.luminance_cd_m2 = self._source.luminance_cd_m2
        self.pointed_at = configuration.target.patches[0].name
        self._misfortune = Misfortune(self._clock, self._drifts, devices.seed)
        self._repeated = set(repeated)
        self._meters: list[SimulatedMeter | SimulatedDisplay] = []

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *exc: object) -> None:
        """Cancel the schedule."""
        self.close()

    def close(self) -> None:
        """Cancel the schedule; may be called twice."""
        self._misfortune.close()

    @property
    def device(self) -> SimulatedDevice:
        """Identity of the simulated camera."""
        sensor, devices = self._chain.sensor, self._devices
        return SimulatedDevice(
            serial=devices.serial or f"SIM-{sensor.device_seed}",
            width=sensor.width,
            height=sensor.height,
            temperature_c=devices.temperature_c,
            black_level_dn=sensor.black_level_dn,
            vendor=devices.vendor,
            model=devices.model,
            frame_rate_hz=devices.frame_rate_hz,
            features=standard_features(devices.naming, devices.colour_filter),
            colour_filter=devices.colour_filter,
        )

    def gige_camera(self, address: str = "127.0.0.1") -> SimulatedGigECamera:
        """Return the camera as a GigE Vision device on a loopback address, to be started."""
        camera = SimulatedGigECamera(self.device, self._source, address, temperature=self._drifts.temperature_c)
        self._misfortune.add_camera(camera)
        return camera

    def in_process_camera(self, patience_s: float = 0.0) -> InProcessCamera:
        """Return the camera in this process, without a network; `patience_s` as for the real one."""
        camera = InProcessCamera(
            self.device, self._source, self._clock, temperature=self._drifts.temperature_c, patience_s=patience_s
        )
        self._misfortune.add_camera(camera)
        return camera

    def pty_meter(self, response_time_s: float = 0.8) -> PtyMeter:
        """Return the meter on a pseudo-terminal, to be started."""
        meter = PtyMeter(self._meter(), response_time_s=response_time_s)
        self._misfortune.add_meter(meter)
        return meter

    def in_process_port(self, response_time_s: float = 0.8) -> InProcessPort:
        """Return a port in this process with the meter on it."""
        port = InProcessPort(self._meter(), self._clock, response_time_s)
        self._misfortune.add_meter(port)
        return port

    def in_process_meter(self, response_time_s: float = 0.8) -> SerialMeter:
        """Return the driver of the meter on a port in this process."""
        described = self._configuration.meter
        identity = replace(described.identity, simulated=True)
        return configured_meter(described, self.in_process_port(response_time_s), identity)

    def display(self) -> SimulatedDisplay:
        """Return the display of a meter without an interface, whose errors are within what the configuration states."""
        stated, errors = stated_accuracy(self._configuration.meter), self._devices.meter
        scale_rel = copysign(min(abs(errors.scale_rel), stated.scale_half_width_rel), errors.scale_rel)
        within = replace(errors, scale_rel=scale_rel, repeatability_rel=stated.repeatability_rel)
        display = SimulatedDisplay(lambda: self._source.seen_cd_m2(self.pointed_at), within)
        self._meters.append(display)
        return display

    def _meter(self) -> SimulatedMeter:
        described, errors = self._configuration.meter, self._devices.meter
        driver = configured_meter(described, "of no use")
        spectrum = self._configuration.source.spectrum
        has_colour = described.model.startswith("CS") and spectrum != THESIS_SPECTRUM

        def luminance() -> float:
            return self._source.seen_cd_m2(self.pointed_at)

        def colour() -> tuple[float, float]:
            return chromaticity(spectrum)

        meter: SimulatedMeter
        if isinstance(driver, MinoltaCS100A):
            meter = SimulatedCS100A(luminance, driver.data_sheet, errors, colour if has_colour else None)
        elif isinstance(driver, ProgramMeter):
            meter = SimulatedProgram(luminance, driver.data_sheet, errors, colour if has_colour else None)
        else:
            meter = SimulatedLS(luminance, driver.data_sheet, errors)
        self._meters.append(meter)
        return meter

    @property
    def light_rel(self) -> float:
        """Current light on the target, relative to that at the start."""
        return self._drifts.light_rel()

    @property
    def temperature_c(self) -> float:
        """Temperature of the camera now, in degrees Celsius."""
        return self._drifts.temperature_c()

    @property
    def drifted(self) -> bool:
        """Whether any drift of light or temperature was started."""
        return bool(self._drifts.begun)

    @property
    def covered(self) -> bool:
        """Whether the cap is on the lens."""
        return self._source.covered

    def cover_lens(self) -> None:
        """Cover the lens."""
        self._source.covered = True

    def uncover_lens(self) -> None:
        """Take the cap off the lens."""
        self._source.covered = False

    def point_meter(self, patch: str) -> None:
        """Point the meter at a patch.

        Raises
        ------
        ConfigurationError
            If the target has no such patch.
        """
        if patch not in self.luminance_cd_m2:
            raise ConfigurationError(f"there is no patch {patch!r}: choose one of {', '.join(self.luminance_cd_m2)}")
        self.pointed_at = patch

    def show_patch(self, patch: str) -> None:
        """Place a patch in front of the camera, where patches are shown one by one, and point the meter at it.

        Raises
        ------
        ConfigurationError
            If the target has no such patch.
        """
        self.point_meter(patch)
        self._source.show(patch)

    def repeat(self, what: str, findings: Sequence[object]) -> bool:
        """Repeat each unit once whatever its problems, so that a run without a user ends."""
        first = what not in self._repeated
        self._repeated.add(what)
        return first

    def announce_frames(self, series: str, first: int, n_before: int) -> None:
        """Give the next frames the noise of a series of this configuration, the same in a resumed acquisition.

        Parameters
        ----------
        series : str
            Content of the frames; each series has noise of its own.
        first : int
            Number in the series of the first one that counts.
        n_before : int
            Number of frames taken before it that do not count.
        """
        self._source.announce(f"{self._plan}, {series}", first, n_before)

    def announce_reading(self, series: str, number: int) -> None:
        """Give the next reading the noise of its number in a series, likewise."""
        for meter in self._meters:
            meter.announce(f"{self._plan}, {series}", number)

    def run_command(self, text: str) -> None:
        """Start a fault, for example ``lose 5% for 20 s``.

        Raises
        ------
        ConfigurationError
            If the text is not a fault; the message gives an example.
        CameraError
            If the fault cannot be applied.
        """
        self._misfortune.begin(parse_command(text))

    def schedule(self, text: str, source: str = "schedule") -> tuple[Command, ...]:
        """Schedule faults from now on, lines such as ``at 1 min vanish for 5 s``; returns them.

        Raises
        ------
        ConfigurationError
            If a line is invalid; nothing is then scheduled.
        """
        scheduled = parse_schedule(text, source)
        for item in scheduled:
            self._misfortune.schedule(item)
        return scheduled


def _chain(
    configuration: SessionConfiguration, chain: ImagingChain, sensor_shape: tuple[int, int] | None
) -> ImagingChain:
    lens = configuration.lens
    transmittance = chain.optics.transmittance if lens.transmittance is None else lens.transmittance
    optics = Optics(f_number=lens.f_number, transmittance=transmittance, focal_length_m=lens.focal_length_m)
    sensor = chain.sensor
    if sensor_shape is not None:
        height, width = sensor_shape
        sensor = replace(sensor, height=height, width=width)
    sensor = replace(sensor, pixel_pitch_m=configuration.camera.pixel_pitch_m)
    return replace(chain, spectrum=configuration.source.spectrum, optics=optics, sensor=sensor)
