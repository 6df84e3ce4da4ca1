"""Timers: run actions at given times of a clock, real or simulated."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from heapq import heappop, heappush
from itertools import count

from ....core.clock import Clock, SimulatedClock

_log = logging.getLogger(__name__)

Action = Callable[[], None]


class Timers:
    """Actions at given times of a clock.

    On a `SimulatedClock` an action runs inside the `sleep` that passes its time. On another clock one thread runs them
    in turn; it starts with the first and ends with the last of them, or with `close`.

    Parameters
    ----------
    clock : Clock
        Clock of the actions.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._pending: list[tuple[float, int, Action]] = []
        self._order = count()
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None
        self._closed = False

    def call_in(self, delay_s: float, action: Action) -> None:
        """Run an action after a number of seconds, unless closed before; its exceptions are logged."""
        at_s = self._clock.monotonic_s() + delay_s
        if isinstance(self._clock, SimulatedClock):
            self._clock.call_at(at_s, lambda: self._do(action))
            return
        with self._changed:
            heappush(self._pending, (at_s, next(self._order), action))
            if self._thread is None and not self._closed:
                self._thread = threading.Thread(target=self._run, name="faults of the simulated bench", daemon=True)
                self._thread.start()
            self._changed.notify()

    def close(self) -> None:
        """Cancel all pending actions; may be called twice."""
        with self._changed:
            self._closed = True
            self._pending.clear()
            thread = self._thread
            self._changed.notify()
        if thread is not None and thread is not threading.current_thread():
            thread.join()

    def _run(self) -> None:
        while (action := self._next()) is not None:
            self._do(action)

    def _next(self) -> Action | None:
        """Wait for the next action; None if there is none left."""
        with self._changed:
            while self._pending:
                wait_s = self._pending[0][0] - self._clock.monotonic_s()
                if wait_s <= 0:
                    return heappop(self._pending)[2]
                self._changed.wait(wait_s)
            self._thread = None
            return None

    def _do(self, action: Action) -> None:
        if self._closed:
            return
        try:
            action()
        except Exception:
            _log.exception("a fault of the simulated bench could not be triggered")
