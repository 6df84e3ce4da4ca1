"""Typed luminances: number, decimal point or comma, unit; and a meter whose readings are typed."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from decimal import Decimal
from math import isfinite
from os import PathLike
from pathlib import Path
from typing import Final, Literal, Self

from ..core.disk import quoted, read_csv, reason, shortened
from ..core.errors import InputError
from ..core.reading import MeterIdentity, Reading
from ..session import MeterConfiguration
from .meter import Meter, MeterError, MeterNotFoundError

WrittenUnit = Literal["cd/m2", "fL"]

_WRITTEN: Final = re.compile(
    r"\s*(?P<number>[-+]?[0-9.,]+(?:[eE][-+]?[0-9]{1,2})?)\s*(?P<unit>[^\s0-9.,+-][^,;]*?)?\s*"
)
_NUMBER: Final = re.compile(r"\+?(?:[0-9]{1,15}(?:[.,][0-9]{0,12})?|[.,][0-9]{1,12})(?:[eE][-+]?[0-9]{1,2})?")
_MAYBE_THOUSANDS: Final = re.compile(r"\+?[1-9][0-9]{0,2},[0-9]{3}")
_UNITS: Final[dict[str, WrittenUnit]] = {"cd/m2": "cd/m2", "cd/m^2": "cd/m2", "cd/m²": "cd/m2", "fl": "fL"}


@dataclass(frozen=True)
class MeterAccuracy:
    """Accuracy of a meter, by its data sheet or certificate.

    Parameters
    ----------
    scale_half_width_rel : float
        Bound of the scale error, as a fraction: 0.02 for +-2 %.
    repeatability_rel : float
        Standard deviation of repeated readings, as a fraction.
    digits : int
        Bound of the digit error, in units of the last digit written.

    Raises
    ------
    InputError
        If a number is negative or not finite.
    """

    scale_half_width_rel: float
    repeatability_rel: float
    digits: int

    def __post_init__(self) -> None:
        for name in ("scale_half_width_rel", "repeatability_rel", "digits"):
            value = getattr(self, name)
            if not (isfinite(value) and value >= 0):
                raise InputError(f"{name} is {value}: give a number of at least 0")


def stated_accuracy(described: MeterConfiguration) -> MeterAccuracy:
    """Return the accuracy that a configuration states, which requires all of it where no driver knows the meter."""
    return MeterAccuracy(
        described.scale_half_width_rel or 0.0, described.repeatability_rel or 0.0, described.digits or 0
    )


@dataclass(frozen=True)
class WrittenLuminance:
    """A parsed luminance.

    Parameters
    ----------
    value : float
        The number.
    unit : {'cd/m2', 'fL'} or None
        Its unit, None if none was written.
    resolution : float
        Value of the last digit written.
    """

    value: float
    unit: WrittenUnit | None
    resolution: float


def parse_written(text: str, *, comma_is_decimal: bool = False) -> WrittenLuminance:
    """Read ``12.3``, ``12,3``, ``3.4 fL`` or ``12.3 cd/m2``.

    Parameters
    ----------
    text : str
        Text; blanks around number and unit are ignored.
    comma_is_decimal : bool
        True where a comma can only be the decimal comma. Otherwise ``1,234`` is refused: it may mean 1.234 or 1234.

    Raises
    ------
    InputError
        If it is not a number of at least 0, is ambiguous, or has another unit.
    """
    fields = _WRITTEN.fullmatch(text)
    if fields is None:
        raise InputError(f"{quoted(text.strip())} is not a number: write it like 12.3, 12,3 or 3.4 fL")
    number, unit = fields["number"], fields["unit"]
    if number.startswith("-"):
        raise InputError(f"{shortened(number)} is negative: a luminance is at least 0")
    if _NUMBER.fullmatch(number) is None:
        raise InputError(f"{quoted(number)} is not a number: write it with one decimal point or comma, like 12.3")
    if not comma_is_decimal and _MAYBE_THOUSANDS.fullmatch(number):
        raise InputError(
            f"{quoted(number)} can mean {number.replace(',', '.')} or {number.replace(',', '')}: write one of these"
        )
    exact = Decimal(number.replace(",", "."))
    exponent = exact.as_tuple().exponent
    assert isinstance(exponent, int)  # it is a letter only for NaN and infinity
    resolution = float(Decimal(1).scaleb(exponent))
    return WrittenLuminance(float(exact), None if unit is None else parse_unit(unit), resolution)


def parse_unit(text: str) -> WrittenUnit:
    """Read ``cd/m2``, ``cd/m^2``, ``cd/m²`` or ``fL``, in capitals or not; raises InputError for anything else."""
    unit = text.strip()
    if unit.lower() not in _UNITS:
        raise InputError(f"the unit {quoted(unit)} is not known: give cd/m2 or fL")
    return _UNITS[unit.lower()]


def reading_of(
    written: WrittenLuminance,
    unit: WrittenUnit,
    accuracy: MeterAccuracy,
    meter: MeterIdentity,
    timestamp: datetime,
    raw: str,
) -> Reading:
    """Make a reading of a parsed luminance; the digit error is in units of the last digit written.

    Parameters
    ----------
    written : WrittenLuminance
        Number and resolution.
    unit : {'cd/m2', 'fL'}
        Its unit.
    accuracy : MeterAccuracy
        Of the meter.
    meter : MeterIdentity
        Identity of the meter.
    timestamp : datetime
        With time zone.
    raw : str
        The text, for the record.
    """
    return Reading(
        value=written.value,
        unit=unit,
        resolution=written.resolution,
        scale_half_width_rel=accuracy.scale_half_width_rel,
        digits_half_width=accuracy.digits * written.resolution,
        repeatability_rel=accuracy.repeatability_rel,
        peak=False,
        correction=None,
        held=True,
        meter=meter,
        timestamp=timestamp,
        raw=raw,
    )


def typed_reading(text: str, accuracy: MeterAccuracy, meter: MeterIdentity) -> Reading:
    """Read what a person typed, in cd/m2 unless a unit was typed too; raises InputError as `parse_written`."""
    written = parse_written(text)
    return reading_of(written, written.unit or "cd/m2", accuracy, meter, datetime.now(UTC), text)


_ATTEMPTS: Final = 3


class ManualMeter(Meter):
    """A meter whose readings are typed in; a `Meter`.

    Parameters
    ----------
    ask : callable
        Called with a prompt; returns the typed text, for example `input`.
    identity : MeterIdentity
        Identity of the meter.
    accuracy : MeterAccuracy
        Its accuracy by data sheet or certificate.

    Examples
    --------
    >>> accuracy = MeterAccuracy(scale_half_width_rel=0.03, repeatability_rel=0.002, digits=1)
    >>> with ManualMeter(lambda prompt: "12,3", MeterIdentity("L 1003", "4711"), accuracy) as meter:
    ...     meter.measure().luminance_cd_m2
    12.3
    """

    def __init__(self, ask: Callable[[str], str], identity: MeterIdentity, accuracy: MeterAccuracy) -> None:
        self._ask = ask
        self._identity = identity
        self._accuracy = accuracy
        self._is_open = False

    @property
    def identity(self) -> MeterIdentity:
        """Model, serial number and calibration date, as given."""
        return self._identity

    def open(self) -> Self:
        """Open the meter."""
        self._is_open = True
        return self

    def close(self) -> None:
        """Close the meter; may be called twice."""
        self._is_open = False

    def measure(self) -> Reading:
        """Ask for one reading, up to three times if the input is not a luminance.

        The value of the last digit typed is the resolution: type ``12.30`` if the meter shows it.

        Raises
        ------
        MeterError
            If the meter is not open, input ends, or no answer is a luminance.
        """
        if not self._is_open:
            raise MeterError(
                f"{self._identity.model}: the meter is not open: call open(), or use it in a with statement"
            )
        prompt = f"Luminance shown by {self._identity.model}, in cd/m2 or with its unit like 3.4 fL: "
        problem = ""
        for _ in range(_ATTEMPTS):
            try:
                text = self._ask(f"{problem}{prompt}")
            except EOFError:
                raise MeterError(
                    "no reading of the luminance meter was typed: run the command in an interactive terminal"
                ) from None
            try:
                return typed_reading(text, self._accuracy, self._identity)
            except InputError as error:
                problem = f"{error}. "
        raise MeterError(f"no luminance was typed in {_ATTEMPTS} attempts, last: {problem.removesuffix('. ')}")


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
            If its content is invalid; the message names line and value.
        """
        if self._readings is None:
            self._readings = _read(self._path, self._identity, self._accuracy)
        return self

    def close(self) -> None:
        """Forget the file and the position in it; may be called twice."""
        self._readings, self._given, self._patch = None, {}, None

    def point(self, patch: str) -> None:
        """Select the patch of the next readings.

        Raises
        ------
        MeterError
            If the meter is not open, or the file has no such patch.
        """
        readings = self._opened()
        if patch not in readings:
            known = shortened(", ".join(map(repr, readings)))
            raise MeterError(
                f"{self._path} has no reading of patch {quoted(patch)}, only of {known}: add it, or correct the name"
            )
        self._patch = patch

    def measure(self) -> Reading:
        """Return the next reading of the patch, in the order of the file.

        Raises
        ------
        MeterError
            If the meter is not open, no patch is selected, or the file has no further reading of it.
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


def _read(path: Path, identity: MeterIdentity, accuracy: MeterAccuracy) -> dict[str, list[Reading]]:
    try:
        changed = datetime.fromtimestamp(path.stat().st_mtime, UTC)
    except OSError as error:
        raise MeterNotFoundError(f"{path} cannot be read ({reason(error)}): give a CSV file of readings") from error
    table = read_csv(path, "a CSV file with the columns patch and luminance_cd_m2")
    readings: dict[str, list[Reading]] = {}
    marks: set[str] = set()
    line = 1
    try:
        luminance = _luminance_column(table.header)
        for row in table.rows:
            line, cells = row.line, dict(zip(map(str.lower, table.header), row.cells, strict=True))
            number = cells[luminance]
            marks |= {",", "."} & set(number)
            if len(marks) > 1:
                raise InputError(
                    f"{quoted(number)} has another decimal mark than the numbers above: write all with a point or all "
                    "with a comma, and no mark of thousands"
                )
            if not cells["patch"]:
                raise InputError(f"the patch has no name: {quoted(row.raw)}")
            written = parse_written(number, comma_is_decimal=table.separator != ",")
            unit = _unit(number, _LUMINANCE[luminance], written.unit, cells.get("unit"))
            timestamp = _time(cells["time"]) if "time" in cells else changed
            reading = reading_of(written, unit, accuracy, identity, timestamp, row.raw)
            readings.setdefault(cells["patch"], []).append(reading)
    except InputError as error:
        raise InputError(f"{path}, line {line}: {error}") from error
    if not readings:
        raise InputError(f"{path} has a header and no reading: add readings below it")
    return readings


def _luminance_column(header: Sequence[str]) -> str:
    """Return the name of the column of luminances, of a header that is understood."""
    names = [name.lower() for name in header]
    twice = {name for name in names if names.count(name) > 1 and name in {"patch", "unit", "time", *_LUMINANCE}}
    luminance = [name for name in _LUMINANCE if name in names]
    if twice:
        raise InputError(f"the column {min(twice)} is there twice: keep one")
    if "patch" not in names:
        raise InputError(
            f"there is no column patch, only {shortened(', '.join(header))}: name the columns in the first line"
        )
    if len(luminance) != 1:
        raise InputError(
            f"the columns are {shortened(', '.join(header))}: give one of luminance_cd_m2, luminance_fL or luminance "
            "with a unit"
        )
    return luminance[0]


def _unit(number: str, of_column: WrittenUnit | None, of_number: WrittenUnit | None, cell: str | None) -> WrittenUnit:
    known = {unit for unit in (of_column, of_number, parse_unit(cell) if cell else None) if unit is not None}
    if not known:
        raise InputError(f"the luminance {quoted(number)} has no unit: name the column luminance_cd_m2 or luminance_fL")
    if len(known) > 1:
        raise InputError(f"the luminance {quoted(number)} is in {' and in '.join(sorted(known))}: give one unit")
    return known.pop()


def _time(text: str) -> datetime:
    try:
        # A time without a zone is local.
        return datetime.fromisoformat(text.strip()).astimezone()
    except (ValueError, OverflowError):
        raise InputError(f"the time {quoted(text)} is not known: write it like 2026-03-02 14:05:00+01:00") from None
