"""Replay of a recorded session: luminance meter, and the speed of a replay."""

from __future__ import annotations

from datetime import datetime
from math import isfinite
from os import PathLike
from typing import Self

from ...core.clock import Clock, SystemClock
from ...core.errors import InputError
from ...core.reading import MeterIdentity, Reading
from ...session import ReadingRecord, Session
from ..meter import Meter, MeterError, MeterNotFoundError


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


class ReplayMeter(Meter):
    """The luminance meter of a recorded session, with the protocol of `Meter`.

    Readings are not repeated after closing and reopening.

    Parameters
    ----------
    session : Session or path
        The session, or its folder.
    speed : float or None
        None for no delays; 1 for the recorded intervals between readings, 10 for a tenth of them. Time between two
        calls counts.
    clock : Clock
        Clock to wait with.

    Raises
    ------
    InputError
        If `speed` is not a number above 0.
    """

    def __init__(
        self, session: Session | str | PathLike[str], speed: float | None = None, clock: Clock | None = None
    ) -> None:
        self._source = session
        self._pace = Pace(speed, clock)
        self._recorded: list[ReadingRecord] = []
        self._given = 0
        self._is_open = False

    def open(self) -> Self:
        """Read the session's journal.

        Raises
        ------
        SessionError
            If it is not a session, or its journal was altered.
        MeterNotFoundError
            If it contains no reading.
        """
        if not self._recorded:
            session = self._source if isinstance(self._source, Session) else Session.open(self._source)
            self._recorded = session.readings()
            if not self._recorded:
                raise MeterNotFoundError(f"{session.path} holds no readings: give a session with readings")
        self._is_open = True
        return self

    def close(self) -> None:
        """Stop the replay; may be called twice."""
        self._is_open = False

    @property
    def identity(self) -> MeterIdentity:
        """The meter of the first reading; raises MeterError if not open."""
        self._require_open()
        return self._recorded[0].reading.meter

    @property
    def unused(self) -> tuple[ReadingRecord, ...]:
        """Recorded readings not requested so far; none before the first `open`."""
        return tuple(self._recorded[self._given :])

    def measure(self) -> Reading:
        """Return the next reading; never times out.

        Raises
        ------
        MeterError
            If all of them have been returned; the message states their number.
        """
        self._require_open()
        if self._given == len(self._recorded):
            raise MeterError(f"{self._given} readings were recorded, and all were given: ask for at most {self._given}")
        reading = self._recorded[self._given].reading
        self._pace.keep(reading.timestamp)
        self._given += 1
        return reading

    def _require_open(self) -> None:
        if not self._is_open:
            raise MeterError("the replayed meter is not open: open it first")
