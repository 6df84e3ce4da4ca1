"""Options for the devices of an acquisition, and what they mean together."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

import typer

from ...core.errors import InputError
from ...session import MeterConfiguration
from ..options import METER_OPTION, SIMULATED_BENCH_OPTION


@dataclass(frozen=True)
class DeviceChoice:
    """Devices chosen by the options of a command.

    Parameters
    ----------
    camera, meter : str or None
        Serial number, address or model of the camera; serial port of the meter; None as configured.
    simulated, virtual_clock : bool
        Use the simulated bench, which `rehearse` needs; use it with a virtual clock.
    faults : Path or None
        Schedule of faults for the simulated bench.
    replay : Path or None
        Recorded session to replay instead of using devices.
    speed : float or None
        Speed of the replay; None for no waiting.
    patience : float
        Seconds to wait for a lost device.
    transcript : Path or None
        File for the bytes exchanged with the meter.
    simulated_bench : Path or None
        File of the simulated bench.
    rehearse : bool
        Ask the user for each manual step of the simulated bench.

    Raises
    ------
    InputError
        If two of them contradict each other.
    """

    camera: str | None = None
    meter: str | None = None
    simulated: bool = False
    virtual_clock: bool = False
    faults: Path | None = None
    replay: Path | None = None
    speed: float | None = None
    patience: float = 0.0
    transcript: Path | None = None
    simulated_bench: Path | None = None
    rehearse: bool = False

    def __post_init__(self) -> None:
        needs = (
            ("--virtual-clock", self.virtual_clock, "--simulated", self.simulated),
            ("--faults", self.faults is not None, "--simulated", self.simulated),
            ("--speed", self.speed is not None, "--replay", self.replay is not None),
        )
        for option, given, needed, there in needs:
            if given and not there:
                raise InputError(f"{option} requires {needed}: give both or neither")
        simulating = (
            "--rehearse" if self.rehearse else "--simulated" if self.simulated_bench is None else "--simulated-bench"
        )
        excluded = (
            (simulating, self.simulated, "--replay", self.replay is not None),
            ("--camera", self.camera is not None, simulating, self.simulated),
            ("--camera", self.camera is not None, "--replay", self.replay is not None),
            ("--meter", self.meter is not None, simulating, self.simulated),
            ("--meter", self.meter is not None, "--replay", self.replay is not None),
            ("--transcript", self.transcript is not None, "--replay", self.replay is not None),
        )
        for option, given, other, there in excluded:
            if given and there:
                raise InputError(f"{option} cannot be combined with {other}: leave one out")

    @property
    def real(self) -> bool:
        """Whether the devices are neither simulated nor recorded."""
        return not self.simulated and self.replay is None

    def check(self, meter: MeterConfiguration) -> None:
        """Check the options against the configured meter; raises InputError."""
        if not self.real:
            return
        if meter.entry != "serial":
            for option, given in (("--meter", self.meter), ("--transcript", self.transcript)):
                if given is not None:
                    raise InputError(f'{option} requires a meter on a serial port, but meter.entry is "{meter.entry}"')
        elif self.meter is None and meter.port is None:
            raise InputError("no serial port for the meter: give --meter, or meter.port in the configuration")


@dataclass(frozen=True)
class DeviceOptions:
    """Options of commands that measure."""

    camera: str | None = typer.Option(
        None, help="Serial number, address or model; default: as configured, else the only one."
    )
    meter: str | None = METER_OPTION
    simulated: bool = typer.Option(False, "--simulated", help="Use the simulated bench instead of devices.")
    simulated_bench: Path | None = SIMULATED_BENCH_OPTION
    virtual_clock: bool = typer.Option(
        False, "--virtual-clock", help="With --simulated: use a virtual clock, without waiting."
    )
    faults: Path | None = typer.Option(None, help="With --simulated: file with a schedule of faults.")
    patience: float = typer.Option(600.0, help="Seconds to wait for a lost camera or meter.", min=0)
    transcript: Path | None = typer.Option(None, help="New file for the bytes exchanged with the meter.")

    def choice(self, replay: Path | None = None, speed: float | None = None, rehearse: bool = False) -> DeviceChoice:
        """Return which devices are meant; raises InputError if options contradict each other."""
        simulated = self.simulated or self.simulated_bench is not None or rehearse
        return DeviceChoice(**asdict(self) | {"simulated": simulated}, replay=replay, speed=speed, rehearse=rehearse)

    @property
    def given(self) -> bool:
        """Whether devices are named."""
        return not self.choice().real or any(one is not None for one in (self.camera, self.meter, self.transcript))
