"""Faults of the simulated bench, as a schedule words them."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from typing import Final

from ...core.disk.files import MOST_QUOTED, quoted
from ...core.errors import ConfigurationError


@dataclass(frozen=True)
class Command:
    """One fault, or the end of all.

    Parameters
    ----------
    kind : str
        First words of the command: one of `CAMERA_FAULTS`, ``temperature``, ``light``, ``meter`` with what happens to
        it, or ``recover``.
    value : float or str
        Share of lost packets; change in degrees Celsius, or of the current light as a fraction; bytes of a truncated
        reply; error code or unit of the meter.
    duration_s : float or None
        How long it lasts, None until ``recover``; for a drift the time of the change, None for a step; delay of a
        reply.
    at_s : float
        Seconds from the start of its schedule.
    """

    kind: str
    value: float | str = 0.0
    duration_s: float | None = None
    at_s: float = 0.0


#: Faults of a camera: a share of its packets is lost; it neither answers nor sends; it answers, but sends no frame; it
#: has no power, and afterwards the settings after power-on; it repeats frame ids or sends older ones; its frames have
#: half the height; they are exposed twice as long as set, as their chunk data say; packets come again on request
#: (value: index in `RESEND_KINDS`); a switch on the path takes packets up to a size only.
CAMERA_FAULTS: Final = (
    "lose",
    "freeze",
    "stall",
    "vanish",
    "wrong ids",
    "wrong size",
    "wrong exposure",
    "resend",
    "path",
)

#: How lost packets come again on request: as they should, too late, twice, or with the number of another packet.
RESEND_KINDS: Final = ("right", "late", "twice", "wrong")

#: Faults of a camera by kind, with the share of lost packets.
CameraFaults = Mapping[str, float]

#: The error codes of the meter's manual.
METER_CODES: Final = ("ER00", "ER01", "ER10", "ER11", "ER19", "ER20", "ER30")

_SECONDS: Final = {"ms": 0.001, "s": 1.0, "min": 60.0, "h": 3600.0}
_NUMBER: Final = r"[0-9]{1,9}(?:\.[0-9]{1,12})?"
_TIME: Final = rf"(?P<time>{_NUMBER}) ?(?P<time_unit>ms|s|min|h)"
_LASTS: Final = rf"(?: for {_TIME})?"
_WITHIN: Final = rf"(?: in {_TIME})?"
_AT: Final = re.compile(rf"at {_TIME} (?P<command>.*)")


def _between(low: float, high: float, scale: float = 1.0) -> Callable[[str], float]:
    def value(text: str) -> float:
        if not low <= float(text) <= high:
            raise ValueError(f"{float(text):g} is out of range ({low:g} to {high:g})")
        return float(text) * scale

    return value


#: Kind, pattern of what follows it, how the value is read, and an example. The register of the temperature reaches from
#: -40 to 125 degrees Celsius.
_RULES: Final[tuple[tuple[str, str, Callable[[str], float | str], str], ...]] = (
    ("lose", rf" (?P<value>{_NUMBER}) ?%{_LASTS}", _between(0, 100, 0.01), "lose 5% for 20 s"),
    *((kind, _LASTS, float, f"{kind} for 3 s") for kind in ("freeze", "stall")),
    ("vanish", _LASTS, float, "vanish for 5 s"),
    *((kind, _LASTS, float, f"{kind} for 2 s") for kind in ("wrong ids", "wrong size", "wrong exposure")),
    ("resend", rf" (?P<value>{'|'.join(RESEND_KINDS)}){_LASTS}", RESEND_KINDS.index, "resend twice for 20 s"),
    ("path", rf" (?P<value>{_NUMBER}) ?bytes{_LASTS}", _between(576, 9000), "path 1500 bytes"),
    ("temperature", rf" (?P<value>[+-]{_NUMBER}) ?c{_WITHIN}", _between(-80, 80), "temperature +8 C in 10 min"),
    ("light", rf" (?P<value>[+-]{_NUMBER}) ?%{_WITHIN}", _between(-100, float("inf"), 0.01), "light -5% in 1 h"),
    ("meter", rf" (?P<value>{'|'.join(METER_CODES).lower()})", str.upper, "meter ER10"),
    ("meter truncate", " (?P<value>[0-9]{1,2})", int, "meter truncate 7"),
    ("meter delay", f" {_TIME}", float, "meter delay 3 s"),
    ("meter garble", "", float, "meter garble"),
    ("meter unit", " (?P<value>fl|cd/m2)", lambda text: "fL" if text == "fl" else text, "meter unit fL"),
    *((kind, "", float, kind) for kind in ("meter drop", "meter remote")),
    ("meter unplug", _LASTS, float, "meter unplug for 2 s"),
    ("recover", "", float, "recover"),
)

#: An example of each command.
EXAMPLES: Final = tuple(example for *_, example in _RULES)


def parse_command(text: str) -> Command:
    """Parse one command, for example ``lose 5% for 20 s``; case and blanks are ignored.

    Raises
    ------
    ConfigurationError
        If it is invalid; the message gives an example of the closest command.
    """
    words = " ".join(text.lower().split())
    for kind, pattern, value, example in _RULES:
        if match := re.fullmatch(kind + pattern, words, re.ASCII):
            try:
                return Command(kind, value(match.groupdict().get("value") or "0"), _seconds(match))
            except ValueError as error:
                raise ConfigurationError(f"{quoted(text.strip())}: {error}: write for example {example!r}") from None
    raise ConfigurationError(f"{quoted(text.strip())} is not a known fault: write for example {_nearest(words)!r}")


def parse_schedule(text: str, source: str = "schedule") -> tuple[Command, ...]:
    """Parse a schedule: lines such as ``at 1 min vanish for 5 s``, in any order; ``#`` starts a comment.

    Parameters
    ----------
    text : str
        The lines; one without ``at`` runs immediately.
    source : str
        Name of the schedule in messages.

    Returns
    -------
    tuple of Command
        By time.

    Raises
    ------
    ConfigurationError
        If a line is invalid, with its number and a valid example.
    """
    scheduled = []
    for number, line in enumerate(text.splitlines(), start=1):
        words = " ".join(line.partition("#")[0].split())
        try:
            if words:
                scheduled.append(_scheduled(words))
        except ConfigurationError as error:
            raise ConfigurationError(f"{source}, line {number}: {error}") from None
    return tuple(sorted(scheduled, key=lambda command: command.at_s))


def _scheduled(words: str) -> Command:
    if not words.lower().startswith("at "):
        return parse_command(words)
    match = _AT.fullmatch(words.lower())
    if match is None:
        raise ConfigurationError(
            f"{quoted(words)} has no time after 'at': write for example 'at 10 s lose 5% for 20 s'"
        )
    return replace(parse_command(match["command"]), at_s=_seconds(match) or 0.0)


def _seconds(match: re.Match[str]) -> float | None:
    groups = match.groupdict()
    return None if groups.get("time") is None else float(groups["time"]) * _SECONDS[groups["time_unit"]]


def _nearest(words: str) -> str:
    """Return the example most similar to a text."""
    lowered = {example.lower(): example for example in EXAMPLES}
    same_word = [example for example in lowered if words and example.split()[0] == words.split()[0]]
    return lowered[get_close_matches(words[:MOST_QUOTED], same_word or list(lowered), n=1, cutoff=0.0)[0]]
