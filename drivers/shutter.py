"""Shutter or lamp: what makes the light of a bench bright or dark without a hand."""

from __future__ import annotations

import termios
from collections.abc import Callable
from contextlib import suppress
from math import isfinite
from typing import Any, Final, Protocol, Self

import serial

from ..core.errors import DeviceError, InputError
from .device import Device


class ShutterError(DeviceError):
    """A shutter or lamp is absent or silent, or does not do what it is told.

    Examples
    --------
    >>> from labcdp.drivers.shutter import ShutterError
    >>> print(ShutterError("the shutter is silent", "switch it on"))
    the shutter is silent: switch it on
    """


class Shutter(Device, Protocol):
    """Interface of a shutter or a lamp: `open` and `close` connect and disconnect it, `set` moves it.

    Examples
    --------
    A lamp whose program is called with a number:

    >>> from labcdp.drivers.shutter import Shutter
    >>> class Lamp(Shutter):
    ...     def open(self):
    ...         return self
    ...     def close(self) -> None: ...
    ...     def set(self, light: float) -> None:
    ...         print(f"lamp at {light:.0%}")
    >>> with Lamp() as lamp:
    ...     lamp.set(0.25)
    lamp at 25%
    """

    def set(self, light: float) -> None:
        """Let a share of the light through, from 0 (dark) to 1, and return when it is so; a shutter knows 0 and 1.

        Raises
        ------
        ShutterError
            If it does not.
        """


def require_light(light: float) -> float:
    """Return a share of light, or raise InputError if it is not from 0 to 1.

    Examples
    --------
    >>> from labcdp.drivers.shutter import require_light
    >>> require_light(1)
    1.0
    """
    if isinstance(light, bool) or not (isfinite(light) and 0 <= light <= 1):
        raise InputError(f"light is {light}: give a share from 0 (dark) to 1 (all)")
    return float(light)


#: Longest line that answers.
_LONGEST_BYTES: Final = 200


class SerialShutter(Shutter):
    """A shutter or lamp whose controller takes ``SET`` and a share of the light on a port, and answers ``OK``.

    Each command ends with CR LF; ``SET 0`` is dark, ``SET 1`` all light, ``SET 0.25`` a quarter. ``OK`` comes when it
    is so; any other line is an error and its reason. A few lines for a microcontroller, or for any program, are enough.

    Parameters
    ----------
    port : str
        Serial port, for example ``/dev/ttyUSB1``, or ``socket://HOST:PORT`` in the network.
    timeout_s : float
        Longest time for a move, in seconds. After a command without an answer the next one first waits as long again
        for a late answer, which is dropped.
    attempts : int
        Largest number of attempts for a command that is not answered or answered with garbage.
    baudrate : int
        Of a serial port.

    Raises
    ------
    InputError
        If a number is out of its range.

    Examples
    --------
    >>> from labcdp.drivers.shutter import SerialShutter, ShutterError
    >>> try:
    ...     SerialShutter("/dev/no-such-port").open()
    ... except ShutterError as error:
    ...     print(error.cause)
    the shutter on /dev/no-such-port cannot be reached
    """

    def __init__(self, port: str, *, timeout_s: float = 5.0, attempts: int = 2, baudrate: int = 9600) -> None:
        if not (isfinite(timeout_s) and timeout_s > 0):
            raise InputError(f"timeout_s is {timeout_s}: give a positive number of seconds")
        if attempts < 1:
            raise InputError(f"attempts is {attempts}: give at least 1")
        self._name = port
        self._timeout_s = timeout_s
        self._attempts = attempts
        self._baudrate = baudrate
        self._port: Any = None
        self._is_answer_due = False

    def open(self) -> Self:
        """Connect; does nothing if it is open.

        Raises
        ------
        ShutterError
            If the port cannot be opened.
        """
        if self._port is None:
            with self._problems("cannot be reached"):
                self._port = serial.serial_for_url(self._name, self._baudrate, timeout=self._timeout_s)
        return self

    def close(self) -> None:
        """Disconnect, and leave the light as it is; may be called twice."""
        port, self._port = self._port, None
        if port is not None:
            with suppress(OSError, termios.error):
                port.close()

    def set(self, light: float) -> None:
        """Let a share of the light through; raises ShutterError and InputError."""
        command = f"SET {require_light(light):g}"
        answer = ""
        for _ in range(self._attempts):
            answer = self._ask(command)
            if answer == "OK":
                return
            if answer.startswith("ERROR"):
                break
        silent = f"did not answer to {command} in {self._timeout_s:g} s"
        problem = f"answered {answer!r} to {command}" if answer else silent
        raise ShutterError(f"the shutter on {self._name} {problem}", "check its power, cable and controller")

    def _ask(self, command: str) -> str:
        if self._port is None:
            raise ShutterError(f"the shutter on {self._name} is not open", "call open(), or use it in a with statement")
        with self._problems("was lost"):
            # A late answer to an earlier command is none to this one: it is waited for as long again.
            if self._is_answer_due:
                self._port.read_until(b"\n", _LONGEST_BYTES)
            self._port.reset_input_buffer()
            self._is_answer_due = True
            self._port.write(f"{command}\r\n".encode("ascii"))
            line: bytes = self._port.read_until(b"\n", _LONGEST_BYTES)
        if not line.endswith(b"\n"):
            return ""
        self._is_answer_due = False
        return line.decode("ascii", "replace").strip()

    def _problems(self, what: str) -> _Explained:
        return _Explained(f"the shutter on {self._name} {what}", self.close)


class _Explained:
    """Turns errors of a port into one that names the shutter, and disconnects it."""

    def __init__(self, cause: str, clean_up: Callable[[], None]) -> None:
        self._cause = cause
        self._clean_up = clean_up

    def __enter__(self) -> None:
        """Do nothing."""

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        """Raise ShutterError for an error of the port."""
        if isinstance(error, OSError | termios.error | ValueError):
            self._clean_up()
            raise ShutterError(self._cause, f"check port, power and cable ({error})") from error
