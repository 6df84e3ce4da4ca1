"""Timers: let something happen at a moment of a clock, the computer's or a simulated one."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from heapq import heappop, heappush
from itertools import count

from ...clock import Clock, SimulatedClock

_log = logging.getLogger(__name__)

Action = Callable[[], None]


class Timers:
    """Actions at moments of a clock.

    On a `SimulatedClock` an action happens inside the `sleep` that passes its moment. On another clock one thread
    does them in turn; it begins with the first and ends with the last of them, or with `close`.

    Parameters
    ----------
    clock : Clock
        Whose moments.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._pending: list[tuple[float, int, Action]] = []
        self._order = count()
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None
        self._closed = False

    def call_in(self, delay_s: float, action: Action) -> None:
        """Do something after so many seconds; what it raises is logged. Nothing happens any more after `close`."""
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
        """Forget what has not happened yet; may be called twice."""
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
        """Wait for the next action; None when there is none left."""
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
            _log.exception("a fault of the simulated bench could not be brought about")
