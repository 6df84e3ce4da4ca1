"""What messages quote of an input: little, and printable."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

#: Characters of an input in a message.
MOST_QUOTED = 100
#: Most digits of a whole number; more indicate damage, and parsing time is quadratic.
MOST_DIGITS = 40


def printable(text: str) -> str:
    r"""Return the text with all control characters, and what else has no picture, escaped: ``\\x1b`` for ESC."""
    return text if text.isprintable() else "".join(map(_escaped, text))


def _escaped(character: str) -> str:
    return character if character.isprintable() else character.encode("unicode_escape").decode()


def shortened(text: str, most: int = MOST_QUOTED) -> str:
    """Return the text, printable, and cut if it is long."""
    # Cut first: escaping text of many megabytes takes long.
    text = printable(text[: most + 1])
    return text if len(text) <= most else f"{text[: most - 3]}..."


def quoted(value: object) -> str:
    """Return a value as messages show it: as JSON has it, and short."""
    if isinstance(value, bool) or value is None:
        return {True: "true", False: "false", None: "null"}[value]
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list | tuple) and len(value) > 4:
        return f"a list of {len(value)}"
    if isinstance(value, str | bytes):
        value = value[: MOST_QUOTED + 1]
    if isinstance(value, list | tuple):
        value = type(value)(map(_short, value))
    return shown(value)


def _short(value: object) -> object:
    return value if isinstance(value, float) else _Shown(quoted(value))


class _Shown(str):
    """A text whose repr is itself."""

    __slots__ = ()

    def __repr__(self) -> str:
        return str(self)


def shown(value: object) -> str:
    """Return a value as messages about parameters show it: as Python writes it, and short."""
    if isinstance(value, int) and abs(value) >= 10**MOST_DIGITS:
        return f"a number of more than {MOST_DIGITS} digits"
    return shortened(repr(value))


def closest(name: object, known: Iterable[str]) -> str | None:
    """Return the known name that is most like one that is not known, None if none is."""
    return next(iter(get_close_matches(str(name)[:MOST_QUOTED], known, n=1)), None)


def reason(error: BaseException) -> str:
    """Return why something failed as one short line: of an error of the system its text, of others the first line."""
    if isinstance(error, OSError) and error.strerror:
        return shortened(error.strerror)
    if isinstance(error, RecursionError):
        return "nested too deep"
    first = next(iter(str(error).strip().splitlines()), "")
    return shortened(first) if first else type(error).__name__
