"""Readings of a plan: take and record them one by one."""

from __future__ import annotations

from ...drivers.meter import Meter
from ...session import Session
from ..control import Control
from ..operator import Operator
from ..progress import Progress, Report
from ..steps import readings_wanted, remaining


class ReadingRecorder:
    """Takes the readings of a session's plan.

    Parameters
    ----------
    session : Session
        Open for writing.
    meter : Meter
        Open.
    operator : Operator
        Points the meter.
    report : callable
        Called after each reading.
    control : Control
        Polled between readings.
    """

    def __init__(self, session: Session, meter: Meter, operator: Operator, report: Report, control: Control) -> None:
        self._session = session
        self._meter = meter
        self._operator = operator
        self._report = report
        self._control = control
        self._begun = False

    def point_and_record(self, patch: str, wanted: int) -> bool:
        """Have the meter pointed and call `record`; returns whether readings were missing."""
        if self._recorded(patch) >= wanted:
            return False
        self._operator.point_meter(patch)
        self.record(patch, wanted)
        return True

    def record(self, patch: str, wanted: int) -> None:
        """Read until a patch has the requested number of readings.

        Raises
        ------
        InputError
            If the meter gives a ratio in %; it is not recorded, since it is no luminance.
        """
        total = sum(readings_wanted(self._session.configuration).values())
        done = total - sum(remaining(self._session).readings.values())
        lacking = wanted - self._recorded(patch)
        if lacking > 0 and not self._begun:
            self._begun = True
            self._report(Progress("meter readings", done, total))
        for _ in range(lacking):
            self._control.checkpoint()
            reading = self._meter.measure()
            _ = reading.luminance_cd_m2
            self._session.add_reading(reading, patch)
            done += 1
            self._report(Progress("meter readings", done, total))

    def _recorded(self, patch: str) -> int:
        return sum(record.patch == patch for record in self._session.readings())
