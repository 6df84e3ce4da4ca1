"""Replies of a simulated meter: when they come, and the faults they can be given."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from ....core.errors import InputError

CRLF: Final = b"\r\n"

#: Longest garbage; a reading has 17 bytes.
_LONGEST_GARBAGE: Final = 24


class MeterEngine(Protocol):
    """Maps commands to replies, for example `SimulatedLS`."""

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

    def __post_init__(self) -> None:
        if not self.delay_s >= 0:
            raise InputError(f"delay_s is {self.delay_s}: give a number of seconds of at least 0")
        if self.n_bytes is not None and self.n_bytes < 0:
            raise InputError(f"n_bytes is {self.n_bytes}: give a number of bytes of at least 0")

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
        self._engine = engine
        self._response_time_s = response_time_s
        self._faults: deque[Fault] = deque()

    def inject(self, *faults: Fault) -> None:
        """Queue faults, one for each of the next replies, of whatever command."""
        self._faults.extend(faults)

    def recover(self) -> None:
        """Forget the faults that are queued."""
        self._faults.clear()

    def unplug(self) -> None:
        """Pull the cable."""
        raise NotImplementedError

    def plug_in(self) -> None:
        """Reconnect the cable."""
        raise NotImplementedError

    def reply(self, command: bytes) -> tuple[bytes, float] | None:
        """Return the reply to a command and the time it takes, in which no other is accepted; None for silence."""
        answer = self._engine.answer(command)
        if not answer:
            return None
        fault = self._faults.popleft() if self._faults else Fault()
        busy_s = fault.delay_s + (self._response_time_s if command.startswith(b"MES") else 0.0)
        return (answer if fault.reply is None else fault.reply)[: fault.n_bytes], busy_s
