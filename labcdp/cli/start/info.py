"""Command info: kind and content of a file, and the commands that use it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from shlex import quote

import typer

from ...core.errors import InputError, LabcdpError
from ...core.result import Result
from ...core.table import Column, Table
from ..terminal import JSON_OPTION, print_result, say
from . import kinds
from .kinds import Description


def info(
    file: Path = typer.Argument(
        help="A session, calibration, folder of results, results.json, picture, video, region file, bench plan, chain, "
        "camera specification, map, spectral sensitivity or EMVA 1288 data set."
    ),
    source: str = typer.Option(
        "A", help="For a spectral sensitivity: light of the calibration, a name or a CSV file with its spectral power."
    ),
    as_json: bool = JSON_OPTION,
) -> None:
    """Identify a file, and list its content and the commands that use it.

    For a camera's spectral sensitivity (CSV with wavelength_nm and R, G, B, or one column), compute f1' and the
    factors that correct luminances in other light.
    """
    result, commands = describe(file, source)
    print_result(result, as_json)
    if not as_json:
        for command in commands:
            say(f"Next: labcdp {command}")


def describe(path: Path, source: str) -> tuple[Result, list[str]]:
    """Return the kind of a file, and the commands that use it, without the program's name.

    Raises
    ------
    InputError
        If it cannot be read, is damaged, or is nothing labcdp knows.
    """
    if not path.exists():
        raise InputError(f"{path} does not exist: give a file or folder")
    what, properties, tables, commands = _look(path, source)
    columns = (Column("property", "property"), Column("value", "value"))
    rows = [{"property": name, "value": value} for name, value in {"kind": what, **properties}.items()]
    first = Table.of_rows("properties", str(path), columns, rows)
    return Result("info", str(path), (first, *tables)), [text.format(file=quote(str(path))) for text in commands]


def _look(path: Path, source: str) -> Description:
    """Try all kinds of file; a damaged file with the name of a kind raises the error of that kind."""
    if path.is_dir():
        return kinds.folder(path)
    suffix = path.suffix.lower()
    if suffix == ".csv":
        return kinds.spectra(path, source)
    readers: Sequence[Callable[[Path], Description]] = {
        ".json": (kinds.document,),
        ".toml": (kinds.toml,),
        ".roi": (kinds.regions,),
        ".zip": (kinds.regions,),
        ".nc": (kinds.map_file,),
        ".txt": (kinds.data_set,),
    }.get(suffix, (kinds.picture, kinds.video))
    errors = []
    for read in readers:
        try:
            return read(path)
        except LabcdpError as error:
            errors.append(error)
    raise errors[0]
