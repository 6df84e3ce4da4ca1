"""Clock: where time comes from, so that a simulated night need not last one; and times as text."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from heapq import heappop, heappush
from itertools import count
from math import isfinite
from typing import Protocol

from .errors import InputError


def exposure_text(exposure_s: float, digits: int = 4) -> str:
    """Write an exposure time in s, ms or µs, whichever is handy, with up to a number of significant digits."""
    for unit, seconds in (("s", 1.0), ("ms", 1e-3)):
        if exposure_s >= seconds:
            return f"{exposure_s / seconds:.{digits}g} {unit}"
    return f"{exposure_s * 1e6:.{digits}g} µs"


class Clock(Protocol):
    """Time of day, elapsed time, and waiting."""

    def now(self) -> datetime:
        """Time of day, with time zone; not monotonic."""

    def monotonic_s(self) -> float:
        """Seconds since some moment; never goes back."""

    def sleep(self, duration_s: float) -> None:
        """Wait; not at all for a duration of 0 or less."""


class SystemClock:
    """The computer's clock."""

    def now(self) -> datetime:
        """Time of day in UTC."""
        return datetime.now(UTC)

    def monotonic_s(self) -> float:
        """Seconds of the computer's monotonic clock."""
        return time.monotonic()

    def sleep(self, duration_s: float) -> None:
        """Wait as long."""
        if duration_s > 0:
            time.sleep(duration_s)


class SimulatedClock:
    """A virtual clock that advances only by `sleep`; thread-safe.

    Parameters
    ----------
    start : datetime
        Time of day at the beginning, with time zone.

    Raises
    ------
    InputError
        If `start` has no time zone.
    """

    def __init__(self, start: datetime = datetime(2026, 1, 1, tzinfo=UTC)) -> None:
        if start.tzinfo is None:
            raise InputError("start has no time zone: give an aware datetime")
        self._start = start
        self._elapsed_s = 0.0
        self._lock = threading.RLock()
        self._timers: list[tuple[float, int, Callable[[], None]]] = []
        self._order = count()

    def now(self) -> datetime:
        """Time of day."""
        return self._start + timedelta(seconds=self.monotonic_s())

    def monotonic_s(self) -> float:
        """Seconds slept so far."""
        with self._lock:
            return self._elapsed_s

    def sleep(self, duration_s: float) -> None:
        """Let the time pass at once; what was set for a moment within it happens in its order."""
        if not isfinite(duration_s):
            raise InputError(f"duration_s is {duration_s}: give a finite number of seconds")
        with self._lock:
            until_s = self._elapsed_s + max(0.0, duration_s)
            while self._timers and self._timers[0][0] <= until_s:
                at_s, _, action = heappop(self._timers)
                self._elapsed_s = max(self._elapsed_s, at_s)
                action()
            self._elapsed_s = max(self._elapsed_s, until_s)

    def call_at(self, at_s: float, action: Callable[[], None]) -> None:
        """Do something once the clock's `monotonic_s` reaches a moment, inside the `sleep` that passes it."""
        with self._lock:
            heappush(self._timers, (at_s, next(self._order), action))
