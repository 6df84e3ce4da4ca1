"""Numbers as a person types them: with a decimal point or comma, with the unit of the field or without."""

from __future__ import annotations

import re
from collections.abc import Sequence
from math import isfinite

from ..core.disk import quoted
from ..core.errors import InputError

_NUMBER = re.compile(r"[-+]?(?:[0-9]+(?:[.,][0-9]*)?|[.,][0-9]+)(?:[eE][-+]?[0-9]{1,3})?")
#: A comma that stands between two digits is that of a decimal; another one parts two numbers.
_PARTING = re.compile(r"[\s;]+|(?<![0-9]),|,(?![0-9])")
#: Words between numbers, which labels show.
_WORDS = re.compile(r"\b(?:from|to|x|y)\b|[()=→]|cd/m[²2]|(?<=\d)\s*px\b", re.IGNORECASE)


def number(text: str, unit: str = "") -> float:
    """Read a number; raises InputError if it is none, or has another unit than that of its field."""
    given = text.strip().replace("\N{MINUS SIGN}", "-")
    match = _NUMBER.match(given)
    rest = given[match.end() :].strip() if match else given
    value = float(match[0].replace(",", ".")) if match else float("nan")
    if not isfinite(value) or rest not in ("", unit):
        wanted = f"a number in {unit}" if unit else "a number"
        raise InputError(f"{quoted(given)} is not {wanted}: write it like 2.5 or 2,5")
    return value


def number_list(text: str) -> tuple[float, ...]:
    """Read numbers that are apart by blanks, semicolons or commas; a comma between two digits is a decimal's.

    Raises
    ------
    InputError
        If something else is there.
    """
    return tuple(number(part) for part in _parts(text))


def coordinates(text: str, n: int) -> tuple[float, ...]:
    """Read `n` coordinates, with the words of their label or without: ``from 10, 20 to 30, 40``.

    Where it is only by this that there are as many, a comma without a blank parts two of them: ``10,20 30,40``.

    Raises
    ------
    InputError
        If there are not as many.
    """
    plain = _WORDS.sub(" ", text)
    for parts in (_parts(plain), _parts(plain.replace(",", " "))):
        if len(parts) == n:
            return tuple(number(part) for part in parts)
    raise InputError(f"{quoted(text.strip())} is not {n} numbers: write them like {', '.join(_EXAMPLES[:n])}")


_EXAMPLES = ("100", "200", "300", "400")


def parted(text: str) -> list[str]:
    """Return the parts of a list: a comma between two digits is that of a decimal, which is written as a point."""
    return [re.sub(r"(?<=[0-9]),(?=[0-9])", ".", part) for part in _parts(text)]


def _parts(text: str) -> Sequence[str]:
    tokens = (token for token in _PARTING.split(text) if token)
    # Several commas in a row are no decimals.
    return [part for token in tokens for part in (token.split(",") if token.count(",") > 1 else [token])]
