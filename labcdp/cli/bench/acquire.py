"""Command acquire: record a session as planned."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import groupby
from pathlib import Path
from shlex import quote

import typer

from ...acquire import AcquisitionStoppedError, Control, Left, Unattended, forget, is_complete
from ...acquire import acquire as run
from ...acquire.plan import holds_something, no_bare_session
from ...core.clock import Clock, SimulatedClock, SystemClock
from ...core.errors import InputError, SessionError
from ...core.result import InputFile, Quantity, Result, quantity_table
from ...core.table import Column, Table
from ...regions import load_regions
from ...session import FrameRecord, ReadingRecord, Session, SessionConfiguration
from ...web.bench.recording import with_regions
from ..terminal import JSON_OPTION, print_result, progress_bars, say
from .device_options import DeviceChoice, DeviceOptions
from .devices_of_session import connected
from .operators import Console, Keys

#: Exit status of a program ended by Ctrl-C; also used for the key q.
_INTERRUPTED = 130


@dataclass(frozen=True)
class Recorded:
    """Options for a session instead of devices."""

    replay: Path | None = typer.Option(None, help="Replay this recorded session instead of using devices.")
    speed: float | None = typer.Option(
        None, help="With --replay: 1 is the recorded speed, 10 ten times that; default: no waiting."
    )


@dataclass(frozen=True)
class Again:
    """Options for what of a session is recorded again."""

    replace_damaged: bool = typer.Option(
        False, "--replace-damaged", help="Check every frame of the session, and record missing and damaged ones again."
    )
    retake: list[str] = typer.Option(
        [], help="Part to record again: a patch, 'light frames' or 'dark frames'; may be repeated."
    )


@dataclass(frozen=True)
class Person:
    """Options for who does the manual steps."""

    unattended: bool = typer.Option(False, "--unattended", help="Run unattended; list remaining manual steps.")
    lens: str | None = typer.Option(
        None, help="With --unattended: state of the lens, 'uncovered' or 'covered'.", show_default="uncovered"
    )
    rehearse: bool = typer.Option(
        False, "--rehearse", help="Use the simulated bench, but ask for each manual step as with devices."
    )

    def operator(self) -> Unattended | None:
        """Return the operator of an unattended run; raises InputError if options contradict each other."""
        if self.lens not in (None, "uncovered", "covered"):
            raise InputError(f"--lens is {self.lens!r}: give 'uncovered' or 'covered'")
        if self.rehearse and self.unattended:
            raise InputError("--rehearse cannot be combined with --unattended: leave one out")
        if self.unattended:
            return Unattended("covered" if self.lens == "covered" else "uncovered")
        if self.lens is not None:
            raise InputError("--lens requires --unattended: give both or neither")
        return None


def acquire(
    devices: DeviceOptions,
    recorded: Recorded,
    person: Person,
    again: Again,
    configuration: Path = typer.Argument(help="TOML file with bench, target and plan; see labcdp init bench."),
    session: Path = typer.Argument(help="Folder of the session."),
    roi: Path | None = typer.Option(
        None, help="Region file whose regions are the patches of the target.", show_default="those of the configuration"
    ),
    as_json: bool = JSON_OPTION,
) -> None:
    """Record the planned frames and meter readings; resume an interrupted session."""
    choice = devices.choice(recorded.replay, recorded.speed, person.rehearse)
    operator = person.operator()
    wanted = SessionConfiguration.load(configuration)
    if roi is not None:
        wanted = _with_regions(wanted, roi)
    choice.check(wanted.meter)
    left, frames, readings = record(session, configuration, wanted, choice, operator, again)
    if as_json:
        print_result(_result(session, frames, readings, left, choice.simulated), as_json)
        return
    say(f"{session}: {frames} frames and {readings} readings recorded")
    for hand, of_hand in groupby(left, key=lambda thing: thing.hand):
        say(f"Remaining manual step, {hand}: {', '.join(thing.what for thing in of_hand)}")
    if left:
        say("Resume with the same command without --unattended")
    else:
        say(f"Next: labcdp calibrate {quote(str(session))}")


def _with_regions(configuration: SessionConfiguration, roi: Path) -> SessionConfiguration:
    return with_regions(configuration, load_regions(roi))


def _result(session: Path, frames: int, readings: int, left: tuple[Left, ...], simulated: bool) -> Result:
    recorded = quantity_table("recorded", "Recorded", [Quantity("frames", frames), Quantity("readings", readings)])
    columns = (Column("hand", "step"), Column("what", "what", "", "What remains to be recorded in this step."))
    rows = [{"hand": thing.hand, "what": thing.what} for thing in left]
    steps = Table.of_rows("left", "Remaining manual steps", columns, rows)
    journal = InputFile.of("session", session / "journal.jsonl")
    of_session = InputFile(journal.role, str(session), journal.sha256)
    return Result("acquire", str(session), (recorded, steps), inputs=(of_session,), simulated=simulated)


def record(
    path: Path,
    source: Path,
    wanted: SessionConfiguration,
    choice: DeviceChoice,
    unattended_operator: Unattended | None = None,
    again: Again = Again(False, []),
) -> tuple[tuple[Left, ...], int, int]:
    """Record what is missing from a session; end the program with status 130 if the user stops it.

    Parameters
    ----------
    path : Path
        Folder of the session; created if necessary.
    source : Path
        File of the configuration, for messages.
    wanted : SessionConfiguration
        Bench, target and plan.
    choice : DeviceChoice
        Which devices.
    unattended_operator : Unattended or None
        Operator of an unattended acquisition.
    again : Again
        What is recorded again.

    Returns
    -------
    tuple of Left, int, int
        Remaining manual steps, and the numbers of frames and readings.
    """
    clock = _clock(path, choice.virtual_clock)
    # A replay does not wait for the pace of the plan.
    pace = clock if choice.replay is None else SimulatedClock()
    control = Control()
    left: tuple[Left, ...] = ()
    try:
        with no_bare_session(path), _open_or_create(path, source, wanted, clock) as opened:
            if again.replace_damaged:
                _give_up_damaged(opened)
            if again.retake or not is_complete(opened):
                keys = Keys(control)
                with (
                    progress_bars() as bars,
                    connected(opened, choice, clock, Console(bars, keys), unattended_operator) as devices,
                    keys,
                ):
                    forget(opened, again.retake)
                    left = run(opened, devices.camera, devices.meter, devices.operator, bars.acquisition, pace, control)
            return left, len(opened.frames()), len(opened.readings())
    except AcquisitionStoppedError:
        # The message is that of Ctrl-C.
        raise typer.Exit(_INTERRUPTED) from None


def _give_up_damaged(session: Session) -> None:
    """Let frames whose files are missing or damaged no longer count."""
    damaged = session.damaged()
    if not damaged:
        say("No frame is missing or damaged")
        return
    session.supersede([frame for frame, _ in damaged], damaged[0][1], damaged=True)
    say(f"Recording {len(damaged)} missing or damaged frames again")


def _clock(path: Path, simulated: bool) -> Clock:
    """Return the computer's clock, or a simulated one that continues after the records of the session."""
    if not simulated:
        return SystemClock()
    now = datetime.now(UTC)
    recorded = Session.open(path).records if holds_something(path) else []
    return SimulatedClock(max([now, *(record.time for record in recorded)]))


def _open_or_create(path: Path, source: Path, wanted: SessionConfiguration, clock: Clock) -> Session:
    if not holds_something(path):
        return Session.create(path, wanted, clock=clock)
    session = Session.open(path, writable=True, clock=clock)
    if session.configuration != wanted:
        session.close()
        if _is_bare(session):
            # Refused before the first frame; the plan was corrected since.
            session.remove()
            return Session.create(path, wanted, clock=clock)
        raise SessionError(
            f"{path} was started with another configuration than {source}: use its own "
            f"{path / 'session.toml'}, or a new folder"
        )
    say(f"Resuming {path}")
    return session


def _is_bare(session: Session) -> bool:
    """Whether a session has neither frames nor readings."""
    return not any(isinstance(record, FrameRecord | ReadingRecord) for record in session.records)
