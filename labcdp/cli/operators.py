"""Operators of an acquisition from the command line: a person, a recording, and a meter that points itself."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..errors import DeviceError
from .keys import Keys
from .terminal import Bars, say

if TYPE_CHECKING:
    from ..acquire import CheckFinding, Operator
    from ..drivers.csv_meter import CsvMeter
    from ..session import Session


class Console:
    """The terminal as a place to ask a person something.

    Parameters
    ----------
    bars : Bars
        Taken away while the person is asked.
    keys : Keys
        Silent while the person is asked.
    """

    def __init__(self, bars: Bars, keys: Keys) -> None:
        self._bars = bars
        self._keys = keys

    def ask(self, question: str) -> str:
        """Return the line a person types; raises DeviceError if nobody does."""
        with self._bars.paused(), self._keys.silent():
            say(question)
            try:
                return input()
            except EOFError:
                raise DeviceError(
                    "nobody answers at the terminal: run the command where a person can press Enter, or with "
                    "--unattended; what was recorded is safe"
                ) from None


class ConsoleOperator:
    """A person at the terminal.

    Parameters
    ----------
    console : Console
        Where the person is asked.
    """

    def __init__(self, console: Console) -> None:
        self._console = console

    def cover_lens(self) -> None:
        """Ask for the lens cap."""
        self._request("Put the cap on the lens")

    def uncover_lens(self) -> None:
        """Ask to take off the lens cap."""
        self._request("Take the cap off the lens and light the target")

    def point_meter(self, patch: str) -> None:
        """Ask to point the meter."""
        self._request(f"Point the luminance meter at the middle of patch {patch}")

    def show_patch(self, patch: str) -> None:
        """Ask for the next patch."""
        self._request(f"Put patch {patch} before camera and luminance meter")

    def repeat(self, what: str, findings: Sequence[CheckFinding]) -> bool:
        """Tell what was found and ask whether to take it again."""
        for finding in findings:
            say(f"Warning: {finding}")
        answer = self._console.ask(f"Mend it and take the {what} again? Type y and press Enter; only Enter goes on.")
        return answer.strip().lower() in ("y", "yes")

    def _request(self, request: str) -> None:
        self._console.ask(f"{request}, then press Enter.")


class RecordingOperator:
    """Nothing is to be done for devices of a recorded session."""

    def cover_lens(self) -> None:
        """Do nothing."""

    def uncover_lens(self) -> None:
        """Do nothing."""

    def point_meter(self, patch: str) -> None:
        """Do nothing."""

    def show_patch(self, patch: str) -> None:
        """Do nothing."""

    def repeat(self, what: str, findings: Sequence[CheckFinding]) -> bool:
        """Do not: a recording is what it is."""
        return False


class CsvOperator:
    """An operator beside a meter whose readings stand in a file, so that nobody points it.

    Parameters
    ----------
    operator : Operator
        Does the rest.
    meter : CsvMeter
        Open.
    session : Session
        What it holds already is not given again.
    """

    def __init__(self, operator: Operator, meter: CsvMeter, session: Session) -> None:
        from ..session import ReadingRecord

        self._operator = operator
        self._meter = meter
        # Those that no longer count too: their rows are used.
        self._recorded = [record.patch for record in session.records if isinstance(record, ReadingRecord)]

    def cover_lens(self) -> None:
        """Leave it to the operator."""
        self._operator.cover_lens()

    def uncover_lens(self) -> None:
        """Leave it to the operator."""
        self._operator.uncover_lens()

    def point_meter(self, patch: str) -> None:
        """Go to the patch in the file, behind the readings that were recorded earlier."""
        self._meter.point(patch)
        for _ in range(self._recorded.count(patch)):
            self._meter.measure()
        self._recorded = [name for name in self._recorded if name != patch]

    def show_patch(self, patch: str) -> None:
        """Leave it to the operator, and go to the patch in the file."""
        self._operator.show_patch(patch)
        self.point_meter(patch)

    def repeat(self, what: str, findings: Sequence[CheckFinding]) -> bool:
        """Leave it to the operator."""
        return self._operator.repeat(what, findings)
