"""Parser of fault commands of the simulated bench, for schedules and typed commands."""

from __future__ import annotations

import re
from collections.abc import Callable
from difflib import get_close_matches
from typing import Final

from ....core.disk.quoting import MOST_QUOTED, quoted
from ....core.errors import ConfigurationError
from .commands import (
    CameraFault,
    CameraFaultKind,
    Command,
    Drift,
    MeterRemote,
    MeterReplyFault,
    MeterUnit,
    MeterUnplug,
    Recover,
    Scheduled,
)

_SECONDS: Final = {"ms": 0.001, "s": 1.0, "min": 60.0, "h": 3600.0}
_NUMBER: Final = r"[0-9]{1,9}(?:\.[0-9]{1,12})?"
_TIME: Final = rf"({_NUMBER}) ?(ms|s|min|h)"
_LASTS: Final = rf"(?: for {_TIME})?"
_WITHIN: Final = rf"(?: in {_TIME})?"


def _seconds(value: str | None, unit: str | None) -> float | None:
    return None if value is None or unit is None else float(value) * _SECONDS[unit]


def _lose(match: re.Match[str]) -> Command:
    percent = float(match[1])
    if percent > 100:
        raise ValueError(f"{percent:g}% is more than all packets")
    return CameraFault("lose", _seconds(match[2], match[3]), percent / 100)


def _lasting(kind: CameraFaultKind) -> Callable[[re.Match[str]], Command]:
    return lambda match: CameraFault(kind, _seconds(match[1], match[2]))


def _light(match: re.Match[str]) -> Command:
    change = float(match[1]) / 100
    if change < -1:
        raise ValueError(f"{100 * change:g}% leaves no light")
    return Drift("light", change, _seconds(match[2], match[3]) or 0.0)


def _temperature(match: re.Match[str]) -> Command:
    change_c = float(match[1])
    if abs(change_c) > _LARGEST_CHANGE_C:
        raise ValueError(f"{change_c:g} C is out of range (at most {_LARGEST_CHANGE_C} C)")
    return Drift("temperature", change_c, _seconds(match[2], match[3]) or 0.0)


#: The register of the temperature reaches from -40 to 125 degrees Celsius.
_LARGEST_CHANGE_C: Final = 80

#: The error codes of the meter's manual.
METER_CODES: Final = ("ER00", "ER01", "ER10", "ER11", "ER19", "ER20", "ER30")

#: Patterns of commands, their parsers, and an example of each.
_RULES: Final[tuple[tuple[str, Callable[[re.Match[str]], Command], str], ...]] = (
    (rf"lose ({_NUMBER}) ?%{_LASTS}", _lose, "lose 5% for 20 s"),
    (rf"freeze{_LASTS}", _lasting("freeze"), "freeze for 3 s"),
    (rf"stall{_LASTS}", _lasting("stall"), "stall for 3 s"),
    (rf"vanish{_LASTS}", _lasting("vanish"), "vanish for 5 s"),
    (rf"wrong ids{_LASTS}", _lasting("wrong ids"), "wrong ids for 2 s"),
    (rf"wrong size{_LASTS}", _lasting("wrong size"), "wrong size for 2 s"),
    (rf"second controller{_LASTS}", _lasting("second controller"), "second controller for 4 s"),
    (rf"temperature ([+-]{_NUMBER}) ?c{_WITHIN}", _temperature, "temperature +8 C in 10 min"),
    (rf"light ([+-]{_NUMBER}) ?%{_WITHIN}", _light, "light -5% in 1 h"),
    (rf"meter ({'|'.join(METER_CODES).lower()})", lambda m: MeterReplyFault("code", m[1].upper()), "meter ER10"),
    (r"meter truncate ([0-9]{1,2})", lambda m: MeterReplyFault("truncate", n_bytes=int(m[1])), "meter truncate 7"),
    (
        rf"meter delay {_TIME}",
        lambda m: MeterReplyFault("delay", delay_s=_seconds(m[1], m[2]) or 0.0),
        "meter delay 3 s",
    ),
    (r"meter garble", lambda _: MeterReplyFault("garble"), "meter garble"),
    (r"meter unit (fl|cd/m2)", lambda m: MeterUnit("fL" if m[1] == "fl" else "cd/m2"), "meter unit fL"),
    (r"meter drop", lambda _: MeterRemote(False), "meter drop"),
    (r"meter remote", lambda _: MeterRemote(True), "meter remote"),
    (rf"meter unplug{_LASTS}", lambda m: MeterUnplug(_seconds(m[1], m[2])), "meter unplug for 2 s"),
    (r"recover", lambda _: Recover(), "recover"),
)

#: An example of each command.
EXAMPLES: Final = tuple(example for _, _, example in _RULES)

_AT: Final = re.compile(rf"at {_TIME} (.*)")


def parse_command(text: str) -> Command:
    """Parse one command, for example ``lose 5% for 20 s``; case and blanks are ignored.

    Raises
    ------
    ConfigurationError
        If it is invalid; the message gives an example of the closest command.
    """
    words = " ".join(text.lower().split())
    for pattern, understood, example in _RULES:
        if match := re.fullmatch(pattern, words, re.ASCII):
            try:
                return understood(match)
            except ValueError as error:
                raise ConfigurationError(f"{quoted(text.strip())}: {error}: write for example {example!r}") from None
    raise ConfigurationError(f"{quoted(text.strip())} is not a known fault: write for example {_nearest(words)!r}")


def parse_schedule(text: str, source: str = "schedule") -> tuple[Scheduled, ...]:
    """Parse a schedule: lines such as ``at 1 min vanish for 5 s``, in any order; ``#`` starts a comment.

    Parameters
    ----------
    text : str
        The lines; one without ``at`` runs immediately.
    source : str
        Name of the schedule in messages.

    Returns
    -------
    tuple of Scheduled
        By time.

    Raises
    ------
    ConfigurationError
        If a line is invalid, with its number and a valid example.
    """
    scheduled = []
    for number, line in enumerate(text.splitlines(), start=1):
        words = " ".join(line.partition("#")[0].split())
        if not words:
            continue
        try:
            scheduled.append(_scheduled(words))
        except ConfigurationError as error:
            raise ConfigurationError(f"{source}, line {number}: {error}") from None
    return tuple(sorted(scheduled, key=lambda item: item.at_s))


def _scheduled(words: str) -> Scheduled:
    timed = words.lower().startswith("at ")
    if not timed:
        return Scheduled(0.0, parse_command(words))
    match = _AT.fullmatch(words.lower())
    if match is None:
        raise ConfigurationError(
            f"{quoted(words)} has no time after 'at': write for example 'at 10 s lose 5% for 20 s'"
        )
    return Scheduled(_seconds(match[1], match[2]) or 0.0, parse_command(match[3]))


def _nearest(words: str) -> str:
    """Return the example most similar to a text."""
    lowered = {example.lower(): example for example in EXAMPLES}
    same_word = [example for example in lowered if words and example.split()[0] == words.split()[0]]
    close = get_close_matches(words[:MOST_QUOTED], same_word or list(lowered), n=1, cutoff=0.0)
    return lowered[close[0]]
