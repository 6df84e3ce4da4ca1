"""A simulated shutter or lamp: of the simulated bench, in this process or on a pseudo-terminal."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, Self

from ..minolta.line import CRLF
from ..shutter import Shutter, ShutterError, require_light


class SimulatedShutter(Shutter):
    """A shutter that calls a function with the share of the light, and answers on a port like a controller.

    `labcdp.drivers.simulated.pty.PtyMeter` serves it on a pseudo-terminal.

    Parameters
    ----------
    move : callable
        Takes the share of the light, from 0 to 1.

    Examples
    --------
    >>> from labcdp.drivers.simulated.shutter import SimulatedShutter
    >>> moves = []
    >>> with SimulatedShutter(moves.append) as shutter:
    ...     shutter.set(0)
    >>> moves
    [0.0]
    """

    def __init__(self, move: Callable[[float], None]) -> None:
        self._move = move
        #: Whether it answers; a jammed one says so.
        self.remote = True
        self.jammed = False
        #: Of no meaning here; a meter on a port has a unit.
        self.unit: Literal["cd/m2", "fL"] = "cd/m2"

    def open(self) -> Self:
        """Do nothing."""
        return self

    def close(self) -> None:
        """Do nothing."""

    def set(self, light: float) -> None:
        """Let a share of the light through; raises ShutterError if it is jammed."""
        if self.jammed:
            raise ShutterError("the simulated shutter is jammed", "let it go")
        self._move(require_light(light))

    def answer(self, command: bytes) -> bytes:
        """Execute one command with its CR LF, and return the answer with CR LF; nothing if it is silent."""
        if not self.remote:
            return b""
        word, _, number = command.removesuffix(CRLF).decode("ascii", "replace").partition(" ")
        try:
            if word != "SET" or not command.endswith(CRLF):
                raise ValueError("unknown command")
            self.set(float(number))
        except Exception as error:
            return f"ERROR {error}".encode("ascii", "replace") + CRLF
        return b"OK" + CRLF
