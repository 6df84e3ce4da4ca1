"""Operators of an acquisition on the command line: the user, a replay, and readings from a file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ...acquire.operator import AskedOperator
from ...core.errors import DeviceError
from ..terminal import Bars, say
from .keys import Keys

if TYPE_CHECKING:
    from ...acquire import CheckFinding, Operator
    from ...drivers.manual.csv import CsvMeter
    from ...session import Session


class Console:
    """Questions to the user at the terminal.

    Parameters
    ----------
    bars : Bars
        Hidden during a question.
    keys : Keys
        Silent during a question.
    """

    def __init__(self, bars: Bars, keys: Keys) -> None:
        self._bars = bars
        self._keys = keys

    def ask(self, question: str) -> str:
        """Return the typed answer; raises DeviceError at the end of standard input."""
        with self._bars.paused(), self._keys.silent():
            say(question)
            try:
                return input()
            except EOFError:
                raise DeviceError(
                    "no answer from the terminal: run the command in an interactive terminal, or with --unattended; "
                    "recorded data are safe"
                ) from None


class ConsoleOperator(AskedOperator):
    """The user at the terminal.

    Parameters
    ----------
    console : Console
        Where the person is asked.
    hands : Operator or None
        The simulated bench, which then does what the person confirmed.
    """

    def __init__(self, console: Console, hands: Operator | None = None) -> None:
        super().__init__(hands)
        self._console = console

    def request(self, step: str, patch: str = "") -> None:
        """Ask the person to press Enter when the step is done."""
        self._console.ask(f"{step}, then press Enter.")

    def repeat(self, what: str, findings: Sequence[CheckFinding]) -> bool:
        """Show the findings and ask whether to repeat."""
        for finding in findings:
            say(f"Warning: {finding}")
        answer = self._console.ask(f"Fix it and repeat the {what}? [y/N]")
        return answer.strip().lower() in ("y", "yes")


class RecordingOperator(AskedOperator):
    """Operator of a replay, which needs no manual steps."""

    def request(self, step: str, patch: str = "") -> None:
        """Do nothing."""

    def repeat(self, what: str, findings: Sequence[CheckFinding]) -> bool:
        """Return False: a recording cannot be repeated."""
        return False


class CsvOperator(AskedOperator):
    """Operator for a meter whose readings come from a file, which is not pointed.

    Parameters
    ----------
    operator : Operator
        Performs the other steps.
    meter : CsvMeter
        Open.
    session : Session
        Readings it already has are skipped.
    """

    def __init__(self, operator: Operator, meter: CsvMeter, session: Session) -> None:
        from ...session import ReadingRecord

        super().__init__(operator)
        self._operator = operator
        self._meter = meter
        # Includes discarded readings, whose rows are used.
        self._recorded = [record.patch for record in session.records if isinstance(record, ReadingRecord)]

    def request(self, step: str, patch: str = "") -> None:
        """Leave it to the operator."""

    def point_meter(self, patch: str) -> None:
        """Go to the patch in the file, after the readings recorded earlier."""
        self._meter.point(patch)
        for _ in range(self._recorded.count(patch)):
            self._meter.measure()
        self._recorded = [name for name in self._recorded if name != patch]

    def show_patch(self, patch: str) -> None:
        """Delegate to the operator, and go to the patch in the file."""
        super().show_patch(patch)
        self.point_meter(patch)

    def repeat(self, what: str, findings: Sequence[CheckFinding]) -> bool:
        """Delegate to the operator."""
        return self._operator.repeat(what, findings)
