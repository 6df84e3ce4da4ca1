"""A luminance meter whose readings stand in a CSV file, patch by patch."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from os import PathLike
from pathlib import Path
from typing import Final, Self

from ..errors import InputError
from ..reading import MeterIdentity, Reading
from .device import Device
from .meter import MeterError, MeterNotFoundError
from .written_reading import MeterAccuracy, WrittenUnit, parse_unit, parse_written, reading_of

_LUMINANCE: Final[dict[str, WrittenUnit | None]] = {
    "luminance_cd_m2": "cd/m2",
    "luminance_fl": "fL",
    "luminance": None,
}


class CsvMeter(Device):
    """Readings of another instrument, from a file; a `Meter`.

    The file is UTF-8 text with a header. Its columns are ``patch``; ``luminance_cd_m2`` or ``luminance_fL``, or
    ``luminance`` with the unit in a column ``unit`` or behind each number; and, if wanted, ``time`` (ISO 8601, local
    where no zone is given). Others are ignored. Semicolon, tab or comma separate the cells. A number may have a
    decimal comma; between commas as separators it must stand in quotes then. Without a column ``time`` the readings
    have the time the file was last changed.

    Parameters
    ----------
    path : path
        The file.
    identity : MeterIdentity
        Which meter took the readings.
    accuracy : MeterAccuracy
        Its accuracy by data sheet or certificate.
    """

    def __init__(self, path: str | PathLike[str], identity: MeterIdentity, accuracy: MeterAccuracy) -> None:
        self._path = Path(path)
        self._identity = identity
        self._accuracy = accuracy
        self._readings: dict[str, list[Reading]] | None = None
        self._given: dict[str, int] = {}
        self._patch: str | None = None

    @property
    def identity(self) -> MeterIdentity:
        """Model, serial number and calibration date, as given."""
        return self._identity

    @property
    def readings(self) -> dict[str, tuple[Reading, ...]]:
        """All readings of the file by patch, in its order; raises MeterError if it is not open."""
        return {patch: tuple(readings) for patch, readings in self._opened().items()}

    def open(self) -> Self:
        """Read the file.

        Raises
        ------
        MeterNotFoundError
            If the file is absent or cannot be read.
        InputError
            If it is no such file; the message names the line and the value.
        """
        if self._readings is None:
            self._readings = _read(self._path, self._identity, self._accuracy)
        return self

    def close(self) -> None:
        """Forget the file and what was given of it; may be called twice."""
        self._readings, self._given, self._patch = None, {}, None

    def point(self, patch: str) -> None:
        """Choose the patch of the next readings.

        Raises
        ------
        MeterError
            If the meter is not open, or the file has no such patch.
        """
        readings = self._opened()
        if patch not in readings:
            raise MeterError(
                f"{self._path} has no reading of patch {patch!r}, only of {', '.join(map(repr, readings))}: add it, or "
                "correct the name"
            )
        self._patch = patch

    def measure(self) -> Reading:
        """Give the next reading of the patch, in the order of the file.

        Raises
        ------
        MeterError
            If the meter is not open, no patch is chosen, or the file has no further reading of it.
        """
        readings = self._opened()
        if self._patch is None:
            raise MeterError(f"{self._path}: no patch is chosen: call point() with the name of one")
        of_patch, given = readings[self._patch], self._given.get(self._patch, 0)
        if given == len(of_patch):
            raise MeterError(
                f"{self._path} has {given} readings of patch {self._patch!r}, all of them are used: add readings, or "
                "ask for fewer"
            )
        self._given[self._patch] = given + 1
        return of_patch[given]

    def _opened(self) -> dict[str, list[Reading]]:
        if self._readings is None:
            raise MeterError(f"{self._path}: the meter is not open: call open(), or use it in a with statement")
        return self._readings


@dataclass(frozen=True)
class _Columns:
    """Where the cells stand in a row."""

    patch: int
    luminance: int
    luminance_unit: WrittenUnit | None
    unit: int | None
    time: int | None
    comma_is_decimal: bool


def _read(path: Path, identity: MeterIdentity, accuracy: MeterAccuracy) -> dict[str, list[Reading]]:
    try:
        text = path.read_text(encoding="utf-8-sig")
        changed = datetime.fromtimestamp(path.stat().st_mtime, UTC)
    except OSError as error:
        raise MeterNotFoundError(f"{path} cannot be read ({error.strerror}): give a CSV file of readings") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not UTF-8 text (byte {error.start}): save it as CSV in UTF-8") from error
    lines = text.splitlines()
    if not lines:
        raise InputError(f"{path} is empty: give a CSV file with the columns patch and luminance_cd_m2")
    separator = next((one for one in ";\t" if one in lines[0]), ",")
    rows = csv.reader(lines, delimiter=separator, skipinitialspace=True, strict=True)
    readings: dict[str, list[Reading]] = {}
    columns: _Columns | None = None
    width = 0
    marks: set[str] = set()
    try:
        for row in rows:
            if columns is None:
                columns, width = _columns(row, separator), len(row)
            elif any(cell.strip() for cell in row):
                if len(row) != width:
                    raise InputError(_wrong_width(row, width, separator))
                patch = row[columns.patch].strip()
                marks |= {",", "."} & set(row[columns.luminance])
                if len(marks) > 1:
                    raise InputError(
                        f"{row[columns.luminance].strip()!r} has another decimal mark than the numbers above: write "
                        "all with a point or all with a comma, and no mark of thousands"
                    )
                reading = _reading(row, columns, identity, accuracy, changed, lines[rows.line_num - 1])
                readings.setdefault(patch, []).append(reading)
    except (InputError, csv.Error) as error:
        raise InputError(f"{path}, line {rows.line_num}: {error}") from error
    if not readings:
        raise InputError(f"{path} has a header and no reading: add readings below it")
    return readings


def _columns(header: Sequence[str], separator: str) -> _Columns:
    names = [name.strip().lower() for name in header]
    twice = {name for name in names if names.count(name) > 1 and name in {"patch", "unit", "time", *_LUMINANCE}}
    luminance = [name for name in _LUMINANCE if name in names]
    if twice:
        raise InputError(f"the column {min(twice)} is there twice: keep one")
    if "patch" not in names:
        raise InputError(f"there is no column patch, only {', '.join(header)}: name the columns in the first line")
    if len(luminance) != 1:
        raise InputError(
            f"the columns are {', '.join(header)}: give one of luminance_cd_m2, luminance_fL or luminance with a unit"
        )
    return _Columns(
        patch=names.index("patch"),
        luminance=names.index(luminance[0]),
        luminance_unit=_LUMINANCE[luminance[0]],
        unit=names.index("unit") if "unit" in names else None,
        time=names.index("time") if "time" in names else None,
        comma_is_decimal=separator != ",",
    )


def _wrong_width(row: Sequence[str], width: int, separator: str) -> str:
    hint = "; a number with a decimal comma stands in quotes, or semicolons separate" if separator == "," else ""
    return f"it has {len(row)} cells, the header has {width}: {separator.join(row)!r}{hint}"


def _reading(
    row: Sequence[str],
    columns: _Columns,
    identity: MeterIdentity,
    accuracy: MeterAccuracy,
    changed: datetime,
    raw: str,
) -> Reading:
    if not row[columns.patch].strip():
        raise InputError(f"the patch has no name: {raw!r}")
    number = row[columns.luminance]
    written = parse_written(number, comma_is_decimal=columns.comma_is_decimal)
    units = {columns.luminance_unit, written.unit}
    if columns.unit is not None and row[columns.unit].strip():
        units.add(parse_unit(row[columns.unit]))
    known = [unit for unit in units if unit is not None]
    if not known:
        raise InputError(f"the luminance {number!r} has no unit: name the column luminance_cd_m2 or luminance_fL")
    if len(known) > 1:
        raise InputError(f"the luminance {number!r} is in {' and in '.join(sorted(known))}: give one unit")
    timestamp = changed if columns.time is None else _time(row[columns.time])
    return reading_of(written, known[0], accuracy, identity, timestamp, raw)


def _time(text: str) -> datetime:
    try:
        # A time without a zone is taken for local.
        return datetime.fromisoformat(text.strip()).astimezone()
    except (ValueError, OverflowError):
        raise InputError(f"the time {text!r} is not known: write it like 2026-03-02 14:05:00+01:00") from None
