"""Konica Minolta LS-100 and LS-110 luminance meters over RS-232C.

Protocol: Minolta, *LS-100/LS-110 Communication Manual*, 9222-1842-12 (2000). The meter must be in remote mode:
switch it off and hold F while switching it on; it then shows "C".
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from math import isfinite
from os import PathLike
from typing import ClassVar, Final, Self, TypeVar

from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from ...core.errors import InputError
from ...core.reading import MeterIdentity, Reading
from ..device import on_error
from ..meter import (
    Meter,
    MeterError,
    MeterIncident,
    MeterIncidentKind,
    MeterLostError,
    MeterNotFoundError,
    MeterProtocolError,
    MeterReportedError,
    MeterTimeoutError,
)
from .line import SETTINGS, MeterLine, NamedPort, Port, TranscriptWriter
from .protocol import (
    LS100,
    LS110,
    MODE_GROUPS,
    SIMULATED_COMMAND,
    SIMULATED_REPLY,
    LSDataSheet,
    MeterMode,
    parse_acknowledgement,
    parse_reading,
)

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


_log = logging.getLogger(__name__)

_ON_OPENING: Final[tuple[MeterMode, ...]] = (MeterMode.PRESET, MeterMode.ABS, MeterMode.FAST, MeterMode.CONT)


class MinoltaLS(Meter):
    """Base class of both models; use `MinoltaLS100` or `MinoltaLS110`, which have their data sheets.

    Parameters
    ----------
    port : str or Port
        Serial port, for example ``/dev/ttyUSB0``; the names in ``/dev/serial/by-id`` persist when an adapter is
        reconnected. `NamedPort` uses the RTS and CTS lines of the cable LS-A12.
    identity : MeterIdentity, optional
        Serial number and calibration date to record; the meter cannot report them.
    timeout_s : float
        Longest wait for a reply, in seconds. The meter itself gives up after 5 s, so use more for a real one. After a
        failed exchange the next one first waits as long again for a late reply, which is dropped.
    modes : sequence of MeterMode
        Set on opening; PRESET, ABS, FAST and CONT in the groups that it leaves out.
    attempts : int
        Largest number of attempts for a command with a late, incomplete or invalid reply. A command not understood by
        the meter (ER00) is repeated once; other error codes are not retried.
    patience_s : float
        How long to wait for a lost meter, in seconds: its port is closed and reopened when available, the modes are
        restored and the command is repeated. A meter still silent after all attempts counts as lost.
    transcript : path, optional
        File to create with every byte sent and received; see `labcdp.drivers.minolta_ls.line.TranscriptWriter`.

    Raises
    ------
    InputError
        If a number is out of its range.

    Notes
    -----
    No method takes longer than timeout_s * (attempts + 1) + patience_s, and 0.05 s of polling. Every recovery is logged
    as a warning. If the connection is lost permanently, the port is closed.
    """

    data_sheet: ClassVar[LSDataSheet]

    def __init__(
        self,
        port: str | Port,
        identity: MeterIdentity | None = None,
        *,
        timeout_s: float = 6.0,
        modes: Sequence[MeterMode] = (),
        attempts: int = 1,
        patience_s: float = 0.0,
        transcript: str | PathLike[str] | None = None,
    ) -> None:
        if not (isfinite(timeout_s) and timeout_s > 0):
            raise InputError(f"timeout_s is {timeout_s}: give a positive number of seconds")
        if attempts < 1:
            raise InputError(f"attempts is {attempts}: give at least 1")
        if not (isfinite(patience_s) and patience_s >= 0):
            raise InputError(f"patience_s is {patience_s}: give a number of seconds of at least 0")
        place = NamedPort(port) if isinstance(port, str) else port
        self._port = place
        self._identity = identity or MeterIdentity(self.data_sheet.model, serial="unknown")
        self._modes = _ON_OPENING
        for mode in modes:
            self._modes = _replaced(self._modes, mode)
        about = {"meter": self.data_sheet.model, "port": place.name, **SETTINGS, "rtscts": place.rtscts}
        about |= {"timeout_s": timeout_s}
        writer = None if transcript is None else TranscriptWriter(transcript, about, place.clock)
        self._line = MeterLine(place, timeout_s, writer)
        self._link = MeterLink(self._line, attempts, patience_s, lambda: [_command(mode) for mode in self._modes])

    @property
    def identity(self) -> MeterIdentity:
        """Model, serial number and calibration date, as given: the meter cannot report them."""
        return self._identity

    @property
    def port(self) -> str:
        """Serial port, as given."""
        return self._port.name

    @property
    def modes(self) -> tuple[MeterMode, ...]:
        """The mode of each group as set by this driver; empty if the meter is not open.

        The meter cannot report its modes, and its keys change them unnoticed.
        """
        return self._modes if self._line.is_open else ()

    def open(self) -> Self:
        """Open the port exclusively, and set one mode of each group.

        The meter cannot identify itself and its modes cannot be read back, so they are written; the answers also
        confirm that a meter is connected. Opening an open meter does nothing.

        Raises
        ------
        MeterNotFoundError
            If the port is absent, in use, not permitted, or not a serial port.
        MeterError
            As `measure`, if the meter rejects the modes.
        InputError
            If the transcript cannot be created.
        """
        if not self._line.is_open:
            self._link.connect()
        return self

    def ask_if_simulated(self) -> bool:
        """Ask a meter that may be simulated whether it is labcdp's simulated one, and note it in `identity`.

        Raises
        ------
        MeterError
            As `measure`.
        """
        if self._port.may_be_simulated:
            self._identity = replace(self._identity, simulated=self._link.is_simulated())
        return self._identity.simulated

    @property
    def incidents(self) -> tuple[MeterIncident, ...]:
        """Repeated commands, losses and errors."""
        return self._link.incidents

    def close(self) -> None:
        """Close the port; may be called twice."""
        self._line.close()

    def measure(self) -> Reading:
        """Take one reading in the modes that are set; in mode RATIO its unit is ``%``.

        A first reading that is too dark can make the meter leave remote mode (reported by users of other programs); it
        is then silent until restarted with F held.

        Raises
        ------
        MeterReportedError
            If the meter answers with an error code.
        MeterTimeoutError
            If it does not answer in time or completely.
        MeterProtocolError
            If the answer is not a reading.
        MeterLostError
            If the connection was lost; the port is then closed.
        MeterError
            If the meter is not open.
        """
        return self._reading("MES")

    def read_held(self) -> Reading:
        """Read the value on the display, without measuring.

        Raises
        ------
        MeterError
            As `measure`.
        """
        return self._reading("DSR")

    def _reading(self, command: str) -> Reading:
        def parse(reply: bytes) -> Reading:
            return parse_reading(reply, self.data_sheet, self.identity, self._port.clock.now())

        reading = self._link.ask(command, parse)
        if reading.unit == "fL":
            _log.warning(
                "%s: the meter is set to fL: %g fL is %g cd/m^2; set its unit switch to cd/m^2 if that is not meant",
                self.port,
                reading.value,
                reading.luminance_cd_m2,
            )
        self._warn_if_out_of_range(reading)
        return reading

    def _warn_if_out_of_range(self, reading: Reading) -> None:
        """Warn of a reading outside the data sheet's range, unless a user's correction hides the measured value."""
        if reading.unit == "%" or reading.correction != "preset":
            return
        slow = MeterMode.SLOW in self._modes
        low, high = self.data_sheet.slow_range_cd_m2 if slow else self.data_sheet.fast_range_cd_m2
        if not low <= reading.luminance_cd_m2 <= high:
            _log.warning(
                "%s: %g cd/m^2 is outside the range of the %s with %s response, %g to %g cd/m^2: do not rely on it",
                self.port,
                reading.luminance_cd_m2,
                self.data_sheet.model,
                "SLOW" if slow else "FAST",
                low,
                high,
            )


class MinoltaLS100(MinoltaLS):
    """Konica Minolta LS-100, acceptance angle 1 degree; a `Meter`. Parameters as of `MinoltaLS`."""

    data_sheet = LS100


class MinoltaLS110(MinoltaLS):
    """Konica Minolta LS-110, acceptance angle 1/3 degree; a `Meter`. Parameters as of `MinoltaLS`."""

    data_sheet = LS110


#: Driver of each model.
DRIVERS: Final[dict[str, type[MinoltaLS]]] = {"LS-100": MinoltaLS100, "LS-110": MinoltaLS110}


def find_meter_ports() -> list[ListPortInfo]:
    """Return the serial ports by name; only opening one shows whether a meter is connected."""
    return sorted(list_ports.comports(), key=lambda port: port.device)


def _replaced(modes: tuple[MeterMode, ...], mode: MeterMode) -> tuple[MeterMode, ...]:
    return tuple(mode if mode in group else former for group, former in zip(MODE_GROUPS, modes, strict=True))


def _command(mode: MeterMode) -> str:
    return f"MDS,{mode.value}"
