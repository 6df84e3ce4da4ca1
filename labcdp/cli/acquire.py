"""Command acquire: record a session as planned."""

from __future__ import annotations

import shutil
from itertools import groupby
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

import typer

from ..errors import InputError, SessionError
from .devices_of_session import DeviceChoice, connected
from .keys import Keys
from .operators import Console
from .terminal import JSON_OPTION, print_json, progress_bars, say

if TYPE_CHECKING:
    from ..acquire import Left, Unattended
    from ..clock import Clock
    from ..session import Session, SessionConfiguration

#: Exit status of a program ended by Ctrl-C, also by the key that does the same more gently.
_INTERRUPTED = 130


def _example(wanted: bool) -> None:
    from ..session import example_configuration

    if wanted:
        typer.echo(example_configuration(), nl=False)
        raise typer.Exit


def acquire(
    configuration: Path = typer.Argument(help="TOML file with bench, target and plan; see --example."),
    session: Path = typer.Argument(help="Folder of the session."),
    camera: str | None = typer.Option(
        None, help="Serial number, address or model; default: as configured, else the only one."
    ),
    meter: str | None = typer.Option(None, help="Serial port, for example /dev/ttyUSB0; default: as configured."),
    simulated: bool = typer.Option(False, "--simulated", help="Use the simulated bench instead of devices."),
    simulated_time: bool = typer.Option(
        False, "--simulated-time", help="With --simulated: let no time pass, so that a night takes a minute."
    ),
    faults: Path | None = typer.Option(None, help="With --simulated: file that says which faults happen when."),
    replay: Path | None = typer.Option(None, help="Use what a recorded session holds instead of devices."),
    speed: float | None = typer.Option(
        None, help="With --replay: 1 as fast as recorded, 10 ten times as fast; default: at once."
    ),
    unattended: bool = typer.Option(
        False, "--unattended", help="Nobody is there: do what needs no hand, and tell what is left."
    ),
    lens: str | None = typer.Option(
        None, help="With --unattended: how the lens was left, 'uncovered' or 'covered'.", show_default="uncovered"
    ),
    patience: float = typer.Option(600.0, help="Seconds to wait for a camera or meter that is lost.", min=0),
    transcript: Path | None = typer.Option(None, help="New file for every byte between computer and meter."),
    example: bool = typer.Option(
        False, "--example", help="Print a configuration to start from and stop.", is_eager=True, callback=_example
    ),
    as_json: bool = JSON_OPTION,
) -> None:
    """Record frames and meter readings as planned; a session that was broken off goes on."""
    from ..session import SessionConfiguration

    choice = DeviceChoice(camera, meter, simulated, simulated_time, faults, replay, speed, patience, transcript)
    nobody = _unattended(unattended, lens)
    wanted = SessionConfiguration.load(configuration)
    choice.check(wanted.meter)
    left, frames, readings = record(session, configuration, wanted, choice, nobody)
    if as_json:
        things = [{"what": thing.what, "hand": thing.hand} for thing in left]
        print_json({"session": str(session), "frames": frames, "readings": readings, "left": things})
        return
    say(f"{session}: {frames} frames and {readings} readings recorded")
    for hand, of_hand in groupby(left, key=lambda thing: thing.hand):
        say(f"Left for a person, {hand}: {', '.join(thing.what for thing in of_hand)}")
    if left:
        say("The same command without --unattended goes on")
    else:
        say(f"Next: labcdp calibrate {quote(str(session))}")


def record(
    path: Path, source: Path, wanted: SessionConfiguration, choice: DeviceChoice, nobody: Unattended | None = None
) -> tuple[tuple[Left, ...], int, int]:
    """Record what a session lacks of its plan; a stop ends the program with the status for it.

    Parameters
    ----------
    path : Path
        Folder of the session; made if need be.
    source : Path
        File of the configuration, for messages.
    wanted : SessionConfiguration
        Bench, target and plan.
    choice : DeviceChoice
        Which devices.
    nobody : Unattended or None
        In place of a person, if nobody is there.

    Returns
    -------
    tuple of Left, int, int
        What is left for a person, and how many frames and readings there are.
    """
    from ..acquire import AcquisitionStoppedError

    try:
        return _record(path, source, wanted, choice, nobody)
    except AcquisitionStoppedError:
        # Said by the program's end, as after Ctrl-C.
        raise typer.Exit(_INTERRUPTED) from None


def _record(
    path: Path, source: Path, wanted: SessionConfiguration, choice: DeviceChoice, nobody: Unattended | None
) -> tuple[tuple[Left, ...], int, int]:
    from ..acquire import Control, is_complete
    from ..acquire import acquire as run
    from ..clock import SimulatedClock

    clock = _clock(path, choice.simulated_time)
    # A recording has its own pace: the plan's is not waited for.
    pace = clock if choice.replay is None else SimulatedClock()
    control = Control()
    left: tuple[Left, ...] = ()
    with _open_or_create(path, source, wanted, clock) as opened:
        if not is_complete(opened):
            keys = Keys(control)
            with (
                progress_bars() as bars,
                connected(opened, choice, clock, Console(bars, keys), nobody) as devices,
                keys,
            ):
                left = run(opened, devices.camera, devices.meter, devices.operator, bars.acquisition, pace, control)
        return left, len(opened.frames()), len(opened.readings())


def _unattended(wanted: bool, lens: str | None) -> Unattended | None:
    from ..acquire import Unattended

    if lens not in (None, "uncovered", "covered"):
        raise InputError(f"--lens is {lens!r}: give 'uncovered' or 'covered'")
    if not wanted:
        if lens is not None:
            raise InputError("--lens is for --unattended only: give both, or neither")
        return None
    return Unattended("covered" if lens == "covered" else "uncovered")


def _clock(path: Path, simulated: bool) -> Clock:
    """Return the computer's clock; or a simulated one that goes on after what the session holds."""
    from datetime import UTC, datetime

    from ..clock import SimulatedClock, SystemClock
    from ..session import Session

    if not simulated:
        return SystemClock()
    now = datetime.now(UTC)
    recorded = Session.open(path).records if _holds_something(path) else []
    return SimulatedClock(max([now, *(record.time for record in recorded)]))


def _open_or_create(path: Path, source: Path, wanted: SessionConfiguration, clock: Clock) -> Session:
    from ..session import Session

    if not _holds_something(path):
        return Session.create(path, wanted, clock=clock)
    session = Session.open(path, writable=True, clock=clock)
    if session.configuration != wanted:
        session.close()
        if _is_bare(session):
            # Begun, and refused before the first frame: the plan was mended since.
            shutil.rmtree(path)
            return Session.create(path, wanted, clock=clock)
        raise SessionError(
            f"{path} was begun with another configuration than {source}: give its own "
            f"{path / 'session.toml'}, or a new folder"
        )
    say(f"{path} exists: going on with it")
    return session


def _is_bare(session: Session) -> bool:
    """Whether a session holds nothing that was ever measured."""
    from ..session import FrameRecord, ReadingRecord

    measured = any(isinstance(record, FrameRecord | ReadingRecord) for record in session.records)
    return not measured and not session.unrecorded()


def _holds_something(path: Path) -> bool:
    return path.exists() and not (path.is_dir() and not any(path.iterdir()))
