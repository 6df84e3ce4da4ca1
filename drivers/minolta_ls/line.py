"""Serial line of a Konica Minolta LS-100 or LS-110: commands and replies with timeouts.

Protocol: Minolta, *LS-100/LS-110 Communication Manual*, 9222-1842-12 (2000).
"""

from __future__ import annotations

import errno
import json
import logging
import termios
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from importlib.metadata import version
from os import PathLike
from os.path import realpath
from pathlib import Path
from typing import Any, Final, Literal, Protocol, TextIO, TypeVar

import serial

from ...core.clock import Clock, SystemClock
from ...core.errors import InputError
from ..device import on_error
from ..meter import (
    MeterError,
    MeterLostError,
    MeterNotFoundError,
    MeterProtocolError,
    MeterReportedError,
    MeterTimeoutError,
)

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


_log = logging.getLogger(__name__)

_CRLF: Final = b"\r\n"
_ACKNOWLEDGED: Final = b"OK00\r\n"
#: In bytes; the longest reply of the manual has 17.
LONGEST_REPLY: Final = 64
#: Longest single read in seconds; the driver's time-outs are checked in between.
_SLICE_S: Final = 0.05

T = TypeVar("T")


class MeterLine:
    """A port, and its pending replies.

    The meter sends one reply to each command it accepts, and accepts none while it measures. The reply of a failed
    exchange may arrive late; it is awaited and dropped before the next command, unless the same command is repeated. If
    it has not come by then, a mode is set first: replies keep their order, so that none of before follows its answer.

    Parameters
    ----------
    port : Port
        Where the meter is.
    timeout_s : float
        Longest wait for a reply, in seconds.
    transcript : TranscriptWriter or None
        Receives every byte.
    """

    def __init__(self, port: Port, timeout_s: float, transcript: TranscriptWriter | None) -> None:
        self.port = port.name
        self.clock = port.clock
        self._place = port
        self.timeout_s = timeout_s
        self._transcript = transcript
        self._serial: Any = None
        self._one_at_a_time = threading.Lock()
        self._n_due = 0
        self._due_until_s = 0.0  # on the monotonic clock
        # Whether a reply to another command than the present one is due.
        self._other_due = False

    @property
    def is_open(self) -> bool:
        """Whether the port is open."""
        return self._serial is not None

    def open(self) -> None:
        """Open the port exclusively.

        Raises
        ------
        MeterNotFoundError
            If the port is absent, in use, not permitted, or not a serial port.
        InputError
            If the transcript cannot be created.
        """
        self._serial = self._connected()
        if self._transcript is not None:
            with on_error(self.close):
                self._transcript.start()

    def close(self) -> None:
        """Close the port; may be called twice."""
        port, self._serial = self._serial, None
        if port is not None:
            with suppress(OSError, termios.error):  # close the port even if the cable was pulled
                # Bytes held back by RTS/CTS would delay closing and reach the meter at its next start.
                port.reset_output_buffer()
            port.close()
        if self._transcript is not None:
            self._transcript.close()

    def exchange(
        self, command: str, parse: Callable[[bytes], T], until_s: float, mode: str, *, again: bool = False
    ) -> T:
        """Send one command and return its reply, parsed.

        Parameters
        ----------
        command : str
            Without CR LF.
        parse : callable
            Parses the reply, including CR LF.
        until_s : float
            Latest time on the monotonic clock at which to give up.
        mode : str
            Command that sets a mode in force, without CR LF; sent if a late reply may still come.
        again : bool
            True if the same command was sent just before: its late reply is then accepted.

        Raises
        ------
        MeterError
            If the port is not open, or as `MinoltaLS110.measure`. If the connection broke, the port is closed.
        """
        with self._one_at_a_time:
            self._other_due = self._n_due > 0 and (self._other_due or not again)
            return self._exchange(command, parse, until_s, mode)

    def _exchange(self, command: str, parse: Callable[[bytes], T], until_s: float, mode: str) -> T:
        if self._serial is None:
            raise MeterError(f"{self.port}: the meter is not open: call open(), or use it in a with statement")
        try:
            if self._other_due:
                self._settle(until_s, mode)
            self._drain()
            allowed_s = min(self.timeout_s, until_s - self.clock.monotonic_s())
            if allowed_s <= 0:
                raise MeterTimeoutError(
                    f"{self.port}: earlier failures left no time for {command}: check the cable, then repeat"
                )
            give_up_s = self.clock.monotonic_s() + allowed_s
            # If the exchange ends early by any exception, its reply stays pending.
            self._n_due += 1
            self._due_until_s = self.clock.monotonic_s() + 2 * self.timeout_s
            self._send(command)
            reply = self._read_line(give_up_s)
        except serial.SerialTimeoutException as error:
            self._n_due -= 1
            raise MeterTimeoutError(
                f"{self.port}: the meter does not take {command}, it holds its RTS line low: check that it has power "
                "and the cable carries RTS and CTS, or open it without rtscts"
            ) from error
        except (OSError, termios.error) as error:
            self.close()
            raise MeterLostError(
                f"{self.port}: the connection to the meter broke ({error}): check cable and adapter, then open "
                "the meter again"
            ) from error
        except (TypeError, AttributeError) as error:
            if self._serial is not None:
                raise
            raise MeterError(f"{self.port}: the meter was closed while it was asked: open it again") from error
        self._check_whole(reply, command, allowed_s)
        try:
            result = parse(reply)
        except MeterReportedError:
            self._n_due -= 1
            raise
        self._n_due -= 1
        return result

    def _settle(self, until_s: float, mode: str) -> None:
        """Drop the replies of earlier commands: those that come within a time-out, and all before that to `mode`."""
        wait_s = min(until_s, self._due_until_s, self.clock.monotonic_s() + self.timeout_s)
        while self._n_due > 0 and self.clock.monotonic_s() < wait_s:
            self._n_due -= self._read_line(wait_s).endswith(_CRLF)
        self._drain()
        if self._n_due > 0:
            give_up_s = min(until_s, self.clock.monotonic_s() + self.timeout_s)
            self._n_due += 1
            self._due_until_s = self.clock.monotonic_s() + 2 * self.timeout_s
            self._send(mode)
            while (reply := self._read_line(give_up_s)) != _ACKNOWLEDGED:
                self._check_whole(reply, mode, self.timeout_s)
        self._n_due, self._other_due = 0, False

    def _drain(self) -> None:
        """Clear both buffers."""
        waiting = self._serial.in_waiting
        if waiting:
            data: bytes = self._serial.read(waiting)
            self._record_received(data, self.clock.monotonic_s())
            self._n_due = max(0, self._n_due - data.count(_CRLF))
        self._serial.reset_output_buffer()

    def _send(self, command: str) -> None:
        data = command.encode("ascii") + _CRLF
        _log.debug("%s: sending %s", self.port, command)
        sent_s = self.clock.monotonic_s()
        self._serial.write(data)
        if self._transcript is not None:
            self._transcript.record("sent", data, sent_s)

    def _read_line(self, until_s: float) -> bytes:
        """Read up to CR LF, or until the time-out."""
        line = bytearray()
        first_s = 0.0
        try:
            while True:
                byte: bytes = self._serial.read(1)
                if byte and not line:
                    first_s = self.clock.monotonic_s()
                line += byte
                if line.endswith(_CRLF) or len(line) >= LONGEST_REPLY or self.clock.monotonic_s() >= until_s:
                    return bytes(line)
        finally:
            if line:
                self._record_received(bytes(line), first_s)

    def _record_received(self, data: bytes, at_s: float) -> None:
        _log.debug("%s: received %r", self.port, data)
        if self._transcript is not None:
            self._transcript.record("received", data, at_s)

    def _check_whole(self, reply: bytes, command: str, allowed_s: float) -> None:
        """Raise a specific error if a reply does not end with CR LF."""
        if reply.endswith(_CRLF):
            return
        if len(reply) >= LONGEST_REPLY:
            raise MeterProtocolError(
                f"{self.port}: {command} was answered with {reply!r} and no CR LF: check that the meter is on this port"
            )
        if reply:
            raise MeterTimeoutError(
                f"{self.port}: the answer to {command} stopped after {len(reply)} bytes ({reply!r}) and did not "
                f"continue within {allowed_s:.3g} s: check the cable, then repeat"
            )
        raise MeterTimeoutError(
            f"{self.port}: no answer to {command} within {allowed_s:.3g} s: check that the meter has power and "
            "shows C for remote mode (switch it off, hold F while switching it on), and check the cable"
        )

    def _connected(self) -> Any:
        try:
            return self._place.connect(min(self.timeout_s, _SLICE_S), self.timeout_s)
        except (OSError, termios.error) as error:
            match getattr(error, "errno", None):
                case errno.ENOENT | errno.ENXIO | errno.ENODEV:
                    problem = "there is no such serial port: plug the adapter in, or choose another port"
                case errno.EACCES | errno.EPERM:
                    problem = (
                        "no permission to open it: join the group that owns it (on Debian 'sudo adduser $USER "
                        "dialout') and log in again"
                    )
                case errno.EBUSY | errno.EAGAIN:
                    problem = "another program uses it: end that program"
                case _:
                    problem = f"it cannot be used as a serial port ({error}): choose another port"
            raise MeterNotFoundError(f"{self.port}: {problem}") from error
