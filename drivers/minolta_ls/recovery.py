"""Recovery of a Konica Minolta LS-100 or LS-110: repeating requests and waiting for a lost meter."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import Final, TypeVar

from ..device import on_error
from ..meter import (
    MeterError,
    MeterIncident,
    MeterIncidentKind,
    MeterLostError,
    MeterNotFoundError,
    MeterProtocolError,
    MeterReportedError,
    MeterTimeoutError,
)
from .line import MeterLine
from .protocol import SIMULATED_COMMAND, SIMULATED_REPLY, parse_acknowledgement

_log = logging.getLogger(__name__)

#: Polling interval for a lost port, in seconds.
_LOOK_EVERY_S: Final = 0.2
#: Command not understood: the only error code worth a retry.
_NOT_UNDERSTOOD: Final = "ER00"

T = TypeVar("T")


class MeterLink:
    """A line with retries, which waits for a lost meter.

    Parameters
    ----------
    line : MeterLine
        The line.
    attempts : int
        Largest number of attempts for a command.
    patience_s : float
        How long to wait for a lost meter, in seconds.
    to_restore : callable
        Returns the commands that restore a reconnected meter, each answered with ``OK00``.
    """

    def __init__(
        self, line: MeterLine, attempts: int, patience_s: float, to_restore: Callable[[], Sequence[str]]
    ) -> None:
        self._line = line
        self._clock = line.clock
        self._attempts = attempts
        self._patience_s = patience_s
        self._to_restore = to_restore
        self.incidents: tuple[MeterIncident, ...] = ()

    @property
    def _mode(self) -> str:
        return self._to_restore()[0]

    def _note(self, kind: MeterIncidentKind, error: MeterError, duration_s: float = 0.0) -> None:
        self.incidents = (*self.incidents, MeterIncident(kind, self._clock.now(), str(error), duration_s))

    def connect(self) -> None:
        """Open the port and set the modes, within timeout_s * (attempts + 1); raises MeterError, the port closed."""
        self._line.open()
        with on_error(self._line.close):
            give_up_s = self._clock.monotonic_s() + self._line.timeout_s * (self._attempts + 1)
            for command in self._to_restore():
                self._ask_often(command, parse_acknowledgement, give_up_s)

    def is_simulated(self) -> bool:
        """Whether the meter says that it is labcdp's simulated one; a real one does not understand the question."""
        try:
            give_up_s = self._clock.monotonic_s() + self._line.timeout_s
            return self._line.exchange(SIMULATED_COMMAND, lambda reply: reply == SIMULATED_REPLY, give_up_s, self._mode)
        except (MeterReportedError, MeterTimeoutError):
            return False

    def ask(self, command: str, parse: Callable[[bytes], T]) -> T:
        """Send a command and return its parsed reply; raises MeterError after all retries.

        Takes at most timeout_s * (attempts + 1) + patience_s. A meter that does not come back is closed.
        """
        try:
            return self._ask_patiently(command, parse)
        except MeterError as error:
            self._note("error", error)
            raise

    def _ask_patiently(self, command: str, parse: Callable[[bytes], T]) -> T:
        give_up_s = self._clock.monotonic_s() + self._line.timeout_s * (self._attempts + 1) + self._patience_s
        lost_until_s: float | None = None
        while True:
            try:
                return self._ask_often(command, parse, give_up_s)
            except (MeterLostError, MeterTimeoutError) as error:
                if self._patience_s == 0:
                    raise
                if lost_until_s is None:
                    # Reserve time for the command after the wait.
                    lost_until_s = min(self._clock.monotonic_s() + self._patience_s, give_up_s - self._line.timeout_s)
                elif self._clock.monotonic_s() >= lost_until_s:
                    self._line.close()
                    raise
                self._wait_for_meter(error, lost_until_s)

    def _ask_often(self, command: str, parse: Callable[[bytes], T], give_up_s: float) -> T:
        not_understood = False
        attempt = 1
        while True:
            try:
                return self._line.exchange(command, parse, give_up_s, self._mode, again=attempt > 1)
            except MeterReportedError as error:
                if error.code != _NOT_UNDERSTOOD or not_understood or attempt == self._attempts:
                    raise
                not_understood = True
                problem: MeterError = error
            except (MeterTimeoutError, MeterProtocolError) as error:
                if attempt == self._attempts or self._clock.monotonic_s() >= give_up_s:
                    raise
                problem = error
            attempt += 1
            self._note("asked again", problem)
            _log.warning("%s; asking again (attempt %d of %d)", problem, attempt, self._attempts)

    def _wait_for_meter(self, lost: MeterError, until_s: float) -> None:
        """Reopen the port and restore the modes; raises MeterLostError if that fails for too long."""
        began_s = self._clock.monotonic_s()
        _log.warning("%s; waiting up to %g s for the meter to come back", lost, self._patience_s)
        while True:
            self._line.close()
            try:
                self._reconnect(until_s)
            except (MeterNotFoundError, MeterLostError, MeterTimeoutError, MeterProtocolError) as still:
                if self._clock.monotonic_s() + _LOOK_EVERY_S >= until_s:
                    self._line.close()
                    raise MeterLostError(
                        f"{lost}; it did not come back within {self._patience_s:g} s, last: {still}"
                    ) from still
                self._clock.sleep(_LOOK_EVERY_S)
            except BaseException:
                self._line.close()
                raise
            else:
                self._note("lost and back", lost, self._clock.monotonic_s() - began_s)
                _log.warning("%s: the meter is back, its modes are restored", self._line.port)
                return

    def _reconnect(self, until_s: float) -> None:
        self._line.open()
        for command in self._to_restore():
            self._line.exchange(command, parse_acknowledgement, until_s, command)
