"""Commands acquire and import: record a session as planned, or make one of pictures taken without labcdp."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Annotated

import typer

from ...acquire import AcquisitionStoppedError, Control, Left, Unattended, forget, is_complete
from ...acquire import acquire as run
from ...acquire.control import holds_something, no_bare_session
from ...acquire.import_check import ImportFile
from ...acquire.import_files import import_session
from ...core.clock import Clock, SimulatedClock, SystemClock
from ...core.disk.files import shell_word, shown
from ...core.errors import InputError, SessionError
from ...core.result import InputFile, NamedValue, Result, quantity_table
from ...core.table import Column, Table
from ...files import DUMP_SUFFIXES
from ...files.read import IMPORTED_SUFFIXES, picture_paths
from ...regions import load_regions
from ...session import EventRecord, FrameRecord, ReadingRecord, Role, Session, SessionConfiguration
from ...session.records import ROLES
from ...web.bench.recording import with_regions
from ..commands import As
from ..terminal import print_result, progress_bars, say
from ..values import parse_seconds, parse_size, parse_temperature
from .connected import connected
from .operators import Console, Keys
from .options import Again, DeviceOptions, Person, Replay

#: Exit status of a program ended by Ctrl-C; also used for the key q.
_INTERRUPTED = 130


def acquire(
    devices: DeviceOptions,
    replay: Replay,
    person: Person,
    again: Again,
    configuration: Path,
    session: Path,
    *,
    roi: Path | None = None,
) -> None:
    """Record the planned frames and meter readings; resume an interrupted session.

    Parameters
    ----------
    configuration
        TOML file with bench, target and plan; see labcdp init bench.
    session
        Folder of the session.
    roi
        Region file whose regions are the patches of the target; default: those of the configuration.
    """
    replay.check(devices)
    operator = person.operator(devices.rehearse)
    wanted = SessionConfiguration.load(configuration)
    if roi is not None:
        wanted = with_regions(wanted, load_regions(roi))
    if replay.replay is None:
        devices.check(wanted.meter)
    left, frames, readings, simulated = record(session, configuration, wanted, devices, replay, operator, again)
    recorded = quantity_table("recorded", "Recorded", [NamedValue("frames", frames), NamedValue("readings", readings)])
    columns = (Column("hand", "step"), Column("what", "what", "", "What remains to be recorded in this step."))
    steps = Table.of_items("left", "Remaining manual steps", columns, left)
    inputs = (replace(InputFile.of("session", session / "journal.jsonl"), path=str(session)),)
    tables = recorded.as_detail(), steps.as_detail()
    following = [f"{session}: {frames} frames and {readings} readings recorded"]
    for hand, of_hand in groupby(left, key=lambda thing: thing.hand):
        following.append(f"Remaining manual step, {hand}: {', '.join(thing.what for thing in of_hand)}")
    resumed = "Resume with the same command without --unattended"
    following.append(resumed if left else f"Next: labcdp calibrate {shell_word(session)}")
    print_result(Result("acquire", str(session), tables, inputs=inputs, simulated=simulated), *following)


def record(
    path: Path,
    source: Path,
    wanted: SessionConfiguration,
    devices: DeviceOptions,
    replay: Replay = Replay(),
    unattended_operator: Unattended | None = None,
    again: Again = Again(),
) -> tuple[tuple[Left, ...], int, int, bool]:
    """Record what is missing from a session; end the program with status 130 if the user stops it.

    Parameters
    ----------
    path : Path
        Folder of the session; created if necessary.
    source : Path
        File of the configuration, for messages.
    wanted : SessionConfiguration
        Bench, target and plan.
    devices : DeviceOptions
        Which devices.
    replay : Replay
        Recorded session instead of devices.
    unattended_operator : Unattended or None
        Operator of an unattended acquisition.
    again : Again
        What is recorded again.

    Returns
    -------
    tuple of Left, int, int, bool
        Remaining manual steps, the numbers of frames and readings, and whether a device was simulated.
    """
    clock = _clock(path, devices.virtual_clock)
    # A replay does not wait for the pace of the plan.
    pace = clock if replay.replay is None else SimulatedClock()
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
                    connected(opened, devices, replay, clock, Console(bars, keys), unattended_operator) as there,
                    keys,
                ):
                    forget(opened, again.retake)
                    left = run(
                        opened,
                        there.camera,
                        there.meter,
                        there.operator,
                        bars.acquisition,
                        pace,
                        control,
                        there.bench,
                    )
            else:
                opened.require_files()
            return left, len(opened.frames()), len(opened.readings()), _is_simulated(opened)
    except AcquisitionStoppedError:
        # The message is that of Ctrl-C.
        raise typer.Exit(_INTERRUPTED) from None


def _is_simulated(session: Session) -> bool:
    """Whether a device says that it is simulated."""
    used = [r.content for r in session.records if isinstance(r, EventRecord) and r.kind == "devices"]
    return any(device.get("simulated", False) for devices in used for device in devices.values())


def _give_up_damaged(session: Session) -> None:
    """Let frames whose files are missing or damaged no longer count."""
    damaged, before = session.damaged(), len(session.frames())
    if not damaged:
        say("No frame is missing or damaged")
        return
    session.supersede([frame for frame, _ in damaged], damaged[0][1], damaged=True)
    say(f"Recording {before - len(session.frames())} missing or damaged frames again")


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
        with session:
            bare = not any(isinstance(record, FrameRecord | ReadingRecord) for record in session.records)
            if bare:
                # Refused before the first frame; the plan was corrected since.
                session.remove()
        if bare:
            return Session.create(path, wanted, clock=clock)
        raise SessionError(
            f"{path} was started with another configuration than {source}: use its own "
            f"{path / 'session.toml'}, or a new folder"
        )
    say(f"Resuming {path}")
    return session


def import_files(
    configuration: Path,
    session: Path,
    *,
    light: tuple[str, ...] = (),
    dark: tuple[str, ...] = (),
    readings: Path,
    exposure: tuple[str, ...] = (),
    temperature: tuple[str, ...] = (),
    encoding: str | None = None,
    size: Annotated[tuple[int, int] | None, As(parse=parse_size)] = None,
) -> None:
    """Create a session from camera RAW files, grey TIFF, PNG and NPY files or raw dumps, and a list of meter readings.

    With import and calibrate, a still camera that writes RAW files becomes a luminance meter. All files are checked
    before anything is written. Repeating the command adds what is missing. Values of TIFF, PNG and NPY files and of raw
    dumps are read as plan.pixel_format of the configuration; RAW files contain their format.

    Parameters
    ----------
    configuration
        TOML file with bench and target.
    session
        Folder of the session, new or to be completed.
    light
        Picture of the target: a file, a folder of files, or a pattern in quotes such as 'light/*.NEF'; PATCH=FILE if
        patches were shown one by one. May be repeated.
    dark
        Picture with the lens covered: a file, a folder, or a pattern in quotes. May be repeated.
    readings
        CSV file or spreadsheet (.xlsx) of the meter readings: columns patch, luminance_cd_m2 or luminance_fL, also
        written as in 'luminance (cd/m²)', and optionally time.
    exposure
        Exposure time of pictures that do not state it, for example 5ms; FILE=5ms for one picture. May be repeated.
    temperature
        Temperature of the camera in degrees Celsius, for example 31.5; light=31.5 or dark=29 for pictures of that
        kind, FILE=31.5 for one picture. Without it, the dark signal is less certain. May be repeated.
    encoding
        Curve of companded data, by its name (AR0231, AR0820, OX03C10) or a TOML file; default: camera.encoding of the
        configuration. The session keeps codes and curve.
    size
        Width and height of raw dumps (.raw, .bin, .dat), for example 2464x2056.
    """
    wanted = SessionConfiguration.load(configuration)
    if encoding is not None:
        wanted = wanted.model_copy(update={"camera": wanted.camera.with_encoding(encoding)})
    exposures_s = _by_name(exposure, "--exposure", parse_seconds)
    temperatures_c = _by_name(temperature, "--temperature", parse_temperature)
    given = partial(_pictures, exposures_s, temperatures_c, size)
    files = [file for text in light for file in given(*_of_patch(text), "light")]
    files += [file for text in dark for file in given("", text, "dark")]
    if not any(file.role == "light" for file in files):
        raise InputError("no picture of the target: give --light with a file, folder or pattern")
    names = {str(file.path) for file in files} | {""}
    for option, unused in (
        ("--exposure", sorted(exposures_s.keys() - names)),
        ("--temperature", sorted(temperatures_c.keys() - names - set(ROLES))),
    ):
        if unused:
            raise InputError(f"{option} names {unused[0]}, which was not imported: correct the name")
    with progress_bars() as bars:
        done = import_session(wanted, session, files, readings, bars.set)
    counts = [
        NamedValue("frames", done.frames, "", "added"),
        NamedValue("readings", done.readings, "", "added"),
        NamedValue("known frames", done.known_frames, "", "already in the session"),
        NamedValue("known readings", done.known_readings, "", "already in the session"),
    ]
    inputs = (InputFile.of("configuration", configuration), InputFile.of("readings", readings))
    table = quantity_table("imported", f"Imported into {session}", counts)
    result = Result("import", str(session), (table,), done.findings, inputs)
    print_result(result, f"Next: labcdp calibrate {shell_word(session)}")


def _of_patch(text: str) -> tuple[str, str]:
    """Split ``PATCH=FILE``; FILE alone is of no patch."""
    patch, separator, name = text.partition("=")
    if not separator or Path(text).exists():
        return "", text
    if not (patch and name):
        raise InputError(f"--light is {shown(text)}: give FILE, or PATCH=FILE")
    return patch, name


def _pictures(
    exposures_s: Mapping[str, float],
    temperatures_c: Mapping[str, float],
    size: tuple[int, int] | None,
    patch: str,
    text: str,
    role: Role,
) -> list[ImportFile]:
    """Return the files of a name, a folder or a pattern, by name."""
    path = Path(text)
    if path.is_dir():
        paths = picture_paths([path], IMPORTED_SUFFIXES if size is None else (*IMPORTED_SUFFIXES, *DUMP_SUFFIXES))
    elif any(mark in text for mark in "*?[") and not path.exists():
        paths = sorted(Path(path.anchor).glob(str(path.relative_to(path.anchor))))
    else:
        paths = [path]
    if not paths:
        raise InputError(f"--{role} {text} matches no file: check folder and pattern")
    of_role = temperatures_c.get(role, temperatures_c.get(""))
    return [
        ImportFile(
            path,
            role,
            patch or None,
            exposures_s.get(str(path), exposures_s.get("")),
            temperatures_c.get(str(path), of_role),
            size,
        )
        for path in paths
    ]


def _by_name(texts: Sequence[str], option: str, parse: Callable[[str, str], float]) -> dict[str, float]:
    """Values of NAME=VALUE by name, "" for all others."""
    values: dict[str, float] = {}
    for text in texts:
        name, _, number = text.rpartition("=")
        value = parse(number, option)
        key = str(Path(name)) if name else ""
        if key in values:
            raise InputError(f"{option} {name or 'without a file'} is given twice: give it once")
        values[key] = value
    return values
