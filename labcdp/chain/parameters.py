"""Checks of the numbers a stage is given, with one form of message: key, value, allowed range and unit."""

from __future__ import annotations

from collections.abc import Iterable
from math import inf, isfinite
from typing import Any

import numpy as np

from ..core.disk.files import shown
from ..core.errors import InputError

#: Most pixels of a side of a scene or sensor; a larger frame would not fit into any memory.
LARGEST_SIDE = 20_000


def check_number(name: str, value: Any, unit: str, low: float, high: float = inf, *, above: bool = False) -> None:
    """Refuse a value that is not a finite number from `low` to `high` (above `low` if `above`).

    Raises
    ------
    InputError
        Naming the key, its value, the range and the unit.
    """
    if not _is_number(value) or not low <= value <= high or (above and value == low):
        raise InputError(f"{name} is {shown(value)}: give {_interval(low, high, above)}{unit and ' '}{unit}")


#: Name, unit, lowest and highest value of a number, and whether the lowest itself is refused.
Range = tuple[str, str, float, float, bool]


def check_ranges(parameters: object, ranges: Iterable[Range]) -> None:
    """Refuse a dataclass with a number out of its range; raises InputError as `check_number`."""
    for name, unit, low, high, above in ranges:
        check_number(name, getattr(parameters, name), unit, low, high, above=above)


def check_whole(name: str, value: Any, unit: str, low: int, high: float = inf) -> None:
    """Refuse a value that is not a whole number from `low` to `high`; raises InputError as `check_number`."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | np.integer):
        raise InputError(f"{name} is {shown(value)}: give a whole number{unit and ' of '}{unit}")
    check_number(name, value, unit, low, high)


def check_flag(name: str, value: Any) -> None:
    """Refuse a value that is not true or false; raises InputError."""
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{name} is {shown(value)}: give true or false")


def _is_number(value: Any) -> bool:
    """Whether a value is a finite number; a truth value is none, nor a whole number too large for a float."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | float | np.integer | np.floating):
        return False
    return isfinite(value) if not isinstance(value, int) else abs(value) < 2**1000


def _interval(low: float, high: float, above: bool) -> str:
    start = f"a number above {low:g}" if above else f"a number from {low:g}"
    if high == inf:
        return start if above else f"a number of at least {low:g}"
    return f"{start} to {high:g}"
