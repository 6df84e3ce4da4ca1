"""How values are written on the command line: percentages, pairs, times, parameters of a chain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from math import isfinite, nan
from typing import Any

from ..core.disk.files import shortened, shown
from ..core.errors import InputError
from ..core.percent import of_percent


def fraction_of_percent(text: str, name: str) -> float:
    """Turn ``1000%`` into 10.0.

    Raises
    ------
    InputError
        If it is not a number with a percent sign.
    """
    fraction = of_percent(text)
    if fraction is None:
        # A number whose sign is missing is the best example.
        example = "50%" if of_percent(f"{text}%") is None else f"{text}%"
        raise InputError(
            f"{name} is {shown(text)}: give a number with a percent sign, for example {shortened(example)}"
        )
    return fraction


def parse_pair(text: str, names: Sequence[str], name: str = "--pair") -> tuple[str, str]:
    """Split ``BRIGHT:DARK`` into two of the names, which may hold colons themselves.

    Raises
    ------
    InputError
        If it is not two different names of `names`.
    """
    splits = [(text[:at].strip(), text[at + 1 :].strip()) for at, letter in enumerate(text) if letter == ":"]
    for bright, dark in splits:
        if bright != dark and bright in names and dark in names:
            return bright, dark
    if not splits:
        raise InputError(f"{name} is {shown(text)}: give two names separated by a colon, for example bright:dark")
    missing = next((name for name in splits[0] if name not in names), None)
    if missing is None:
        raise InputError(f"{name} is {shown(text)}: give two different names")
    raise InputError(f"{name} is {shown(text)}, but there is no {missing!r}: choose from {', '.join(names)}")


#: Units of a time in seconds, and of a length in metres.
_TIMES = {"ms": 1e-3, "us": 1e-6, "s": 1.0}
_LENGTHS = {"mm": 1e-3, "um": 1e-6, "µm": 1e-6, "m": 1.0}


def parse_seconds(text: str, name: str) -> float:
    """Turn ``5ms`` into 0.005; raises InputError if it is not a number above 0 with s, ms or us."""
    return _with_unit(text, name, _TIMES, "s, ms or us, for example 5ms")


def parse_length(text: str, name: str) -> float:
    """Turn ``3.45um`` into 3.45e-6; raises InputError if it is not a number above 0 with mm, um or m."""
    return _with_unit(text, name, _LENGTHS, "mm or um, for example 6mm or 3.45um")


def parse_hertz(text: str, name: str) -> float:
    """Turn ``90Hz`` into 90.0; raises InputError if it is not a number above 0 with Hz or kHz."""
    return _with_unit(text, name, {"kHz": 1e3, "Hz": 1.0}, "Hz or kHz, for example 90Hz")


def parse_illuminance(text: str, name: str) -> float:
    """Turn ``1.2klx`` into 1200; raises InputError if it is not a number above 0 with lx or klx."""
    return _with_unit(text, name, {"klx": 1e3, "lx": 1.0}, "lx or klx, for example 1200lx")


def _with_unit(text: str, name: str, units: Mapping[str, float], allowed: str) -> float:
    unit = next((unit for unit in units if text.endswith(unit)), "")
    with suppress(ValueError):
        value = float(text.removesuffix(unit)) * units.get(unit, nan)
        if isfinite(value) and value > 0:
            return value
    raise InputError(f"{name} is {shown(text)}: give a number above 0 with {allowed}")


def parse_temperature(text: str, name: str) -> float:
    """Turn ``31.5`` into a number; raises InputError unless it is from -100 to 200 degC."""
    with suppress(ValueError):
        value = float(text)
        if -100 <= value <= 200:
            return value
    raise InputError(f"{name} is {shown(text)}: give degrees Celsius from -100 to 200, for example 31.5")


def parse_tolerance(text: str, name: str = "--epsilon") -> float:
    """Turn ``50%`` into 0.5; raises InputError unless it is above 0 % and up to 100 %."""
    tolerance = fraction_of_percent(text, name)
    if not 0 < tolerance <= 1:
        raise InputError(f"{name} is {shown(text)}: give a percentage above 0%, up to 100%")
    return tolerance


def parse_changes(changes: Sequence[str], name: str = "--set") -> dict[str, Any]:
    """Return the parameters of a chain that ``--set`` gives, by name; raises InputError for another form."""
    from ..evaluate.sweep.plan import parse_axis

    values: dict[str, Any] = {}
    for text in changes:
        if "=" not in text:
            raise InputError(f"{name} is {shown(text)}: give NAME=VALUE, for example exposure.exposure_s=0.01")
        parameter, _, given = (part.strip() for part in text.partition("="))
        if given in ("true", "false"):
            values[parameter] = given == "true"
            continue
        axis = parse_axis(text)
        values[axis.parameter] = axis.values[0] if len(axis.values) == 1 else list(axis.values)
    return values


def parse_corners(text: str, name: str) -> tuple[tuple[float, float], ...]:
    """Parse the four corners of a chart, ``X,Y X,Y X,Y X,Y``; raises InputError."""
    try:
        corners = [tuple(float(part) for part in corner.split(",")) for corner in text.split()]
        (ax, ay), (bx, by), (cx, cy), (dx, dy) = corners
    except ValueError:
        raise InputError(
            f'{name} is {shown(text)}: give the four corners of the chart, for example "100,50 900,60 890,640 110,650"'
        ) from None
    return (ax, ay), (bx, by), (cx, cy), (dx, dy)


def parse_size(text: str, name: str) -> tuple[int, int]:
    """Parse width and height in pixels, ``2464x2056``; raises InputError."""
    try:
        width, height = (int(part) for part in text.lower().split("x"))
    except ValueError:
        raise InputError(f"{name} is {shown(text)}: give width and height in pixels, for example 2464x2056") from None
    return width, height
