"""Luminance meter on a port: what the drivers of all models share."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from math import isfinite
from os import PathLike
from typing import Any, ClassVar, Literal, Self, TypedDict, Unpack

from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from ...core.errors import InputError
from ...core.reading import MeterIdentity, Reading
from ..meter import Meter, MeterIncident
from .data_sheet import MeterDataSheet
from .line import LineProtocol, MeterLine
from .port import SETTINGS, NamedPort, Port, TranscriptWriter

_log = logging.getLogger(__name__)

Response = Literal["fast", "slow"]
#: Whose correction the meter applies: the maker's calibration, or the user's.
Correction = Literal["preset", "colour", "luminance", "both"]


class ExchangeOptions(TypedDict, total=False):
    """How a meter is asked, as of `SerialMeter`."""

    timeout_s: float
    attempts: int
    patience_s: float
    transcript: str | PathLike[str] | None


class SerialMeter(Meter):
    """Base class of the meters on a port; a model has its data sheet, protocol, and command for a reading.

    Parameters
    ----------
    port : str or Port
        Serial port, for example ``/dev/ttyUSB0``; the names in ``/dev/serial/by-id`` persist when an adapter is
        reconnected. ``socket://HOST:PORT`` for a program in the network. `NamedPort` uses the RTS and CTS lines of the
        cable.
    identity : MeterIdentity, optional
        Serial number and calibration date to record; the meter cannot report them.
    protocol : LineProtocol
        Set-up and replies of the model.
    timeout_s : float
        Longest wait for a reply, in seconds; if left out, that of the model. After a failed exchange the next one first
        waits as long again for a late reply, which is dropped.
    attempts : int
        Largest number of attempts for a command with a late, incomplete or invalid reply. A command not understood by
        the meter (ER00) is repeated once; other error codes are not retried.
    patience_s : float
        How long to wait for a lost meter, in seconds: its port is closed and reopened when available, it is set up
        again and the command is repeated. A meter still silent after all attempts counts as lost.
    transcript : path, optional
        File to create with every byte sent and received; see `labcdp.drivers.minolta.port.TranscriptWriter`.

    Raises
    ------
    InputError
        If a number is out of its range.

    Notes
    -----
    No method takes longer than timeout_s * (attempts + 1) + patience_s, and 0.05 s of polling. Every recovery is logged
    as a warning. If the connection is lost permanently, the port is closed.
    """

    data_sheet: ClassVar[MeterDataSheet]
    #: Of the serial port.
    settings: ClassVar[Mapping[str, Any]] = SETTINGS
    #: Longest wait for a reply if none is given. The meters themselves give up after 5 s.
    longest_reply_s: ClassVar[float] = 6.0

    def __init__(
        self,
        port: str | Port,
        identity: MeterIdentity | None,
        protocol: LineProtocol,
        *,
        timeout_s: float | None = None,
        attempts: int = 1,
        patience_s: float = 0.0,
        transcript: str | PathLike[str] | None = None,
    ) -> None:
        timeout_s = self.longest_reply_s if timeout_s is None else timeout_s
        if not (isfinite(timeout_s) and timeout_s > 0):
            raise InputError(f"timeout_s is {timeout_s}: give a positive number of seconds")
        if attempts < 1:
            raise InputError(f"attempts is {attempts}: give at least 1")
        if not (isfinite(patience_s) and patience_s >= 0):
            raise InputError(f"patience_s is {patience_s}: give a number of seconds of at least 0")
        self._port = named_port = self.named_port(port) if isinstance(port, str) else port
        self._identity = identity or MeterIdentity(self.data_sheet.model, serial="unknown")
        about = {"meter": self.data_sheet.model, "port": named_port.name, **self.settings, "rtscts": named_port.rtscts}
        about |= {"timeout_s": timeout_s}
        writer = None if transcript is None else TranscriptWriter(transcript, about, named_port.clock)
        self._line = MeterLine(named_port, timeout_s, attempts, patience_s, protocol, writer)

    @classmethod
    def named_port(cls, name: str, rtscts: bool = False) -> NamedPort:
        """Return a port of this computer, or of the network, with the settings of the model."""
        return NamedPort(name, rtscts, cls.settings)

    @classmethod
    def configured(
        cls,
        port: str | Port,
        identity: MeterIdentity | None = None,
        *,
        response: Response = "fast",
        correction: Correction = "preset",
        **options: Unpack[ExchangeOptions],
    ) -> Self:
        """Make the driver with a response and a correction by name, as configurations have them.

        Parameters
        ----------
        port, identity
            As of the constructor.
        response, correction : str
            By name.
        **options
            ``timeout_s``, ``attempts``, ``patience_s`` and ``transcript`` of the constructor.

        Raises
        ------
        InputError
            If the model does not have this correction.
        """
        return cls(port, identity, response=response, correction=correction, **options)  # type: ignore[call-arg]

    @property
    def identity(self) -> MeterIdentity:
        """Model, serial number and calibration date, as given: the meter cannot report them."""
        return self._identity

    @property
    def port(self) -> str:
        """Port, as given."""
        return self._port.name

    def be_patient(self, patience_s: float) -> None:
        """Wait this long for the meter when it is lost; 0 also ends a wait."""
        self._line.patience_s = patience_s

    def open(self) -> Self:
        """Open the port exclusively, and set the meter up. Opening an open meter does nothing.

        The set-up also confirms that a meter is connected.

        Raises
        ------
        MeterNotFoundError
            If the port is absent, in use, not permitted, or not a port of a meter.
        MeterError
            As `measure`, if the meter rejects the set-up.
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

    def _ask(
        self, command: str, parse: Callable[[bytes, MeterIdentity, datetime], Reading], slow: bool = False
    ) -> Reading:
        """Send a command for a reading, and warn of one in fL or outside the range of the meter.

        `parse` gets the reply, the meter and the time.
        """
        reading = self._line.ask(command, lambda reply: parse(reply, self.identity, self._port.clock.now()))
        if reading.unit == "fL":
            _log.warning(
                "%s: the meter is set to fL: %g fL is %g cd/m²; set its unit switch to cd/m² if that is not meant",
                self.port,
                reading.value,
                reading.luminance_cd_m2,
            )
        low, high = self.data_sheet.slow_range_cd_m2 if slow else self.data_sheet.fast_range_cd_m2
        # A user's correction hides the measured value.
        measured = reading.unit != "%" and reading.correction in ("preset", None)
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


def require_correction(model: str, correction: Correction, possible: Sequence[Correction]) -> None:
    """Raise InputError unless a model can be set to a correction."""
    if correction not in possible:
        raise InputError(
            f"meter.correction is {correction!r}: a computer sets the {model} to {' or '.join(map(repr, possible))}"
        )


def find_meter_ports() -> list[ListPortInfo]:
    """Return the serial ports by name; only opening one shows whether a meter is connected.

    Examples
    --------
    >>> from labcdp.drivers import find_meter_ports
    >>> isinstance(find_meter_ports(), list)
    True
    """
    return sorted(list_ports.comports(), key=lambda port: port.device)
