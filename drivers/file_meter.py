"""Luminance meter whose readings come from a CSV file or a spreadsheet."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from datetime import UTC, date, datetime, time
from os import PathLike
from pathlib import Path
from typing import Final, Self

from ..core.disk import quoted, reason, shortened
from ..core.disk.tables import WrittenRow, WrittenTable, quantity_and_unit, read_table
from ..core.errors import InputError, naming
from ..core.reading import MeterIdentity, Reading
from .manual import MeterAccuracy, WrittenLuminance, WrittenUnit, parse_unit, parse_written, reading_of
from .meter import Meter, MeterError, MeterNotFoundError

#: Columns of luminances, with the unit of those whose name says it.
_LUMINANCE: Final[dict[str, WrittenUnit | None]] = {
    "luminance_cd_m2": "cd/m2",
    "luminance_fl": "fL",
    "luminance": None,
}
#: Symbols of luminance (CIE S 017); with a unit only, as L is also the lightness.
_SYMBOLS: Final = ("l", "lv")
#: What a file of readings is, for messages.
READINGS_FILE: Final = "a CSV file or .xlsx with the columns patch and luminance_cd_m2"


class FileMeter(Meter):
    """Readings of another instrument, from a file; a `Meter`.

    The file is UTF-8 text with a header, or a spreadsheet (.xlsx) with such a table in one of its sheets. Its columns
    are ``patch``; ``luminance_cd_m2`` or ``luminance_fL``, or ``luminance``, ``L`` or ``Lv`` with the unit in the name,
    as in ``luminance (cd/m²)``, ``L [fL]`` and ``L in cd/m2``, in a column ``unit`` or, in text, behind each number;
    and optionally ``time`` (ISO 8601, local where no zone is given), whose date may be in a column ``date``. Others are
    ignored. In text, semicolon, tab or comma separate the cells; a number may have a decimal comma, and with commas as
    separators it must then be quoted. In a spreadsheet luminances are numbers and times are dates or text. A number is
    taken as stored, with the trailing zeros that its cell shows. Without a column ``time`` the readings have the file's
    modification time.

    Parameters
    ----------
    path : path
        The file.
    identity : MeterIdentity
        Meter that took the readings.
    accuracy : MeterAccuracy
        Its accuracy by data sheet or certificate.
    """

    live = False

    def __init__(self, path: str | PathLike[str], identity: MeterIdentity, accuracy: MeterAccuracy) -> None:
        self._path = Path(path)
        self._identity = identity
        self._accuracy = accuracy
        self._readings: dict[str, list[Reading]] | None = None
        self._has_times = False
        self._given: Counter[str] = Counter()
        self._patch: str | None = None

    @property
    def readings(self) -> dict[str, list[Reading]]:
        """All readings of the file by patch, in its order; raises MeterError if it is not open."""
        if self._readings is None:
            raise MeterError(f"{self._path}: the meter is not open", "call open(), or use it in a with statement")
        return self._readings

    @property
    def identity(self) -> MeterIdentity:
        """Model, serial number and calibration date, as given."""
        return self._identity

    @property
    def has_times(self) -> bool:
        """Whether the file says when each reading was taken; raises MeterError if it is not open."""
        return bool(self.readings) and self._has_times

    def open(self) -> Self:
        """Read the file.

        Raises
        ------
        MeterNotFoundError
            If the file is absent or cannot be read.
        InputError
            If its content is invalid; the message names line, or cell, and value.
        """
        if self._readings is None:
            self._readings, self._has_times = _read(self._path, self._identity, self._accuracy)
        return self

    def close(self) -> None:
        """Forget the file and the position in it; may be called twice."""
        self._readings, self._given, self._patch = None, Counter(), None

    def point(self, patch: str) -> None:
        """Select the patch of the next readings; raises MeterError if the file has none of it."""
        if patch not in self.readings:
            known = shortened(", ".join(map(repr, self.readings)))
            raise MeterError(
                f"{self._path} has no reading of patch {quoted(patch)}, only of {known}", "add it, or correct the name"
            )
        self._patch = patch

    def measure(self) -> Reading:
        """Return the next reading of the patch, in the order of the file.

        Raises
        ------
        MeterError
            If the meter is not open, no patch is selected, or the file has no further reading of it.
        """
        readings = self.readings
        if self._patch is None:
            raise MeterError(f"{self._path}: no patch has been chosen", "call point() with its name")
        patch_readings, given = readings[self._patch], self._given[self._patch]
        if given == len(patch_readings):
            raise MeterError(
                f"{self._path} has {given} readings of patch {self._patch!r}, all of them are used",
                "add readings, or ask for fewer",
            )
        self._given[self._patch] += 1
        return patch_readings[given]


def is_readings_header(names: Sequence[str]) -> bool:
    """Whether names of columns are those of readings: a patch and a luminance."""
    return "patch" in map(str.lower, names) and any(map(_is_luminance, names))


def _is_luminance(name: str) -> bool:
    quantity, unit = quantity_and_unit(name)
    return quantity in _LUMINANCE or (quantity in _SYMBOLS and unit is not None)


def _read(path: Path, identity: MeterIdentity, accuracy: MeterAccuracy) -> tuple[dict[str, list[Reading]], bool]:
    """Return the readings by patch, and whether the file has their times."""
    try:
        changed = datetime.fromtimestamp(path.stat().st_mtime, UTC)
    except OSError as error:
        raise MeterNotFoundError(f"{path} cannot be read ({reason(error)})", f"give {READINGS_FILE}") from error
    table = read_table(path, READINGS_FILE, is_readings_header)
    columns = _Columns.of(table, path)
    readings: dict[str, list[Reading]] = {}
    marks: set[str] = set()
    for row in table.rows:
        with _naming_cell(path, row, columns.patch):
            patch = row.text(columns.patch)
            if not patch:
                raise InputError(f"the patch has no name: {quoted(row.raw)}")
        with _naming_cell(path, row, columns.luminance):
            number = row.number_text(columns.luminance)
            marks |= {",", "."} & set(number)
            if len(marks) > 1:
                raise InputError(
                    f"{quoted(number)} has another decimal mark than the numbers above: write all with a point or all "
                    "with a comma, and no mark of thousands"
                )
            written = parse_written(number, comma_is_decimal=table.comma_is_decimal)
        with _naming_cell(path, row, columns.luminance if columns.unit is None else columns.unit):
            unit = columns.unit_of(row, written)
        timestamp = changed
        if columns.time is not None:
            with _naming_cell(path, row, columns.time):
                timestamp = _time(row.text(columns.time), row.text(columns.date) if columns.date is not None else "")
        readings.setdefault(patch, []).append(reading_of(written, unit, accuracy, identity, timestamp, row.raw))
    if not readings:
        raise InputError(f"{path} has a header but no readings: add readings below it")
    return readings, columns.time is not None


@dataclass(frozen=True)
class _Columns:
    """Where the columns of readings are.

    Parameters
    ----------
    patch, luminance : int
        Those that every file has.
    unit_of_all : {'cd/m2', 'fL'} or None
        Unit that the name of the luminances states.
    unit, time, date : int or None
        The others.
    """

    patch: int
    luminance: int
    unit_of_all: WrittenUnit | None
    unit: int | None
    time: int | None
    date: int | None

    @classmethod
    def of(cls, table: WrittenTable, path: Path) -> Self:
        """Understand a header; raises InputError."""
        header = table.header.cells
        with naming(f"{path}, {table.header.place()}"):
            at = _luminance_column(header)
        with _naming_cell(path, table.header, at):
            unit_of_all = _unit_of_column(header[at])
        names = [name.lower() for name in header]
        others = (names.index(name) if name in names else None for name in ("unit", "time", "date"))
        return cls(names.index("patch"), at, unit_of_all, *others)

    def unit_of(self, row: WrittenRow, written: WrittenLuminance) -> WrittenUnit:
        """Return the unit of the luminance of a row; raises InputError if there is none, or two."""
        cell = row.text(self.unit) if self.unit is not None else ""
        units = {self.unit_of_all, written.unit, parse_unit(cell) if cell else None} - {None}
        if len(units) != 1:
            among = f"in {' and in '.join(sorted(map(str, units)))}: give one unit"
            none = "no unit: name the column luminance_cd_m2 or luminance_fL"
            number = quoted(row.cells[self.luminance])
            raise InputError(f"the luminance {number} {'is ' + among if units else 'has ' + none}")
        return "fL" if "fL" in units else "cd/m2"


def _luminance_column(header: Sequence[str]) -> int:
    """Return the column of luminances, of a header that is understood."""
    names = [name.lower() for name in header]
    twice = {name for name in names if names.count(name) > 1 and name in {"patch", "unit", "time", *_LUMINANCE}}
    luminances = [at for at, name in enumerate(header) if _is_luminance(name)]
    there = shortened(", ".join(header))
    if twice:
        raise InputError(f"the column {min(twice)} occurs twice: keep one")
    if "patch" not in names:
        raise InputError(f"there is no column patch, only {there}: name the columns in the first line")
    if len(luminances) != 1:
        raise InputError(f"the columns are {there}: give one of luminance_cd_m2, luminance_fL or luminance with a unit")
    return luminances[0]


def _unit_of_column(name: str) -> WrittenUnit | None:
    """Return the unit that the name of the luminances states."""
    quantity, unit = quantity_and_unit(name)
    stated = {_LUMINANCE.get(quantity), parse_unit(unit) if unit else None} - {None}
    if len(stated) > 1:
        raise InputError(f"the column {quoted(name)} is in two units: give one")
    return next(iter(stated), None)


def _naming_cell(path: Path, row: WrittenRow, column: int) -> AbstractContextManager[None]:
    return naming(f"{path}, {row.place(column)}")


def _time(text: str, day: str) -> datetime:
    """Read a time, whose date is in another cell if it has none; a time without a zone is local."""
    try:
        return _with_date(text, day).astimezone()
    except (ValueError, OverflowError):
        raise InputError(f"the time {quoted(text)} is not known: write it like 2026-03-02 14:05:00+01:00") from None


def _with_date(text: str, day: str) -> datetime:
    """Read a time, whose date is in another cell if it has none; raises ValueError."""
    try:
        return datetime.fromisoformat(text)
    except ValueError:
        # A cell with a date alone has midnight as its time.
        return datetime.combine(date.fromisoformat(day.removesuffix(" 00:00:00")), time.fromisoformat(text))
