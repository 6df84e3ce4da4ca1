"""Options for the devices of an acquisition, who does the manual steps, and what is recorded again."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ...acquire import Unattended
from ...core.errors import InputError
from ...session import MeterConfiguration
from ..options import MeterPort, NonNegative, SimulatedBenchPath, require_apart, require_together


@dataclass(frozen=True)
class BenchDevices:
    """Options of commands that use camera and meter.

    Parameters
    ----------
    camera
        Serial number, address or model; default: as configured, else the only one.
    simulated
        Use the simulated bench instead of devices.
    """

    camera: str | None = None
    meter: MeterPort = None
    simulated: bool = False
    simulated_bench: SimulatedBenchPath = None

    def __post_init__(self) -> None:
        if self.simulating:
            require_apart({"--camera": self.camera, "--meter": self.meter}, {self.simulating: True})

    @property
    def simulating(self) -> str:
        """Option that asks for the simulated bench; empty if none does."""
        return "--simulated-bench" if self.simulated_bench is not None else "--simulated" if self.simulated else ""


@dataclass(frozen=True)
class DeviceOptions(BenchDevices):
    """Options of commands that measure.

    Parameters
    ----------
    virtual_clock
        With --simulated: use a virtual clock, without waiting.
    faults
        With --simulated: file with a schedule of faults.
    patience
        Seconds to wait for a lost camera or meter.
    transcript
        New file for the bytes exchanged with the meter.
    rehearse
        Use the simulated bench, but ask for each manual step as with devices.
    shutter
        Port of a shutter or lamp that makes the dark frames; default: the lens is covered by hand.
    """

    virtual_clock: bool = False
    faults: Path | None = None
    patience: NonNegative = 600.0
    transcript: Path | None = None
    rehearse: bool = False
    shutter: str | None = None

    def __post_init__(self) -> None:
        if self.simulating:
            require_apart({"--shutter": self.shutter}, {self.simulating: True})
        simulated = {"--virtual-clock": self.virtual_clock, "--faults": self.faults}
        require_together(simulated, {"--simulated": bool(self.simulating)})
        super().__post_init__()

    @property
    def simulating(self) -> str:
        """Option that asks for the simulated bench; empty if none does."""
        return "--rehearse" if self.rehearse else super().simulating

    @property
    def given(self) -> bool:
        """Whether devices are named."""
        named = self.camera, self.meter, self.transcript, self.shutter
        return bool(self.simulating) or any(chosen is not None for chosen in named)

    def check(self, meter: MeterConfiguration) -> None:
        """Check the options against the configured meter, if they are for real devices; raises InputError."""
        if self.simulating:
            return
        if not meter.is_connected:
            for option, given in (("--meter", self.meter), ("--transcript", self.transcript)):
                if given is not None:
                    raise InputError(f'{option} requires a meter on a port, but meter.entry is "{meter.entry}"')
        elif self.meter is None and meter.port is None:
            raise InputError("no serial port for the meter: give --meter, or meter.port in the configuration")


@dataclass(frozen=True)
class Replay:
    """Options for a recorded session instead of devices.

    Parameters
    ----------
    replay
        Replay this recorded session instead of using devices.
    speed
        With --replay: 1 is the recorded speed, 10 ten times that; default: no waiting.
    """

    replay: Path | None = None
    speed: float | None = None

    def check(self, devices: DeviceOptions) -> None:
        """Check that no devices are named besides; raises InputError."""
        require_together({"--speed": self.speed}, {"--replay": self.replay})
        named = {"--camera": devices.camera, "--meter": devices.meter, "--transcript": devices.transcript}
        require_apart({devices.simulating: bool(devices.simulating), **named}, {"--replay": self.replay})


@dataclass(frozen=True)
class Again:
    """Options for what of a session is recorded again.

    Parameters
    ----------
    replace_damaged
        Check every frame of the session, and record missing and damaged ones again.
    retake
        Part to record again: a patch, 'light frames' or 'dark frames'; may be repeated.
    """

    replace_damaged: bool = False
    retake: tuple[str, ...] = ()


@dataclass(frozen=True)
class Person:
    """Options for who does the manual steps.

    Parameters
    ----------
    unattended
        Run unattended; list remaining manual steps.
    lens
        With --unattended: state of the lens; default: uncovered.
    """

    unattended: bool = False
    lens: Literal["uncovered", "covered"] | None = None

    def operator(self, rehearse: bool) -> Unattended | None:
        """Return the operator of an unattended run; raises InputError if options contradict each other."""
        require_apart({"--rehearse": rehearse}, {"--unattended": self.unattended})
        require_together({"--lens": self.lens}, {"--unattended": self.unattended})
        return Unattended(self.lens or "uncovered") if self.unattended else None
