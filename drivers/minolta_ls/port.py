"""Ports a meter may be on: a serial port by its name, or anything that behaves like one."""

from __future__ import annotations

from os.path import realpath
from typing import Any, Final, Protocol

import serial

from ...core.clock import Clock, SystemClock

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
