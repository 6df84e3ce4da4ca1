"""Command simulate-bench: keep the simulated bench running for other programs."""

from __future__ import annotations

import os
import select
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

import typer

from ..errors import ConfigurationError, LabcdpError
from .terminal import JSON_OPTION, print_json, say

if TYPE_CHECKING:
    from ..drivers.simulated.bench import SimulatedBench

_HELP = "Type: cover | uncover | point PATCH | status | quit | show PATCH, or a fault: "


def simulate_bench(
    configuration: Path | None = typer.Argument(None, help="TOML file with the target; default: the demonstration's."),
    address: str = typer.Option("127.0.0.1", help="Loopback address of the camera."),
    response_s: float = typer.Option(0.8, help="Seconds the meter takes for a reading.", min=0),
    seed: int = typer.Option(0, help="Of the noise of camera and meter.", min=0),
    faults: Path | None = typer.Option(
        None, help="File of faults that come by themselves, lines such as 'at 1 min vanish for 5 s'."
    ),
    as_json: bool = JSON_OPTION,
) -> None:
    """Keep a GigE Vision camera and a luminance meter running that look at one simulated target.

    What a person does at the bench is typed here: cover the lens, point the meter. Faults are typed too, or come at
    the times a file gives.
    """
    from ..drivers.simulated.bench import BenchDevices, SimulatedBench
    from ..drivers.simulated.faults import parse_schedule
    from ..session import SessionConfiguration, example_configuration

    if configuration is None:
        loaded = SessionConfiguration.from_toml(example_configuration(), "the demonstration's configuration")
    else:
        loaded = SessionConfiguration.load(configuration)
    bench = SimulatedBench(loaded, BenchDevices.standard(seed))
    schedule = "" if faults is None else _read_text(faults)
    parse_schedule(schedule, str(faults))
    with bench, bench.gige_camera(address), bench.pty_meter(response_s) as meter:
        bench.schedule(schedule, str(faults))
        device = bench.device
        if as_json:
            print_json(
                {
                    "camera": {"address": address, "serial": device.serial, "model": device.model},
                    "meter": {"port": meter.port, "model": loaded.meter.model},
                    "patches_cd_m2": bench.luminance_cd_m2,
                }
            )
            sys.stdout.flush()
        else:
            say(f"Camera: {device.vendor} {device.model}, serial {device.serial}, at {address}")
            say(f"Luminance meter: {loaded.meter.model} on {meter.port}, 4800 baud, 7E2")
            say(f"Patches in cd/m^2: {', '.join(f'{n} {v:g}' for n, v in bench.luminance_cd_m2.items())}")
            say(_help())
        _serve(bench)


def _serve(bench: SimulatedBench) -> None:
    """Do what is typed until told to quit, or until a signal where nobody types."""
    signal.signal(signal.SIGTERM, _interrupt)
    try:
        for line in _typed_lines():
            if not _obey(bench, line.strip()):
                return
    except KeyboardInterrupt:
        say("Bench switched off")


def _typed_lines() -> Iterator[str]:
    """Yield what is typed line by line; after the end of the input, or without any, wait for a signal."""
    # Read from the descriptor: a line that waits in Python's buffer would not wake up select.
    descriptor = None if sys.stdin is None else sys.stdin.fileno()
    text = b""
    while True:
        readable, _, _ = select.select([] if descriptor is None else [descriptor], [], [], 1.0)
        if not readable or descriptor is None:
            continue
        received = os.read(descriptor, 4096)
        if not received:
            descriptor = None
        *lines, text = (text + received).split(b"\n")
        yield from (line.decode(errors="replace") for line in lines)


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def _help() -> str:
    from ..drivers.simulated.faults import EXAMPLES

    return _HELP + " | ".join(EXAMPLES)


def _obey(bench: SimulatedBench, line: str) -> bool:
    """Carry out one line; returns whether to go on."""
    from ..drivers.simulated.faults import EXAMPLES

    word, _, rest = line.partition(" ")
    if word == "quit":
        return False
    try:
        if word == "cover":
            bench.cover_lens()
        elif word == "uncover":
            bench.uncover_lens()
        elif word == "point":
            bench.point_meter(rest.strip())
        elif word == "show":
            bench.show_patch(rest.strip())
        elif word in {example.split()[0] for example in EXAMPLES}:
            bench.obey(line)
        elif word != "status":
            say(_help())
            return True
    except LabcdpError as error:
        say(str(error))
        return True
    lens = "covered" if bench.covered else "open"
    drifted = ""
    if bench.drifted:
        drifted = f"; light {bench.light_rel:.1%}, camera at {bench.temperature_c:.1f} degrees Celsius"
    say(f"Lens {lens}; meter points at {bench.pointed_at}{drifted}")
    return True


def _read_text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{path}: cannot be read ({error}): give a text file of faults") from error
