"""Ports a meter may be on, and the transcript of what is exchanged on them."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from contextlib import suppress
from importlib.metadata import version
from os import PathLike
from os.path import realpath
from pathlib import Path
from typing import Any, Final, Literal, Protocol, TextIO

import serial

from ...core.clock import Clock, SystemClock
from ...core.errors import InputError

#: The manual's settings: 4800 baud, 7 data bits, even parity, 2 stop bits.
SETTINGS: Final = {
    "baudrate": 4800,
    "bytesize": serial.SEVENBITS,
    "parity": serial.PARITY_EVEN,
    "stopbits": serial.STOPBITS_TWO,
}

#: Where a simulated meter may be, and also a real one behind socat; no other meter is sent the unknown command.
_PSEUDO_TERMINALS: Final = "/dev/pts/"


class Port(Protocol):
    """A place where a meter may be connected."""

    @property
    def name(self) -> str:
        """Name in messages."""

    @property
    def clock(self) -> Clock:
        """Clock of everything that happens on it."""

    @property
    def may_be_simulated(self) -> bool:
        """Whether a simulated meter may be on it."""

    @property
    def rtscts(self) -> bool:
        """Whether it uses hardware handshake."""

    def connect(self, slice_s: float, write_timeout_s: float) -> Any:
        """Open it; returns an object with ``read``, ``write``, ``in_waiting``, ``reset_output_buffer`` and ``close``.

        Raises
        ------
        OSError
            If it cannot be opened; its methods, if the connection broke.
        """


class NamedPort:
    """A serial port of this computer.

    Parameters
    ----------
    name : str
        For example ``/dev/ttyUSB0``.
    rtscts : bool
        Whether to use the lines RTS and CTS of the cable.
    """

    def __init__(self, name: str, rtscts: bool = False) -> None:
        self.name = name
        self.rtscts = rtscts
        self.clock = SystemClock()

    @property
    def may_be_simulated(self) -> bool:
        """Whether it is a pseudo-terminal."""
        return realpath(self.name).startswith(_PSEUDO_TERMINALS)

    def connect(self, slice_s: float, write_timeout_s: float) -> serial.Serial:
        """Open it, exclusively among pyserial programs; a `read` takes at most `slice_s`."""
        return serial.Serial(
            self.name, **SETTINGS, rtscts=self.rtscts, timeout=slice_s, write_timeout=write_timeout_s, exclusive=True
        )


_log = logging.getLogger(__name__)

_FORMAT: Final = 1


class TranscriptWriter:
    r"""Writes a transcript: every byte between this computer and a meter, as JSON lines, each flushed immediately.

    The first line is the header; each further line is what was sent or received, ``t_s`` seconds after the start::

        {"format": 1, "meter": "LS-110", "port": "/dev/ttyUSB0", "baudrate": 4800, "bytesize": 7, "parity": "E", ...}
        {"t_s": 0.001204, "sent": "MDS,00\r\n"}
        {"t_s": 0.041377, "received": "OK00\r\n"}

    Bytes are text in Latin-1, with JSON's escapes. The time of what was received is that of its first byte.

    Parameters
    ----------
    path : path
        File to create.
    about : mapping
        Meter and port, for the header.
    clock : Clock
        Clock of the port.
    """

    def __init__(self, path: str | PathLike[str], about: Mapping[str, Any], clock: Clock) -> None:
        self._path = Path(path)
        self._about = about
        self._clock = clock
        self._started_s: float | None = None
        self._file: TextIO | None = None

    def start(self) -> None:
        """Create the file; one this writer created before is continued.

        Raises
        ------
        InputError
            If the file exists already, or cannot be created.
        """
        is_new = self._started_s is None
        try:
            self._file = open(self._path, "x" if is_new else "a", encoding="ascii")  # noqa: SIM115
        except OSError as error:
            if not is_new:
                self._give_up(error)
            elif isinstance(error, FileExistsError):
                raise InputError(f"{self._path} exists already: give the transcript another name") from None
            else:
                raise InputError(
                    f"{self._path} cannot be written ({error.strerror}): give the transcript another name"
                ) from error
        if is_new:
            self._started_s = self._clock.monotonic_s()
            started, about = self._clock.now().isoformat(), dict(self._about)
            self._write({"format": _FORMAT, **about, "started": started, "labcdp": version("labcdp")})

    def record(self, direction: Literal["sent", "received"], data: bytes, at_s: float) -> None:
        """Write one entry; `at_s` is the time on the monotonic clock."""
        if self._started_s is not None:
            self._write({"t_s": round(at_s - self._started_s, 6), direction: data.decode("latin-1")})

    def close(self) -> None:
        """Close the file; may be called twice."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def _write(self, values: dict[str, Any]) -> None:
        if self._file is None:
            return
        try:
            self._file.write(json.dumps(values) + "\n")
            self._file.flush()
        except OSError as error:
            file, self._file = self._file, None
            with suppress(OSError):  # the rest of its buffer would fail again
                file.close()
            self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        # Readings take precedence over their transcript.
        _log.warning("%s cannot be written (%s): the transcript ends here", self._path, error.strerror)
