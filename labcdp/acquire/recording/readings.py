"""Readings of a plan: take and record them one by one."""

from __future__ import annotations

from ...core.reading import Reading
from ...drivers.meter import Meter, MeterError
from ...session import MeterConfiguration, Session
from ..control import Control, Progress, Report
from ..operator import Operator
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
        self._incidents_noted = len(meter.incidents)

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
        MeterError
            If the meter was in another mode than the configuration's; that reading is not recorded.
        """
        total = sum(readings_wanted(self._session.configuration).values())
        done = total - sum(remaining(self._session).readings.values())
        lacking = wanted - self._recorded(patch)
        if lacking > 0 and not self._begun:
            self._begun = True
            self._report(Progress("meter readings", done, total))
        for _ in range(lacking):
            self._control.checkpoint()
            try:
                reading = self._meter.measure()
            finally:
                self._note_incidents(patch)
            _require_mode(reading, self._session.configuration.meter)
            self._session.add_reading(reading, patch)
            done += 1
            self._report(Progress("meter readings", done, total, reading=(patch, reading)))

    def _note_incidents(self, patch: str) -> None:
        for incident in self._meter.incidents[self._incidents_noted :]:
            self._incidents_noted += 1
            content = {"patch": patch, "reason": incident.reason, "duration_s": incident.duration_s}
            self._session.add_event(f"meter {incident.kind}", content | {"at": incident.at.isoformat()})

    def _recorded(self, patch: str) -> int:
        return sum(record.patch == patch for record in self._session.readings())


def _require_mode(reading: Reading, wanted: MeterConfiguration) -> None:
    """Refuse a reading in another mode: its flags say so, and keys of the meter change modes unnoticed."""
    problems = {
        "a ratio in %": reading.unit == "%",
        "a held peak": reading.peak,
        f"a reading with the correction {reading.correction!r}, not {wanted.correction!r}": reading.correction
        not in (None, wanted.correction),
    }
    for problem, there in problems.items():
        if there:
            raise MeterError(
                f"the meter gave {problem} ({reading.raw}): it is not recorded; set the mode back at the meter, "
                "or switch it off and on with F held, then resume"
            )
