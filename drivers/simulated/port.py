"""A port in this process to a simulated meter, and the faults of its replies."""

from __future__ import annotations

import errno
from collections import deque
from dataclasses import dataclass
from typing import Final, Literal, Protocol, Self

import numpy as np

from ...core.clock import Clock
from ...core.errors import InputError
from ..minolta.line import CRLF

#: Commands that take the response time.
_MEASUREMENTS: Final = (b"MES", b"MEASURE")
#: Longest garbage; a reading has 17 bytes.
_LONGEST_GARBAGE: Final = 24


class MeterEngine(Protocol):
    """Maps commands to replies, for example `SimulatedLS`."""

    remote: bool
    unit: Literal["cd/m2", "fL"]

    def answer(self, command: bytes) -> bytes:
        """Return the reply to a command, both with CR LF, or nothing; a command without CR LF is incomplete."""


@dataclass(frozen=True)
class Fault:
    r"""Fault of one reply; none without arguments.

    A meter that states fL is no fault of one reply: set `SimulatedLS.unit`.

    Parameters
    ----------
    delay_s : float
        Delay of the reply in seconds; until then the meter accepts no command.
    reply : bytes or None
        Sent instead of the meter's own: ``b""`` for silence, ``b"ER30\r\n"`` for an error code, or any garbage.
    n_bytes : int or None
        Number of bytes after which the reply is truncated.

    Examples
    --------
    Silent once, then an answer 2 s late, a good one, one cut short, and an empty battery:

    >>> faults = [Fault(reply=b""), Fault(delay_s=2), Fault(), Fault(n_bytes=7), Fault(reply=b"ER30\r\n")]
    """

    delay_s: float = 0.0
    reply: bytes | None = None
    n_bytes: int | None = None

    @classmethod
    def garbled(cls, seed: int) -> Fault:
        """Return a reply of random bytes of that seed, every other time with a CR LF."""
        rng = np.random.default_rng(seed)
        garbage = rng.bytes(int(rng.integers(1, _LONGEST_GARBAGE)))
        return cls(reply=garbage + (CRLF if rng.integers(2) else b""))


class FaultyMeter:
    """A meter whose replies take time and have the faults that are injected; base of what puts it on a port.

    Parameters
    ----------
    engine : MeterEngine
        The meter.
    response_time_s : float
        Time a MES takes.

    Raises
    ------
    InputError
        If the time is negative.
    """

    def __init__(self, engine: MeterEngine, response_time_s: float) -> None:
        if not response_time_s >= 0:
            raise InputError(f"response_time_s is {response_time_s}: give a number of seconds of at least 0")
        self.engine = engine
        self._response_time_s = response_time_s
        self._faults: deque[Fault] = deque()

    def inject(self, *faults: Fault) -> None:
        """Queue faults, one for each of the next replies, of whatever command."""
        self._faults.extend(faults)

    def recover(self) -> None:
        """Forget the faults that are queued, and enter remote mode."""
        self._faults.clear()
        self.engine.remote = True

    def unplug(self) -> None:
        """Pull the cable."""
        raise NotImplementedError

    def plug_in(self) -> None:
        """Reconnect the cable."""
        raise NotImplementedError

    def reply(self, command: bytes) -> tuple[bytes, float] | None:
        """Return the reply to a command and the time it takes, in which no other is accepted; None for silence."""
        answer = self.engine.answer(command)
        if not answer:
            return None
        fault = self._faults.popleft() if self._faults else Fault()
        busy_s = fault.delay_s + (self._response_time_s if command.startswith(_MEASUREMENTS) else 0.0)
        return (answer if fault.reply is None else fault.reply)[: fault.n_bytes], busy_s


class InProcessPort(FaultyMeter):
    """A meter for `SerialMeter` without a serial port; see `labcdp.drivers.minolta.port.Port`.

    Parameters
    ----------
    engine : MeterEngine
        The meter.
    clock : Clock
        Clock of its replies.
    response_time_s : float
        Time a MES takes.
    """

    name = "the simulated meter"
    may_be_simulated = True

    def __init__(self, engine: MeterEngine, clock: Clock, response_time_s: float = 0.8) -> None:
        super().__init__(engine, response_time_s)
        self.clock = clock
        self.rtscts = False
        self._plugged = True
        self._slice_s = 0.0
        self._busy_until_s = clock.monotonic_s()
        # What is on its way, with the time of its arrival.
        self._coming: deque[tuple[float, int]] = deque()

    def unplug(self) -> None:
        """Pull the cable; what was on its way is lost."""
        self._plugged = False
        self._coming.clear()

    def plug_in(self) -> None:
        """Reconnect the cable."""
        self._plugged = True

    def connect(self, slice_s: float, write_timeout_s: float) -> Self:
        """Open it; a `read` takes at most `slice_s`."""
        self._require_cable(errno.ENOENT)
        self._slice_s = slice_s
        return self

    def close(self) -> None:
        """Close it; the meter keeps running."""

    def reset_output_buffer(self) -> None:
        """Do nothing: a command is taken at once."""
        self._require_cable()

    def write(self, data: bytes) -> None:
        """Take commands, each with its CR LF, unless the meter is busy."""
        self._require_cable()
        for command in data.split(CRLF)[:-1]:
            now_s = self.clock.monotonic_s()
            if now_s >= self._busy_until_s and (reply := self.reply(command + CRLF)) is not None:
                text, busy_s = reply
                self._busy_until_s = now_s + busy_s
                self._coming.extend((self._busy_until_s, byte) for byte in text)

    @property
    def in_waiting(self) -> int:
        """Number of bytes that have arrived."""
        self._require_cable()
        return sum(at_s <= self.clock.monotonic_s() for at_s, _ in self._coming)

    def read(self, n: int) -> bytes:
        """Return up to `n` bytes that arrive in time."""
        if not self.in_waiting:
            now_s = self.clock.monotonic_s()
            next_s = self._coming[0][0] if self._coming else now_s + self._slice_s
            self.clock.sleep(min(self._slice_s, next_s - now_s))
        return bytes(self._coming.popleft()[1] for _ in range(min(n, self.in_waiting)))

    def _require_cable(self, number: int = errno.EIO) -> None:
        if not self._plugged:
            raise OSError(number, "it is unplugged")
