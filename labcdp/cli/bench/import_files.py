"""Command import: create a session from pictures taken without labcdp."""

from __future__ import annotations

from pathlib import Path
from shlex import quote

import typer

from ...acquire.import_files import ImportFile, import_session
from ...core.errors import InputError
from ...core.result import InputFile, Quantity, Result, quantity_table
from ...session import Role, SessionConfiguration
from ..terminal import JSON_OPTION, print_result, progress_bars, say

#: What marks a pattern of file names.
_WILD = "*?["


def import_files(
    configuration: Path = typer.Argument(help="TOML file with bench and target."),
    session: Path = typer.Argument(help="Folder of the session, new or to be completed."),
    light: list[str] = typer.Option(
        [],
        "--light",
        help="Picture of the target: a file, a folder of files, or a pattern in quotes such as 'light/*.NEF'; "
        "PATCH=FILE if patches were shown one by one. May be repeated.",
    ),
    dark: list[str] = typer.Option(
        [], "--dark", help="Picture with the lens covered: a file, a folder, or a pattern in quotes. May be repeated."
    ),
    readings: Path = typer.Option(
        ...,
        "--readings",
        help="CSV file of the meter readings: columns patch, luminance_cd_m2 or luminance_fL, and optionally time.",
    ),
    exposure: list[str] = typer.Option(
        [],
        "--exposure",
        help="Exposure in seconds of pictures that do not state it; FILE=SECONDS for one picture. May be repeated.",
    ),
    as_json: bool = JSON_OPTION,
) -> None:
    """Create a session from camera RAW files, or grey TIFF and PNG files, and a list of meter readings.

    With import and calibrate, a still camera that writes RAW files becomes a luminance meter. All files are checked
    before anything is written. Repeating the command adds what is missing. Values of TIFF and PNG files are read as
    plan.pixel_format of the configuration; RAW files contain their format.
    """
    wanted = SessionConfiguration.load(configuration)
    exposures = _exposures(exposure)
    files = [one for text in light for one in _light(text, exposures)]
    files += [one for text in dark for one in _pictures(text, "dark", None, exposures)]
    if not any(file.role == "light" for file in files):
        raise InputError("no picture of the target: give --light with a file, folder or pattern")
    _require_used(exposures, files)
    with progress_bars() as bars:
        done = import_session(wanted, session, files, readings, bars.update)
    counts = [
        Quantity("frames", done.frames, "", "added"),
        Quantity("readings", done.readings, "", "added"),
        Quantity("known frames", done.known_frames, "", "already in the session"),
        Quantity("known readings", done.known_readings, "", "already in the session"),
    ]
    inputs = (InputFile.of("configuration", configuration), InputFile.of("readings", readings))
    table = quantity_table("imported", f"Imported into {session}", counts)
    print_result(Result("import", str(session), (table,), done.findings, inputs), as_json)
    if not as_json:
        say(f"Next: labcdp calibrate {quote(str(session))}")


def _light(text: str, exposures: dict[str, float]) -> list[ImportFile]:
    patch, found, name = text.partition("=")
    if not found or Path(text).exists():
        return _pictures(text, "light", None, exposures)
    if not (patch and name):
        raise InputError(f"--light is {text!r}: give FILE, or PATCH=FILE")
    return _pictures(name, "light", patch, exposures)


def _pictures(text: str, role: Role, patch: str | None, exposures: dict[str, float]) -> list[ImportFile]:
    """Return the files of a name, a folder or a pattern, by name."""
    path = Path(text)
    if path.is_dir():
        paths = sorted(one for one in path.iterdir() if one.is_file() and not one.name.startswith("."))
    elif any(mark in text for mark in _WILD) and not path.exists():
        paths = sorted(Path(path.anchor).glob(str(path.relative_to(path.anchor))))
    else:
        paths = [path]
    if not paths:
        raise InputError(f"--{role} {text} matches no file: check folder and pattern")
    return [ImportFile(one, role, patch, exposures.get(str(one), exposures.get(""))) for one in paths]


def _exposures(texts: list[str]) -> dict[str, float]:
    """Seconds by file, "" for all others."""
    result: dict[str, float] = {}
    for text in texts:
        name, _, number = text.rpartition("=")
        try:
            seconds = float(number)
        except ValueError:
            seconds = 0.0
        if not 0 < seconds < float("inf"):
            raise InputError(f"--exposure is {text!r}: give seconds above 0, or FILE=SECONDS")
        key = str(Path(name)) if name else ""
        if key in result:
            raise InputError(f"--exposure {name or 'without a file'} is given twice: give it once")
        result[key] = seconds
    return result


def _require_used(exposures: dict[str, float], files: list[ImportFile]) -> None:
    unused = sorted(set(exposures) - {str(file.path) for file in files} - {""})
    if unused:
        raise InputError(f"--exposure names {unused[0]}, which is not among the imported pictures: correct the name")
