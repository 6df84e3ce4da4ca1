"""How values are written on the command line: percentages, contrasts, pairs, times, parameters of a chain."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal, InvalidOperation
from fractions import Fraction
from math import isfinite, nan
from typing import Any

from ..core.disk.files import shown
from ..core.errors import InputError

#: Contrasts outside these limits, in percent, are refused as mistakes: luminance spans some 14 decades.
_LEAST_PERCENT, _MOST_PERCENT = Decimal("0.000000001"), Decimal(1_000_000_000)
#: Larger counts in a range are refused as mistakes.
_MOST_CONTRASTS = 10_000


def fraction_of_percent(text: str, name: str) -> float:
    """Turn ``1000%`` into 10.0.

    Raises
    ------
    InputError
        If it is not a number with a percent sign.
    """
    try:
        fraction = float(text[:-1].strip()) / 100 if text.isascii() and text.endswith("%") else nan
        if not isfinite(fraction):
            raise ValueError
        return fraction
    except ValueError:
        raise InputError(f"{name} is {shown(text)}: give a number with a percent sign, for example 50%") from None


def parse_contrasts(texts: Sequence[str], name: str = "--contrast") -> tuple[float, ...]:
    """Turn ``1000%``, ``50%,100%`` and ``10%:200%:20`` into contrasts.

    Parameters
    ----------
    texts : sequence of str
        Each a percentage, several with commas between them, or ``start:stop:count[:log]`` with both ends included.
    name : str
        Name of the option in messages.

    Returns
    -------
    tuple of float
        Fractions (1.0 is 100 %), rising, each once; each the number nearest to the decimal that was typed.

    Raises
    ------
    InputError
        If a text has another form, or a contrast is not above 0 or out of range.
    """
    found: set[float] = set()
    for text in texts:
        if ":" in text:
            found.update(_range(text, name))
        else:
            found.update(float(_fraction(part, text, name)) for part in text.split(","))
    return tuple(sorted(found))


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
    missing = next((one for one in splits[0] if one not in names), None)
    if missing is None:
        raise InputError(f"{name} is {shown(text)}: give two different names")
    raise InputError(f"{name} is {shown(text)}, but there is no {missing!r}: choose from {', '.join(names)}")


def parse_seconds(text: str, name: str) -> float:
    """Turn ``5ms`` into 0.005.

    Raises
    ------
    InputError
        If it is not a number above 0 with s, ms or us.
    """
    for unit, scale in (("ms", 1e-3), ("us", 1e-6), ("s", 1.0)):
        if text.endswith(unit):
            try:
                value = float(text.removesuffix(unit)) * scale
            except ValueError:
                break
            if isfinite(value) and value > 0:
                return value
            break
    raise InputError(f"{name} is {shown(text)}: give a number above 0 with s, ms or us, for example 5ms")


def parse_tolerance(text: str, name: str = "--epsilon") -> float:
    """Turn ``50%`` into 0.5; raises InputError unless it is above 0 % and up to 100 %."""
    tolerance = fraction_of_percent(text, name)
    if not 0 < tolerance <= 1:
        raise InputError(f"{name} is {shown(text)}: give a percentage above 0%, up to 100%")
    return tolerance


def _range(text: str, name: str) -> list[float]:
    parts = text.split(":")
    logarithmic = len(parts) == 4 and parts[3].strip() == "log"
    if not (len(parts) == 3 or logarithmic):
        raise _refusal(text, name)
    if parts[2].strip().endswith("%"):
        raise InputError(f"{name} is {shown(text)}: the third part is the number of contrasts, for example 10%:200%:20")
    start, stop = (_fraction(part, text, name) for part in parts[:2])
    try:
        count = int(parts[2])
    except ValueError:
        raise _refusal(text, name) from None
    if not (2 <= count <= _MOST_CONTRASTS and start < stop):
        raise InputError(
            f"{name} is {shown(text)}: give a smaller start, a larger stop, and a count of 2 to {_MOST_CONTRASTS}"
        )
    if logarithmic:
        ratio = float(stop / start)
        inner = [float(start) * ratio ** (step / (count - 1)) for step in range(1, count - 1)]
        return [float(start), *inner, float(stop)]
    return [float(start + (stop - start) * step / (count - 1)) for step in range(count)]


def _fraction(part: str, text: str, name: str) -> Fraction:
    """Turn ``1.1%`` into 11/1000: 1.1 / 100 is not the float nearest to 0.011."""
    try:
        if not (part.isascii() and part.strip().endswith("%")):
            raise _refusal(text, name)
        percent = Decimal(part.strip()[:-1].strip())
    except InvalidOperation:
        raise _refusal(text, name) from None
    if not (percent.is_finite() and percent > 0):
        raise InputError(f"{name} is {shown(text)}: give contrasts above 0%")
    if not _LEAST_PERCENT <= percent <= _MOST_PERCENT:
        raise InputError(f"{name} is {shown(text)}: give contrasts from {_LEAST_PERCENT:f}% to {_MOST_PERCENT:f}%")
    return Fraction(percent) / 100


def _refusal(text: str, name: str) -> InputError:
    return InputError(
        f"{name} is {shown(text)}: give a percentage such as 1000%, a list such as 50%,100%, or a range such as "
        "10%:200%:20"
    )


def parse_changes(changes: Sequence[str], name: str = "--set") -> dict[str, Any]:
    """Return the parameters of a chain that ``--set`` gives, by name; raises InputError for another form."""
    from ..evaluate.sweep.plan import parse_axis

    values: dict[str, Any] = {}
    for text in changes:
        if "=" not in text:
            raise InputError(f"{name} is {shown(text)}: give NAME=VALUE, for example exposure.exposure_s=0.01")
        axis = parse_axis(text)
        values[axis.parameter] = axis.values[0] if len(axis.values) == 1 else list(axis.values)
    return values
