r"""Wire transcript: every byte between this computer and a meter, as a file of JSON lines.

The first line is the header; each further line is what was sent or received, ``t_s`` seconds after the start::

    {"format": 1, "meter": "LS-110", "port": "/dev/ttyUSB0", "baudrate": 4800, "bytesize": 7, "parity": "E", ...}
    {"t_s": 0.001204, "sent": "MDS,00\r\n"}
    {"t_s": 0.041377, "received": "OK00\r\n"}

Bytes are text in Latin-1, with JSON's escapes. The time of what was received is that of its first byte.
"""

from __future__ import annotations

import json
import logging
from dataclasses import asdict, dataclass
from datetime import datetime
from itertools import pairwise
from math import isfinite
from os import PathLike
from pathlib import Path
from typing import Any, Final, Literal

from ..errors import InputError

_log = logging.getLogger(__name__)

_FORMAT: Final = 1


@dataclass(frozen=True)
class PortSettings:
    """Settings of a serial port.

    Parameters
    ----------
    baudrate : int
        Bits per second.
    bytesize : int
        Data bits.
    parity : str
        ``E`` for even.
    stopbits : int
        Stop bits.
    rtscts : bool
        Whether the lines RTS and CTS are heeded.
    """

    baudrate: int
    bytesize: int
    parity: str
    stopbits: int
    rtscts: bool


@dataclass(frozen=True)
class TranscriptHeader:
    """What a transcript was recorded from.

    Parameters
    ----------
    meter : str
        Model of the meter.
    port : str
        Name of the port.
    settings : PortSettings
        Its settings.
    timeout_s : float
        How long the driver waited for a reply, in seconds.
    started : datetime
        Host time of ``t_s = 0``, with time zone.
    labcdp : str
        Version of labcdp.
    """

    meter: str
    port: str
    settings: PortSettings
    timeout_s: float
    started: datetime
    labcdp: str

    def to_dict(self) -> dict[str, Any]:
        """Return the first line's object."""
        return {
            "format": _FORMAT,
            "meter": self.meter,
            "port": self.port,
            **asdict(self.settings),
            "timeout_s": self.timeout_s,
            "started": self.started.isoformat(),
            "labcdp": self.labcdp,
        }


@dataclass(frozen=True)
class WireEntry:
    """What went over the wire in one direction.

    Parameters
    ----------
    t_s : float
        Seconds after the start of the transcript.
    direction : {'sent', 'received'}
        As the computer sees it.
    data : bytes
        The bytes.
    """

    t_s: float
    direction: Literal["sent", "received"]
    data: bytes

    def to_dict(self) -> dict[str, Any]:
        """Return the line's object."""
        return {"t_s": round(self.t_s, 6), self.direction: self.data.decode("latin-1")}


@dataclass(frozen=True)
class Exchange:
    """A command, and what came before the next one.

    Parameters
    ----------
    command : WireEntry
        What was sent.
    received : tuple of WireEntry
        What came then, in pieces as the driver read them; empty if the meter was silent.
    """

    command: WireEntry
    received: tuple[WireEntry, ...]


@dataclass(frozen=True)
class Transcript:
    """A transcript as read from its file.

    Parameters
    ----------
    header : TranscriptHeader
        What it was recorded from.
    entries : tuple of WireEntry
        What went over the wire, in order.
    """

    header: TranscriptHeader
    entries: tuple[WireEntry, ...]

    @property
    def exchanges(self) -> tuple[Exchange, ...]:
        """Commands with their replies; what came before the first command belongs to none."""
        starts = [index for index, entry in enumerate(self.entries) if entry.direction == "sent"]
        return tuple(
            Exchange(self.entries[start], self.entries[start + 1 : end])
            for start, end in pairwise([*starts, len(self.entries)])
        )

    def to_text(self) -> str:
        """Return the lines of a file that `parse_transcript` reads as this transcript."""
        lines = [self.header.to_dict(), *(entry.to_dict() for entry in self.entries)]
        return "".join(f"{json.dumps(line)}\n" for line in lines)


def read_transcript(path: str | PathLike[str]) -> Transcript:
    """Read a transcript; a last line that was not written to its end is left out.

    Raises
    ------
    InputError
        If the file cannot be read, or is no transcript; the message names the line.
    """
    try:
        text = Path(path).read_text(encoding="ascii")
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): give a wire transcript") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is no wire transcript: byte {error.start} is not ASCII") from error
    return parse_transcript(text, str(path))


def parse_transcript(text: str, name: str = "transcript") -> Transcript:
    """Read a transcript's text; a last line that was not written to its end is left out.

    Parameters
    ----------
    text : str
        The lines.
    name : str
        What messages call it.

    Raises
    ------
    InputError
        If it is no transcript; the message names the line.
    """
    *lines, torn = text.split("\n")
    if torn:
        _log.warning("%s: line %d was not written to its end and is left out", name, len(lines) + 1)
    if not lines:
        raise InputError(f"{name} has no whole line: give a wire transcript")
    header = _located(name, 1, lines[0], _header)
    return Transcript(
        header, tuple(_located(name, number, line, _entry) for number, line in enumerate(lines[1:], start=2))
    )


def _located(name: str, number: int, line: str, parse: Any) -> Any:
    try:
        values = json.loads(line)
        if not isinstance(values, dict):
            raise InputError("it is no JSON object")
        return parse(values)
    except InputError as error:
        problem = str(error)
    except (ValueError, OverflowError, RecursionError):
        problem = "it cannot be read as JSON"
    raise InputError(f"{name}, line {number}: {problem}: {_shortened(line)}")


def _shortened(line: str) -> str:
    return line if len(line) <= 80 else f"{line[:77]}..."


def _header(values: dict[str, Any]) -> TranscriptHeader:
    if "format" not in values:
        raise InputError("it is not the header of a wire transcript")
    if values["format"] != _FORMAT:
        raise InputError(f"format {values['format']!r} is not known, this version reads format {_FORMAT}")
    settings = PortSettings(
        _of(values, "baudrate", int),
        _of(values, "bytesize", int),
        _of(values, "parity", str),
        _of(values, "stopbits", int),
        _of(values, "rtscts", bool),
    )
    timeout_s, started = float(_of(values, "timeout_s", float)), _of(values, "started", str)
    try:
        moment = datetime.fromisoformat(started)
    except ValueError:
        raise InputError(f"started is {started!r}, not an ISO time") from None
    if moment.tzinfo is None:
        raise InputError(f"started is {started!r}, without a time zone")
    if not (isfinite(timeout_s) and timeout_s > 0):
        raise InputError(f"timeout_s is {timeout_s}, not a positive number of seconds")
    names = (_of(values, "meter", str), _of(values, "port", str))
    return TranscriptHeader(*names, settings, timeout_s, moment, _of(values, "labcdp", str))


def _of(values: dict[str, Any], key: str, kind: type) -> Any:
    if key not in values:
        raise InputError(f"{key} is missing")
    value = values[key]
    kinds = (int, float) if kind is float else (kind,)
    if type(value) not in kinds:
        raise InputError(f"{key} is {value!r}, not of type {kind.__name__}")
    return value


def _entry(values: dict[str, Any]) -> WireEntry:
    directions: tuple[Literal["sent", "received"], ...] = ("sent", "received")
    stated = [direction for direction in directions if direction in values]
    if len(stated) != 1 or set(values) != {"t_s", *stated}:
        raise InputError("an entry has t_s and either sent or received")
    t_s, text = float(_of(values, "t_s", float)), _of(values, stated[0], str)
    if not (isfinite(t_s) and t_s >= 0):
        raise InputError(f"t_s is {t_s}, not a number of seconds of at least 0")
    try:
        return WireEntry(t_s, stated[0], text.encode("latin-1"))
    except UnicodeEncodeError:
        raise InputError(f"{stated[0]} has characters that are no bytes") from None
