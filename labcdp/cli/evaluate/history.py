"""Command history: the calibrations and verifications of cameras over time."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import typer

from ...calibration import AnyCalibration, load_any
from ...calibration.record import CALIBRATION, MOST_BYTES, VERIFICATION, load_verification
from ...calibration.verify.history import histories
from ...calibration.verify.result import Verification
from ...core.disk import read_json, real_path
from ...core.errors import InputError
from ...core.result import InputFile
from ...evaluate.bench.history import history_result, write_history
from ..output import FORCE_OPTION, OPEN_OPTION, output_file, show_page
from ..terminal import JSON_OPTION, print_result, say

#: Prefixes of labcdp's own file names, to recognise damaged files.
_OUR_NAMES = ("calibration", "verification")
_BROKEN = "broken"


def history(
    context: typer.Context,
    paths: list[Path] = typer.Argument(
        metavar="FOLDER_OR_FILE...", help="Calibration and verification files, or folders to search for them."
    ),
    output: Path | None = typer.Option(
        None, "--output", "-o", help="File to write: .html (plot and tables), .png or .xlsx; default: print only."
    ),
    force: bool = FORCE_OPTION,
    open_page: bool = OPEN_OPTION,
    as_json: bool = JSON_OPTION,
) -> None:
    """List changes of responsivity, dark signal and gain from calibration to calibration.

    Each camera, lens, f-number and gain has its own table and plot.
    """
    if output is not None and output.suffix not in (".html", ".png", ".xlsx"):
        raise InputError(f"--output is {output}: give a file that ends in .html, .png or .xlsx")
    if open_page and (output is None or output.suffix != ".html"):
        raise InputError("--open opens a page: give --output with a file that ends in .html")
    if output is not None:
        output_file(context, output, force)
    calibrations, verifications = _read(paths)
    found = histories(calibrations, verifications)
    files = [("calibration", path) for path in calibrations] + [("verification", path) for path in verifications]
    result = history_result(found, [InputFile.of(role, path) for role, path in files])
    if output is not None:
        write_history(found, result, output, force=force)
    print_result(result, as_json)
    if output is not None:
        say(f"Written: {output}")
        show_page(output, open_page)


def _read(paths: list[Path]) -> tuple[dict[str, AnyCalibration], dict[str, Verification]]:
    calibrations: dict[str, AnyCalibration] = {}
    verifications: dict[str, Verification] = {}
    named = {real_path(path) for path in paths}
    for path in _files(paths):
        try:
            if _format(path) == VERIFICATION:
                verifications[str(path)] = load_verification(path)
            else:
                calibrations[str(path)] = load_any(path)
        except InputError as error:
            if real_path(path) in named:
                raise
            say(f"Left out: {error}")
    if not calibrations and not verifications:
        raise InputError("none of the files can be read: give files or folders of calibrations")
    return calibrations, verifications


def _files(paths: list[Path]) -> Iterable[Path]:
    """Files that were named, and those found in folders, each once."""
    files: dict[Path, Path] = {}
    for path in paths:
        if path.is_dir():
            inside = [p for p in sorted(path.rglob("*.json")) if _format(p) in (CALIBRATION, VERIFICATION, _BROKEN)]
            if not inside:
                raise InputError(f"{path} contains no calibration: give a folder with results of labcdp calibrate")
            files |= {real_path(p): p for p in inside}
        else:
            files[real_path(path)] = path
    return files.values()


def _format(path: Path) -> object:
    """Return the format of a JSON file; None if labcdp did not write it."""
    try:
        document = read_json(path, "a calibration", MOST_BYTES)
    except InputError:
        return _BROKEN if path.stem.startswith(_OUR_NAMES) else None
    return document.get("format") if isinstance(document, dict) else None
