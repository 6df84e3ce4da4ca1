"""What a sweep goes over: parameters of a chain with their values, as the user types them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.disk.quoting import shown
from ...core.errors import InputError

Value = float | int | str

_HOW = "give NAME=a,b,c or NAME=start:stop:count or NAME=start:stop:count:log, for example scene.contrast=10%:100%:50"

#: Cells of one axis, beyond which a typing error is more probable than a wish.
_MOST_VALUES = 100_000


@dataclass(frozen=True)
class Axis:
    """One parameter of a chain and the values it takes.

    Parameters
    ----------
    parameter : str
        Table and key, for example ``scene.luminance_cd_m2``.
    values : sequence or array of float, int or str
        At least one, no two equal; all numbers or all text. Held as a tuple.

    Raises
    ------
    InputError
        If there is no value, two are equal, or they are not all numbers or all text.
    """

    parameter: str
    values: tuple[Value, ...]

    def __post_init__(self) -> None:
        given: Any = self.values
        given = given.tolist() if isinstance(given, np.ndarray | np.generic) else given
        if isinstance(given, str) or not isinstance(given, Sequence):
            raise InputError(f"{self.parameter} is {shown(given)}: give a list of numbers or texts")
        given = [one.item() if isinstance(one, np.generic) else one for one in given]
        if not all(isinstance(one, int | float | str) for one in given):
            raise InputError(f"{self.parameter} is {shown(given)}: give a list of numbers or texts")
        object.__setattr__(self, "values", tuple(given))
        if not self.values:
            raise InputError(f"{self.parameter} has no values: {_HOW}")
        if len(set(self.values)) < len(self.values):
            raise InputError(f"{self.parameter} has a value twice: give each value once")
        if any(isinstance(value, bool) for value in self.values):
            raise InputError(f"{self.parameter} has true or false among its values: give numbers or text")
        if len({isinstance(value, str) for value in self.values}) > 1:
            raise InputError(f"{self.parameter} mixes numbers and text: give one or the other")

    @property
    def numeric(self) -> bool:
        """Whether the values are numbers."""
        return not isinstance(self.values[0], str)


def parse_axis(text: str) -> Axis:
    """Read an axis as typed: a list of values, or start, stop and count of evenly spaced ones.

    Parameters
    ----------
    text : str
        ``NAME=a,b,c``, ``NAME=start:stop:count`` or ``NAME=start:stop:count:log``. Numbers may have a percent sign.

    Raises
    ------
    InputError
        If it is none of these.
    """
    parameter, equals, given = (part.strip() for part in text.partition("="))
    if not (parameter and equals and given):
        raise InputError(f"{text!r} is no axis: {_HOW}")
    if ":" in given:
        return Axis(parameter, _spaced(parameter, given))
    items = [item.strip() for item in given.split(",")]
    if "" in items:
        raise InputError(f"{text!r} has an empty value: {_HOW}")
    return Axis(parameter, tuple(parse_value(item) for item in items))


def parse_value(text: str) -> Value:
    """Read true, false, a whole number, a number, a percentage as a fraction, or else text."""
    if text in ("true", "false"):
        return text == "true"
    try:
        return int(text)
    except ValueError:
        pass
    try:
        return float(text[:-1]) / 100 if text.endswith("%") else float(text)
    except ValueError:
        return text


def _spaced(parameter: str, given: str) -> tuple[Value, ...]:
    parts = [parse_value(part.strip()) for part in given.split(":")]
    logarithmic = parts[-1] == "log"
    numbers = parts[:-1] if logarithmic else parts
    if len(numbers) != 3 or any(isinstance(number, str) for number in numbers):
        raise InputError(f"{parameter}={given} is no axis: {_HOW}")
    start, stop, count = (float(number) for number in numbers)
    if not (np.isfinite([start, stop]).all() and count.is_integer() and 2 <= count <= _MOST_VALUES and start != stop):
        raise InputError(
            f"{parameter}={given}: give two different finite ends and a whole count of 2 to {_MOST_VALUES}"
        )
    if not logarithmic:
        values = np.linspace(start, stop, int(count))
        if all(isinstance(number, int) for number in numbers[:2]) and (values == values.round()).all():
            # Parameters such as bits take whole numbers only.
            return tuple(int(value) for value in values)
        return tuple(float(value) for value in values)
    if not (start > 0 and stop > 0):
        raise InputError(f"{parameter}={given}: a logarithmic axis needs ends above 0")
    return tuple(float(value) for value in np.geomspace(start, stop, int(count)))
