"""Luminance meter whose readings come from a CSV file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime
from os import PathLike
from pathlib import Path
from typing import Final, Self

from ..core.disk import quoted, read_csv, reason, shortened
from ..core.errors import InputError
from ..core.reading import MeterIdentity, Reading
from .manual import MeterAccuracy, WrittenUnit, parse_unit, parse_written, reading_of
from .meter import Meter, MeterError, MeterNotFoundError

#: Columns of luminances, with the unit of those whose name says it.
_LUMINANCE: Final[dict[str, WrittenUnit | None]] = {
    "luminance_cd_m2": "cd/m2",
    "luminance_fl": "fL",
    "luminance": None,
}


class CsvMeter(Meter):
    """Readings of another instrument, from a file; a `Meter`.

    The file is UTF-8 text with a header. Its columns are ``patch``; ``luminance_cd_m2`` or ``luminance_fL``, or
    ``luminance`` with the unit in a column ``unit`` or behind each number; and optionally ``time`` (ISO 8601, local
    where no zone is given). Others are ignored. Semicolon, tab or comma separate the cells. A number may have a decimal
    comma; with commas as separators it must then be quoted. Without a column ``time`` the readings have the file's
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
            If its content is invalid; the message names line and value.
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


def _read(path: Path, identity: MeterIdentity, accuracy: MeterAccuracy) -> tuple[dict[str, list[Reading]], bool]:
    """Return the readings by patch, and whether the file has their times."""
    try:
        changed = datetime.fromtimestamp(path.stat().st_mtime, UTC)
    except OSError as error:
        raise MeterNotFoundError(f"{path} cannot be read ({reason(error)})", "give a CSV file of readings") from error
    table = read_csv(path, "a CSV file with the columns patch and luminance_cd_m2")
    names = [name.lower() for name in table.header]
    readings: dict[str, list[Reading]] = {}
    marks: set[str] = set()
    line = 1
    try:
        column = _luminance_column(names)
        for row in table.rows:
            line, cells = row.line, dict(zip(names, row.cells, strict=True))
            patch, number = cells["patch"], cells[column]
            marks |= {",", "."} & set(number)
            if len(marks) > 1:
                raise InputError(
                    f"{quoted(number)} has another decimal mark than the numbers above: write all with a point or all "
                    "with a comma, and no mark of thousands"
                )
            if not patch:
                raise InputError(f"the patch has no name: {quoted(row.raw)}")
            written = parse_written(number, comma_is_decimal=table.separator != ",")
            cell = cells.get("unit")
            units = {_LUMINANCE[column], written.unit, parse_unit(cell) if cell else None} - {None}
            if len(units) != 1:
                among = f"in {' and in '.join(sorted(map(str, units)))}: give one unit"
                none = "no unit: name the column luminance_cd_m2 or luminance_fL"
                raise InputError(f"the luminance {quoted(number)} {'is ' + among if units else 'has ' + none}")
            timestamp = _time(cells["time"]) if "time" in cells else changed
            unit: WrittenUnit = "fL" if "fL" in units else "cd/m2"
            readings.setdefault(patch, []).append(reading_of(written, unit, accuracy, identity, timestamp, row.raw))
    except InputError as error:
        raise InputError(f"{path}, line {line}: {error}") from error
    if not readings:
        raise InputError(f"{path} has a header but no readings: add readings below it")
    return readings, "time" in names


def _luminance_column(names: Sequence[str]) -> str:
    """Return the name of the column of luminances, of a header that is understood."""
    twice = {name for name in names if names.count(name) > 1 and name in {"patch", "unit", "time", *_LUMINANCE}}
    luminance = [name for name in _LUMINANCE if name in names]
    there = shortened(", ".join(names))
    if twice:
        raise InputError(f"the column {min(twice)} occurs twice: keep one")
    if "patch" not in names:
        raise InputError(f"there is no column patch, only {there}: name the columns in the first line")
    if len(luminance) != 1:
        raise InputError(f"the columns are {there}: give one of luminance_cd_m2, luminance_fL or luminance with a unit")
    return luminance[0]


def _time(text: str) -> datetime:
    try:
        # A time without a zone is local.
        return datetime.fromisoformat(text.strip()).astimezone()
    except (ValueError, OverflowError):
        raise InputError(f"the time {quoted(text)} is not known: write it like 2026-03-02 14:05:00+01:00") from None
