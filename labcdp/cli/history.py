"""Command history: the calibrations and verifications of cameras over time."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ..errors import InputError
from .terminal import JSON_OPTION, print_json, print_table, say

if TYPE_CHECKING:
    from ..calibration import AnyCalibration
    from ..calibration.verification import Verification

#: How the names of our files begin, by which a broken one is known.
_OUR_NAMES = ("calibration", "verification")
_BROKEN = "broken"


def history(
    paths: list[Path] = typer.Argument(
        metavar="FOLDER_OR_FILE...",
        help="Files of calibrations and verifications, or folders that are searched for them.",
    ),
    output: Path | None = typer.Option(
        None, "--output", "-o", help="File for the plot: .html with tables, .png, or .xlsx; default: only print."
    ),
    as_json: bool = JSON_OPTION,
) -> None:
    """Tell how responsivity, darkness and gain of cameras changed from calibration to calibration.

    Cameras, lenses, f-numbers and gains are kept apart: each has its own table and plot.
    """
    from ..calibration.history import histories
    from ..report.history import by_camera, history_table, history_title, history_values, write_history

    if output is not None and output.suffix not in (".html", ".png", ".xlsx"):
        raise InputError(f"--output is {output}: give a file that ends in .html, .png or .xlsx")
    calibrations, verifications = _read(paths)
    found = histories(calibrations, verifications)
    if output is not None:
        write_history(found, output)
    if as_json:
        print_json({"cameras": history_values(found), "output": None if output is None else str(output)})
        return
    for one in by_camera(found):
        print_table(history_title(one), *history_table(one))
    if output is not None:
        say(f"Written: {output}")


def _read(paths: list[Path]) -> tuple[dict[str, AnyCalibration], dict[str, Verification]]:
    from ..calibration import load_any
    from ..calibration.verification_file import FORMAT, load_verification

    calibrations: dict[str, AnyCalibration] = {}
    verifications: dict[str, Verification] = {}
    named = {path.resolve() for path in paths}
    for path in _files(paths):
        try:
            if _format(path) == FORMAT:
                verifications[str(path)] = load_verification(path)
            else:
                calibrations[str(path)] = load_any(path)
        except InputError as error:
            if path.resolve() in named:
                raise
            say(f"Left out: {error}")
    if not calibrations and not verifications:
        raise InputError("none of the files can be read: give a folder with calibrations")
    return calibrations, verifications


def _files(paths: list[Path]) -> Iterable[Path]:
    """Files that were named, and those found in folders, each once."""
    from ..calibration.store import FORMAT as CALIBRATION
    from ..calibration.verification_file import FORMAT as VERIFICATION

    files: dict[Path, Path] = {}
    for path in paths:
        if path.is_dir():
            inside = [p for p in sorted(path.rglob("*.json")) if _format(p) in (CALIBRATION, VERIFICATION, _BROKEN)]
            if not inside:
                raise InputError(f"{path} holds no calibration: give a folder in which labcdp calibrate saved one")
            files |= {p.resolve(): p for p in inside}
        else:
            files[path.resolve()] = path
    return files.values()


def _format(path: Path) -> object:
    """Return the key that tells what a JSON file is; None for what is none of ours."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return _BROKEN if path.stem.startswith(_OUR_NAMES) else None
    return document.get("format") if isinstance(document, dict) else None
