"""Speed of a replay."""

from __future__ import annotations

from datetime import datetime
from math import isfinite

from ...core.clock import Clock, SystemClock
from ...core.errors import InputError


class Pace:
    """Reproduces the intervals of a recording, or a fraction or multiple of them.

    Parameters
    ----------
    speed : float or None
        Speed relative to the recording; None never waits.
    clock : Clock or None
        Clock to wait with; None for the system clock.

    Raises
    ------
    InputError
        If `speed` is not a number above 0.
    """

    def __init__(self, speed: float | None, clock: Clock | None) -> None:
        if speed is not None and not (isfinite(speed) and speed > 0):
            raise InputError(
                f"speed is {speed}: give a factor above 0, 1 for the pace of the recording, or None not to wait"
            )
        self._speed = speed
        self._clock = clock or SystemClock()
        self._last: tuple[datetime, float] | None = None

    def keep(self, recorded: datetime) -> None:
        """Wait until the item recorded at this time is due; not if the recording's clock stepped back."""
        if self._speed is None:
            return
        if self._last is not None:
            last, given_s = self._last
            due_s = given_s + max(0.0, (recorded - last).total_seconds()) / self._speed
            self._clock.sleep(due_s - self._clock.monotonic_s())
        self._last = recorded, self._clock.monotonic_s()
