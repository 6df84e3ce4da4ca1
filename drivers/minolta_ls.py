"""Konica Minolta LS-100 and LS-110 luminance meters over RS-232C.

Protocol: Minolta, *LS-100/LS-110 Communication Manual*, 9222-1842-12 (2000). The meter must be in remote mode:
switch it off and hold F while switching it on; it then shows "C".
"""

from __future__ import annotations

import errno
import logging
import termios
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from math import isfinite
from typing import Any, ClassVar, Final, Self, TypeVar

import serial
from serial.tools import list_ports

from ..errors import InputError
from ..reading import MeterIdentity, Reading
from .meter import MeterError, MeterNotFoundError, MeterProtocolError, MeterReportedError, MeterTimeoutError
from .minolta_ls_protocol import (
    LS100,
    LS110,
    LSDataSheet,
    MeterMode,
    parse_acknowledgement,
    parse_reading,
)

__all__ = [
    "LS100",
    "LS110",
    "LSDataSheet",
    "MeterMode",
    "MinoltaLS100",
    "MinoltaLS110",
    "SerialPort",
    "find_meter_ports",
    "parse_reading",
]

_log = logging.getLogger(__name__)

_CRLF: Final = b"\r\n"
_LONGEST_REPLY: Final = 64  # bytes; the longest of the manual has 17

T = TypeVar("T")


class _MinoltaLS:
    """What the two models share; they differ in their data sheets only."""

    data_sheet: ClassVar[LSDataSheet]

    def __init__(
        self,
        port: str,
        identity: MeterIdentity | None = None,
        *,
        timeout_s: float = 6.0,
        rtscts: bool = False,
    ) -> None:
        if not (isfinite(timeout_s) and timeout_s > 0):
            raise InputError(f"timeout_s is {timeout_s}: give a positive number of seconds")
        self._port = port
        self._identity = identity or MeterIdentity(self.data_sheet.model, serial="unknown")
        self._timeout_s = timeout_s
        self._rtscts = rtscts
        self._serial: Any = None
        self._reply_due_until = 0.0  # on the monotonic clock: until then an unread reply may still come

    @property
    def identity(self) -> MeterIdentity:
        """Model, serial number and calibration date, as given: the meter cannot tell them."""
        return self._identity

    def open(self) -> Self:
        """Open the port for this program alone, and set PRESET, ABS, FAST and CONT.

        The meter cannot identify itself and its modes cannot be read back, so one of each group is written; the
        answers also show that a meter is there. Opening an open meter does nothing.

        Raises
        ------
        MeterNotFoundError
            If the port is absent, in use, not permitted, or not a serial port.
        MeterError
            As `measure`, if the meter does not take the modes.
        """
        if self._serial is None:
            self._serial = _open_port(self._port, self._timeout_s, self._rtscts)
            try:
                for mode in (MeterMode.PRESET, MeterMode.ABS, MeterMode.FAST, MeterMode.CONT):
                    self.set_mode(mode)
            except BaseException:
                self.close()
                raise
        return self

    def close(self) -> None:
        """Close the port; may be called twice."""
        if self._serial is not None:
            with suppress(OSError, termios.error):  # a pulled cable must not keep the port from closing
                # Bytes that RTS/CTS holds back would delay closing and reach the meter when it is switched on.
                self._serial.reset_output_buffer()
            self._serial.close()
            self._serial = None

    def __enter__(self) -> Self:
        return self.open()

    def __exit__(self, *exc: object) -> None:
        self.close()

    def set_mode(self, mode: MeterMode) -> None:
        """Set one mode until the next `open`; the other groups keep theirs.

        Raises
        ------
        MeterError
            As `measure`.
        """
        self._exchange(f"MDS,{mode.value}", parse_acknowledgement)

    def measure(self) -> Reading:
        """Take one reading in the modes that are set.

        A first reading that is too dark can make the meter leave remote mode (seen by users of other
        programs); it is then silent until it is switched on again with F held.

        Raises
        ------
        MeterReportedError
            If the meter answers with an error code.
        MeterTimeoutError
            If it does not answer in time, or not to the end.
        MeterProtocolError
            If the answer is no reading.
        MeterError
            If the meter is not open, or the connection broke.
        """
        return self._reading("MES")

    def read_held(self) -> Reading:
        """Read the value on the display, without measuring.

        Raises
        ------
        MeterError
            As `measure`.
        """
        return self._reading("DSR")

    def _reading(self, command: str) -> Reading:
        def parse(reply: bytes) -> Reading:
            return parse_reading(reply, self.data_sheet, self.identity, datetime.now(UTC))

        reading = self._exchange(command, parse)
        if reading.unit == "fL":
            _log.warning(
                "%s: the meter is set to fL: %g fL is %g cd/m^2; set its unit switch to cd/m^2 if that is not meant",
                self._port,
                reading.value,
                reading.luminance_cd_m2,
            )
        return reading

    def _exchange(self, command: str, parse: Callable[[bytes], T]) -> T:
        """Send one command and return its reply, parsed."""
        if self._serial is None:
            raise MeterError(f"{self._port}: the meter is not open: call open(), or use it in a with statement")
        try:
            self._discard_late_reply()
            # Whatever ends this exchange early, an exception from anywhere included, leaves the reply due.
            self._reply_due_until = time.monotonic() + 2 * self._timeout_s
            _log.debug("%s: sending %s", self._port, command)
            self._serial.write(command.encode("ascii") + _CRLF)
            reply = self._read_line()
        except (OSError, termios.error) as error:
            raise MeterError(
                f"{self._port}: the connection to the meter broke ({error}): check cable and adapter, then open "
                "the meter again"
            ) from error
        self._check_whole(reply, command)
        try:
            result = parse(reply)
        except MeterReportedError:
            self._reply_due_until = 0.0
            raise
        self._reply_due_until = 0.0
        return result

    def _discard_late_reply(self) -> None:
        """Wait for the reply of a failed exchange, if it may still come, and empty both buffers.

        The meter sends one reply to each command it accepts, and accepts none while it measures. So the wait is
        over with the next CR LF, or after one more time-out.
        """
        if time.monotonic() < self._reply_due_until:
            self._read_line()
        self._serial.reset_input_buffer()
        self._serial.reset_output_buffer()

    def _read_line(self) -> bytes:
        """Read to CR LF, or what comes of it within the time-out."""
        line: bytes = self._serial.read_until(_CRLF, _LONGEST_REPLY)
        _log.debug("%s: received %r", self._port, line)
        return line

    def _check_whole(self, reply: bytes, command: str) -> None:
        """Raise if a reply does not end in CR LF, saying how it does not."""
        if reply.endswith(_CRLF):
            return
        if len(reply) >= _LONGEST_REPLY:
            raise MeterProtocolError(
                f"{self._port}: {command} was answered with {reply!r} and no CR LF: check that the meter is on this "
                "port"
            )
        if reply:
            raise MeterTimeoutError(
                f"{self._port}: the answer to {command} broke off after {len(reply)} bytes ({reply!r}) and did not "
                f"go on within {self._timeout_s:g} s: check the cable, then repeat"
            )
        raise MeterTimeoutError(
            f"{self._port}: no answer to {command} within {self._timeout_s:g} s: check that the meter has power and "
            "shows C for remote mode (switch it off, hold F while switching it on), and check the cable"
        )


class MinoltaLS100(_MinoltaLS):
    """Konica Minolta LS-100, acceptance angle 1 degree; a `Meter`.

    Parameters
    ----------
    port : str
        Serial port, for example ``/dev/ttyUSB0``.
    identity : MeterIdentity, optional
        Serial number and calibration date to record; the meter cannot tell them.
    timeout_s : float
        Longest wait for a reply, in seconds. The meter itself gives up after 5 s: wait longer for a real one.
        After a failed exchange the next one first waits as long again for a late reply, and drops it.
    rtscts : bool
        True to heed the RTS and CTS lines of the cable LS-A12.

    Raises
    ------
    InputError
        If `timeout_s` is not a positive number.
    """

    data_sheet = LS100


class MinoltaLS110(_MinoltaLS):
    """Konica Minolta LS-110, acceptance angle 1/3 degree; parameters as of `MinoltaLS100`."""

    data_sheet = LS110


@dataclass(frozen=True, order=True)
class SerialPort:
    """A serial port of this computer.

    Parameters
    ----------
    device : str
        Name to open it by.
    description : str
        What the operating system says about it.
    """

    device: str
    description: str


def find_meter_ports() -> list[SerialPort]:
    """Return the serial ports a meter may be on, by name; only opening one tells whether it is."""
    return sorted(SerialPort(port.device, port.description) for port in list_ports.comports())


def _open_port(port: str, timeout_s: float, rtscts: bool) -> Any:
    """Open a port for 4800 baud, 7 data bits, even parity and 2 stop bits; no other pyserial program may."""
    try:
        return serial.Serial(
            port,
            baudrate=4800,
            bytesize=serial.SEVENBITS,
            parity=serial.PARITY_EVEN,
            stopbits=serial.STOPBITS_TWO,
            timeout=timeout_s,
            write_timeout=timeout_s,
            rtscts=rtscts,
            exclusive=True,
        )
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
        raise MeterNotFoundError(f"{port}: {problem}") from error
