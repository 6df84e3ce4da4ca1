"""Command simulate-bench: keep the simulated bench running for other programs."""

from __future__ import annotations

import os
import select
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

from ...core.disk import read_text
from ...core.errors import LabcdpError
from ...core.result import Result
from ...core.table import Column, Table
from ...drivers.simulated.bench import SimulatedBench
from ...drivers.simulated.commands import parse_schedule
from ...drivers.simulated.control import free_loopback_address
from ...session import SessionConfiguration, example_configuration
from ..commands import As
from ..options import NonNegative, SimulatedBenchPath
from ..terminal import print_result, say
from .connected import simulated_bench_file, with_own_camera

_HELP = "Type: cover | uncover | point PATCH | show PATCH | status | quit"


def simulate_bench(
    configuration: Path | None = None,
    *,
    address: str | None = None,
    response_s: NonNegative = 0.8,
    simulated_bench: SimulatedBenchPath = None,
    seed: Annotated[int | None, As(least=0)] = None,
    faults: Path | None = None,
) -> None:
    """Run a simulated GigE Vision camera and luminance meter that view one simulated target.

    Type commands to cover the lens and point the meter; --faults schedules faults.

    Parameters
    ----------
    configuration
        TOML file with the target; default: that of labcdp demo.
    address
        Loopback address of the camera; default: the first free one.
    response_s
        Duration of a meter reading in seconds.
    seed
        Random seed of camera and meter noise; default: 0.
    faults
        File with a schedule of faults: lines such as 'at 1 min vanish for 5 s'.
    """
    if configuration is None:
        loaded = SessionConfiguration.from_toml(example_configuration(), "the demonstration's configuration")
    else:
        loaded = SessionConfiguration.load(configuration)
    address = address or free_loopback_address()
    described = with_own_camera(simulated_bench_file(simulated_bench, seed), simulated_bench, address)
    bench = SimulatedBench(loaded, described.devices(simulated_bench))
    schedule = "" if faults is None else read_text(faults, "a schedule of faults", 2**20)
    parse_schedule(schedule, str(faults))
    with bench, bench.gige_camera(address), bench.pty_meter(response_s) as meter:
        bench.schedule(schedule, str(faults))
        print_result(_running(bench, address, loaded.meter.model, meter.port), _HELP)
        sys.stdout.flush()
        _serve(bench)


def _running(bench: SimulatedBench, address: str, meter: str, port: str) -> Result:
    """Return the addresses of the devices and the patches of the target."""
    device = bench.device
    devices = (
        Column("device", "device"),
        Column("model", "model"),
        Column("serial", "serial number"),
        Column("address", "address", meaning="Network address of the camera; serial port of the meter."),
        Column("settings", "settings", meaning="Of the serial port."),
    )
    rows = [
        {"device": "camera", "model": f"{device.vendor} {device.model}", "serial": device.serial, "address": address},
        {"device": "meter", "model": meter, "address": port, "settings": "4800 baud, 7E2"},
    ]
    patches = (
        Column("patch", "patch", value=lambda item: item[0]),
        Column("luminance_cd_m2", "luminance", "cd/m²", "Simulated luminance.", value=lambda item: item[1]),
    )
    rising = sorted(bench.luminance_cd_m2.items(), key=lambda item: item[1])
    tables = (
        Table.of_items("devices", "Devices", devices, rows),
        Table.of_items("patches", "Patches", patches, rising),
    )
    return Result("simulate-bench", "simulated bench", tables, simulated=True)


def _serve(bench: SimulatedBench) -> None:
    """Run typed commands until quit or a signal."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        for line in _typed_lines():
            if not _run_command(bench, line.strip()):
                return
    except KeyboardInterrupt:
        say("Bench switched off")


def _typed_lines() -> Iterator[str]:
    """Yield typed lines; at the end of the input, wait for a signal."""
    # Read from the descriptor: select does not see lines in Python's buffer.
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


def _run_command(bench: SimulatedBench, line: str) -> bool:
    """Run one command; return whether to continue."""
    word, _, rest = line.partition(" ")
    if word == "quit":
        return False
    alone = {"cover": bench.cover_lens, "uncover": bench.uncover_lens}
    of_patch = {"point": bench.point_meter, "show": bench.show_patch}
    try:
        if word in alone:
            alone[word]()
        elif word in of_patch:
            of_patch[word](rest.strip())
        elif word != "status":
            say(_HELP)
            return True
    except LabcdpError as error:
        say(str(error))
        return True
    lens = "covered" if bench.covered else "open"
    drifted = f"; light {bench.light_rel:.1%}, camera at {bench.temperature_c:.1f} degrees Celsius"
    say(f"Lens {lens}; meter points at {bench.pointed_at}{drifted if bench.drifted else ''}")
    return True
