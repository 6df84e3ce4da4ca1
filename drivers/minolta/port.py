"""Ports a meter may be on, and the transcript of what is exchanged on them."""

from __future__ import annotations

import errno
import json
import logging
import termios
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
from ..meter import MeterNotFoundError

_log = logging.getLogger(__name__)

#: Settings of the manuals of LS-100, LS-110 and CS-100A: 4800 baud, 7 data bits, even parity, 2 stop bits.
SETTINGS: Final[Mapping[str, Any]] = {
    "baudrate": 4800,
    "bytesize": serial.SEVENBITS,
    "parity": serial.PARITY_EVEN,
    "stopbits": serial.STOPBITS_TWO,
}

#: Longest single read in seconds; the driver's time-outs are checked in between.
_SLICE_S: Final = 0.05

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
    """A serial port of this computer, or a port of the network.

    Parameters
    ----------
    name : str
        For example ``/dev/ttyUSB0``; ``socket://192.168.0.7:7000`` for a program that listens in the network.
    rtscts : bool
        Whether to use the lines RTS and CTS of the cable.
    settings : mapping
        Baud rate, data bits, parity and stop bits, as `serial.Serial` takes them; of no effect in the network.
    """

    def __init__(self, name: str, rtscts: bool = False, settings: Mapping[str, Any] = SETTINGS) -> None:
        self.name = name
        self.rtscts = rtscts
        self.settings = settings
        self.clock = SystemClock()

    @property
    def may_be_simulated(self) -> bool:
        """Whether it is a pseudo-terminal."""
        return not self._is_in_network and realpath(self.name).startswith(_PSEUDO_TERMINALS)

    @property
    def _is_in_network(self) -> bool:
        return "://" in self.name

    def connect(self, slice_s: float, write_timeout_s: float) -> serial.Serial:
        """Open it, exclusively among pyserial programs; a `read` takes at most `slice_s`."""
        if self._is_in_network:
            return _connect_network(self.name, slice_s, write_timeout_s)
        settings = self.settings
        if self.may_be_simulated:
            # A pseudo-terminal has no parity, and as that of socat refuses it from the second program on.
            settings = {"baudrate": self.settings["baudrate"]}
        return serial.Serial(
            self.name, **settings, rtscts=self.rtscts, timeout=slice_s, write_timeout=write_timeout_s, exclusive=True
        )


def _connect_network(name: str, slice_s: float, write_timeout_s: float) -> Any:
    """Open a port of the network; raises OSError."""
    if not name.startswith("socket://"):
        raise OSError(f"{name.partition('://')[0]}:// is not known, give socket://HOST:PORT")
    try:
        return serial.serial_for_url(name, timeout=slice_s, write_timeout=write_timeout_s)
    except ValueError as error:
        raise OSError(f"{error}; give socket://HOST:PORT") from error


def connect(port: Port, timeout_s: float) -> Any:
    """Open a port; raises MeterNotFoundError with the remedy if it is absent, in use, not permitted, or no port."""
    try:
        return port.connect(min(timeout_s, _SLICE_S), timeout_s)
    except (OSError, termios.error) as error:
        match getattr(error, "errno", None):
            case errno.ENOENT | errno.ENXIO | errno.ENODEV:
                problem = "there is no such serial port: plug the adapter in, or choose another port"
            case errno.EACCES | errno.EPERM:
                problem = (
                    "no permission to open it: join the group that owns it (on Debian 'sudo adduser $USER dialout') "
                    "and log in again"
                )
            case errno.EBUSY | errno.EAGAIN:
                problem = "another program uses it: end that program"
            case _ if "://" in port.name:
                problem = (
                    f"nothing can be reached there ({error}): start the program of the meter, and check the address"
                )
            case _:
                problem = f"it cannot be used as a serial port ({error}): choose another port"
        raise MeterNotFoundError(f"{port.name}", f"{problem}") from error


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

    def open(self) -> None:
        """Create the file; one this writer created before is continued.

        Raises
        ------
        InputError
            If the file exists already, or cannot be written.
        """
        if self._file is not None:
            return
        is_new = self._started_s is None
        try:
            self._file = open(self._path, "x" if is_new else "a", encoding="ascii")  # noqa: SIM115
        except OSError as error:
            exists = isinstance(error, FileExistsError)
            problem = "exists already" if exists else f"cannot be written ({error.strerror})"
            raise InputError(f"{self._path} {problem}: give the transcript another name") from error
        if is_new:
            self._started_s = self._clock.monotonic_s()
            about = {**self._about, "started": self._clock.now().isoformat(), "labcdp": version("labcdp")}
            self._write({"format": 1, **about})

    def record(self, direction: Literal["sent", "received"], data: bytes, at_s: float) -> None:
        """Write one entry; `at_s` is the time on the monotonic clock."""
        self._write({"t_s": round(at_s - (self._started_s or 0.0), 6), direction: data.decode("latin-1")})

    def close(self) -> None:
        """Close the file; may be called twice."""
        file, self._file = self._file, None
        if file is not None:
            with suppress(OSError):  # the rest of its buffer may fail again
                file.close()

    def _write(self, values: dict[str, Any]) -> None:
        if self._file is None:
            return
        try:
            self._file.write(json.dumps(values) + "\n")
            self._file.flush()
        except OSError as error:
            # Readings take precedence over their transcript.
            self.close()
            _log.warning("%s cannot be written (%s): the transcript ends here", self._path, error.strerror)
