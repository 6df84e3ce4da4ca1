"""Konica Minolta LS-100 and LS-110 luminance meters over RS-232C.

Protocol: Minolta, *LS-100/LS-110 Communication Manual*, 9222-1842-12 (2000). The meter must be in remote mode:
switch it off and hold F while switching it on; it then shows "C".
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from math import isfinite
from os import PathLike
from typing import ClassVar, Final, Self

from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from ...core.errors import InputError
from ...core.reading import MeterIdentity, Reading
from ..meter import Meter, MeterIncident, require_mode
from .line import MeterLine
from .port import SETTINGS, NamedPort, Port, TranscriptWriter
from .protocol import LS100, LS110, MODE_GROUPS, POWER_ON, LSDataSheet, MeterMode, parse_reading

_log = logging.getLogger(__name__)

#: Correction of the readings in each of the first modes.
_CORRECTIONS: Final = {
    MeterMode.PRESET: "preset",
    MeterMode.VARI_CCF: "colour",
    MeterMode.VARI_LUMI: "luminance",
    MeterMode.VARI_CCF_LUMI: "both",
}


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
        File to create with every byte sent and received; see `labcdp.drivers.minolta_ls.port.TranscriptWriter`.

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
        self._port = named_port = NamedPort(port) if isinstance(port, str) else port
        self._identity = identity or MeterIdentity(self.data_sheet.model, serial="unknown")
        self._modes = POWER_ON
        for mode in modes:
            self._modes = tuple(
                mode if mode in group else former for group, former in zip(MODE_GROUPS, self._modes, strict=True)
            )
        about = {"meter": self.data_sheet.model, "port": named_port.name, **SETTINGS, "rtscts": named_port.rtscts}
        about |= {"timeout_s": timeout_s}
        writer = None if transcript is None else TranscriptWriter(transcript, about, named_port.clock)
        commands = [f"MDS,{mode.value}" for mode in self._modes]
        self._line = MeterLine(named_port, timeout_s, attempts, patience_s, commands, writer)

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

    def be_patient(self, patience_s: float) -> None:
        """Wait this long for the meter when it is lost; 0 also ends a wait."""
        self._line.patience_s = patience_s

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
            self._line.open()
        return self

    def ask_if_simulated(self) -> bool:
        """Ask a meter that may be simulated whether it is labcdp's simulated one, and note it in `identity`.

        Raises
        ------
        MeterError
            As `measure`.
        """
        if self._port.may_be_simulated:
            self._identity = replace(self._identity, simulated=self._line.is_simulated())
        return self._identity.simulated

    @property
    def incidents(self) -> tuple[MeterIncident, ...]:
        """Repeated commands, losses and errors."""
        return self._line.incidents

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
            If the meter is not open, or its reading is in another mode than those set: its keys change modes unnoticed.
        """
        reading = self._reading("MES")
        ratio, peak = MeterMode.RATIO in self._modes, MeterMode.PEAK in self._modes
        require_mode(reading, ratio=ratio, peak=peak, correction=_CORRECTIONS[self._modes[0]])
        return reading

    def read_held(self) -> Reading:
        """Read the value on the display, without measuring; it may have been taken in other modes than those set.

        Raises
        ------
        MeterError
            As `measure`.
        """
        return self._reading("DSR")

    def _reading(self, command: str) -> Reading:
        def parse(reply: bytes) -> Reading:
            return parse_reading(reply, self.data_sheet, self.identity, self._port.clock.now())

        reading = self._line.ask(command, parse)
        if reading.unit == "fL":
            _log.warning(
                "%s: the meter is set to fL: %g fL is %g cd/m²; set its unit switch to cd/m² if that is not meant",
                self.port,
                reading.value,
                reading.luminance_cd_m2,
            )
        slow = MeterMode.SLOW in self._modes
        low, high = self.data_sheet.slow_range_cd_m2 if slow else self.data_sheet.fast_range_cd_m2
        # A user's correction hides the measured value.
        measured = reading.unit != "%" and reading.correction == "preset"
        if measured and not low <= reading.luminance_cd_m2 <= high:
            _log.warning(
                "%s: %g cd/m² is outside the range of the %s with %s response, %g to %g cd/m²: this value is "
                "unreliable",
                self.port,
                reading.luminance_cd_m2,
                self.data_sheet.model,
                "SLOW" if slow else "FAST",
                low,
                high,
            )
        return reading


class MinoltaLS100(MinoltaLS):
    """Konica Minolta LS-100, acceptance angle 1 degree; a `Meter`. Parameters as of `MinoltaLS`.

    Examples
    --------
    >>> from labcdp.drivers import MinoltaLS100
    >>> MinoltaLS100("/dev/ttyUSB0").identity.model
    'LS-100'
    """

    data_sheet = LS100


class MinoltaLS110(MinoltaLS):
    """Konica Minolta LS-110, acceptance angle 1/3 degree; a `Meter`. Parameters as of `MinoltaLS`.

    Examples
    --------
    >>> from labcdp.drivers import MinoltaLS110
    >>> MinoltaLS110("/dev/ttyUSB0").identity.model
    'LS-110'
    """

    data_sheet = LS110


#: Driver of each model.
DRIVERS: Final[dict[str, type[MinoltaLS]]] = {"LS-100": MinoltaLS100, "LS-110": MinoltaLS110}


def find_meter_ports() -> list[ListPortInfo]:
    """Return the serial ports by name; only opening one shows whether a meter is connected.

    Examples
    --------
    >>> from labcdp.drivers import find_meter_ports
    >>> isinstance(find_meter_ports(), list)
    True
    """
    return sorted(list_ports.comports(), key=lambda port: port.device)
