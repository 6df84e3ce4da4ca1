"""Checks of what a shape is given: its name, numbers and limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from math import isfinite
from numbers import Real
from typing import Any

from ..core.disk.files import MOST_QUOTED, quoted
from ..core.errors import InputError

#: Coordinates beyond any image.
MOST_PX = 1e7


def check_name(name: object) -> None:
    """Refuse what is no name for a region: 1 to 100 printable characters, no space at its ends; raises InputError."""
    good = isinstance(name, str) and 0 < len(name) <= MOST_QUOTED and name == name.strip() and name.isprintable()
    if not good:
        raise InputError(
            f"the name of a region is {quoted(name)}: give 1 to {MOST_QUOTED} printable characters, without spaces at "
            "its ends"
        )


def check_box(shape: Any) -> None:
    """Make the numbers of a shape with a box floats; raises InputError for what is not finite or has no size."""
    for one in fields(shape):
        if one.name not in ("name", "rows", "columns", "limits_cd_m2"):
            object.__setattr__(shape, one.name, number(shape.name, one.name, getattr(shape, one.name)))
    check_limits(shape)
    for key in ("width", "height"):
        value = getattr(shape, key)
        if not value > 0:
            raise InputError(f"region {quoted(shape.name)}: {key} is {value:g}: give a number of pixels above 0")


def check_limits(shape: Any) -> None:
    """Make the limits of a shape floats, and refuse others; raises InputError."""
    given = shape.limits_cd_m2
    if given is None:
        return
    if not (isinstance(given, Sequence) and not isinstance(given, str) and len(given) == 2):
        raise InputError(f"region {quoted(shape.name)}: limits_cd_m2 is {quoted(given)}: give two numbers [low, high]")
    low, high = (number(shape.name, "limits_cd_m2", one) for one in given)
    if not 0 <= low < high:
        raise InputError(f"region {quoted(shape.name)}: limits_cd_m2 is [{low:g}, {high:g}]: give 0 <= low < high")
    object.__setattr__(shape, "limits_cd_m2", (low, high))


def number(name: str, key: str, value: object) -> float:
    """Return a finite number of a region as a float; raises InputError."""
    if type(value) is not bool and isinstance(value, Real):
        try:
            number = float(value)
        except OverflowError:
            number = float("inf")
        if abs(number) <= MOST_PX:
            return number
        if isfinite(number):
            raise InputError(
                f"region {quoted(name)}: {key} is {number:g}: give a number from {-MOST_PX:g} to {MOST_PX:g}"
            )
    raise InputError(f"region {quoted(name)}: {key} is {quoted(value)}: give a finite number")
