"""Luminances as a person writes them: number, decimal point or comma, unit; and a meter whose readings are typed."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from decimal import Decimal
from math import isfinite
from typing import Final, Literal, Self

from ..core.disk import quoted, shortened
from ..core.errors import InputError
from ..core.reading import MeterIdentity, Reading
from ..session import MeterConfiguration
from .meter import Meter, MeterError

WrittenUnit = Literal["cd/m2", "fL"]

_WRITTEN: Final = re.compile(
    r"\s*(?P<number>[-+]?[0-9.,]+(?:[eE][-+]?[0-9]{1,2})?)\s*(?P<unit>[^\s0-9.,+-][^,;]*?)?\s*"
)
_NUMBER: Final = re.compile(r"\+?(?:[0-9]{1,15}(?:[.,][0-9]{0,20})?|[.,][0-9]{1,20})(?:[eE][-+]?[0-9]{1,2})?")
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

    Examples
    --------
    >>> from labcdp.drivers.manual import MeterAccuracy
    >>> MeterAccuracy(scale_half_width_rel=0.03, repeatability_rel=0.002, digits=1).digits
    1
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
    """Return the accuracy that a configuration states, which requires all of it where no driver knows the meter.

    Examples
    --------
    >>> from labcdp.drivers.manual import stated_accuracy
    >>> from labcdp.session import MeterConfiguration
    >>> stated = {"scale_half_width_rel": 0.03, "repeatability_rel": 0.002, "digits": 1}
    >>> stated_accuracy(MeterConfiguration(model="L 1003", serial="4711", entry="by hand", **stated)).digits
    1
    """
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

    Examples
    --------
    >>> from labcdp.drivers.manual import WrittenLuminance
    >>> WrittenLuminance(12.3, "cd/m2", resolution=0.1).resolution
    0.1
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

    Examples
    --------
    >>> from labcdp.drivers.manual import parse_written
    >>> parse_written("12,30 cd/m2")
    WrittenLuminance(value=12.3, unit='cd/m2', resolution=0.01)
    >>> parse_written("1,234", comma_is_decimal=True).value
    1.234
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
            f"{quoted(number)} is ambiguous, {number.replace(',', '.')} or {number.replace(',', '')}: write one of "
            "these"
        )
    exact = Decimal(number.replace(",", "."))
    resolution = float(Decimal(1).scaleb(int(exact.as_tuple().exponent)))
    return WrittenLuminance(float(exact), None if unit is None else parse_unit(unit), resolution)


def parse_unit(text: str) -> WrittenUnit:
    """Read ``cd/m2``, ``cd/m^2``, ``cd/m²`` or ``fL``, in capitals or not; raises InputError for anything else.

    Examples
    --------
    >>> from labcdp.drivers.manual import parse_unit
    >>> parse_unit("CD/M^2"), parse_unit("fl")
    ('cd/m2', 'fL')
    """
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
    """Make a reading of a parsed luminance, at a time with time zone; `raw` is the text, for the record.

    The digit error is in units of the last digit written.

    Examples
    --------
    >>> from datetime import UTC, datetime
    >>> from labcdp.core.reading import MeterIdentity
    >>> from labcdp.drivers.manual import MeterAccuracy, parse_written, reading_of
    >>> text, meter = "12.3", MeterIdentity("L 1003", "4711")
    >>> accuracy = MeterAccuracy(scale_half_width_rel=0.03, repeatability_rel=0.002, digits=2)
    >>> reading_of(parse_written(text), "cd/m2", accuracy, meter, datetime.now(UTC), text).digits_half_width
    0.2
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
    """Read what a person typed, in cd/m2 unless a unit was typed too; raises InputError as `parse_written`.

    Examples
    --------
    >>> from labcdp.core.reading import MeterIdentity
    >>> from labcdp.drivers.manual import MeterAccuracy, typed_reading
    >>> accuracy = MeterAccuracy(scale_half_width_rel=0.03, repeatability_rel=0.002, digits=1)
    >>> typed_reading("12,3", accuracy, MeterIdentity("L 1003", "4711")).unit
    'cd/m2'
    """
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

    live = False

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
        name = self._identity.model
        if not self._is_open:
            raise MeterError(f"{name}: the meter is not open", "call open(), or use it in a with statement")
        problem = ""
        for _ in range(_ATTEMPTS):
            try:
                text = self._ask(f"{problem}Luminance shown by {name}, in cd/m2 or with its unit like 3.4 fL: ")
                return typed_reading(text, self._accuracy, self._identity)
            except EOFError:
                raise MeterError(
                    "no reading of the luminance meter was typed", "run the command in an interactive terminal"
                ) from None
            except InputError as error:
                problem = f"{error}. "
        raise MeterError(f"no luminance was typed in {_ATTEMPTS} attempts, last", f"{problem.removesuffix('. ')}")
