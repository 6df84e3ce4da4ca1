"""Timers: run actions at given times of a clock, real or simulated."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

from ....core.clock import Clock, SimulatedClock

_log = logging.getLogger(__name__)

Action = Callable[[], None]


class Timers:
    """Actions at given times of a clock.

    On a `SimulatedClock` an action runs inside the `sleep` that passes its time, on another clock in a thread of its
    own, which ends with `close` at the latest. One that is due runs at once.

    Parameters
    ----------
    clock : Clock
        Clock of the actions.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._waiting: list[threading.Timer] = []
        self._closed = False

    def call_in(self, delay_s: float, action: Action) -> None:
        """Run an action after a number of seconds, unless closed before; its exceptions are logged."""
        if delay_s <= 0:
            self._do(action)
        elif isinstance(self._clock, SimulatedClock):
            self._clock.call_at(self._clock.monotonic_s() + delay_s, lambda: self._do(action))
        elif not self._closed:
            timer = threading.Timer(delay_s, self._do, [action])
            timer.daemon = True
            self._waiting = [*(one for one in self._waiting if one.is_alive()), timer]
            timer.start()

    def close(self) -> None:
        """Cancel all pending actions; may be called twice."""
        self._closed = True
        for timer in self._waiting:
            timer.cancel()
            if timer is not threading.current_thread():
                timer.join()

    def _do(self, action: Action) -> None:
        if self._closed:
            return
        try:
            action()
        except Exception:
            _log.exception("a fault of the simulated bench could not be triggered")
