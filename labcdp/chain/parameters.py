"""Checks of the numbers a stage is given, with one form of message: key, value, allowed range and unit."""

from __future__ import annotations

import operator
from math import inf, isfinite
from typing import Any

import numpy as np

from ..errors import InputError


def check_number(name: str, value: Any, unit: str, low: float, high: float = inf, *, above: bool = False) -> None:
    """Refuse a value that is not a finite number from `low` to `high` (above `low` if `above`).

    Raises
    ------
    InputError
        Naming the key, its value, the range and the unit.
    """
    if (
        not isinstance(value, int | float | np.integer | np.floating)
        or not isfinite(value)
        or not low <= value <= high
        or (above and value == low)
    ):
        raise InputError(f"{name} is {value!r}: give {_interval(low, high, above)}{unit and ' '}{unit}")


def check_whole(name: str, value: Any, unit: str, low: int, high: float = inf) -> None:
    """Refuse a value that is not a whole number from `low` to `high`; raises InputError as `check_number`."""
    try:
        operator.index(value)
    except TypeError:
        raise InputError(f"{name} is {value!r}: give a whole number{unit and ' of '}{unit}") from None
    check_number(name, value, unit, low, high)


def _interval(low: float, high: float, above: bool) -> str:
    start = f"a number above {low:g}" if above else f"a number from {low:g}"
    if high == inf:
        return start if above else f"a number of at least {low:g}"
    return f"{start} to {high:g}"
