"""A port in this process with a meter on it, timed by any clock."""

from __future__ import annotations

import errno
from collections import deque
from typing import Self

from ....core.clock import Clock
from .replies import CRLF, FaultyMeter, MeterEngine


class InProcessPort(FaultyMeter):
    """A meter for `MinoltaLS` without a serial port; see `labcdp.drivers.minolta_ls.port.Port`.

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
