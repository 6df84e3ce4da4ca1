"""Konica Minolta LS-100 and LS-110 luminance meters over RS-232C.

Protocol: Minolta, *LS-100/LS-110 Communication Manual*, 9222-1842-12 (2000). The meter must be in remote mode:
switch it off and hold F while switching it on; it then shows "C".
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Self, Unpack

from ...core.reading import MeterIdentity, Reading
from ..meter import require_mode
from .data_sheet import LS100, LS110
from .line import LineProtocol
from .meter import Correction, ExchangeOptions, Response, SerialMeter
from .port import Port
from .protocol import (
    MODE_GROUPS,
    POWER_ON,
    REMOTE_MODE_REMEDY,
    MeterMode,
    parse_acknowledgement,
    parse_reading,
)

#: Correction of the readings in each of the first modes.
_CORRECTIONS: Final[dict[MeterMode, Correction]] = {
    MeterMode.PRESET: "preset",
    MeterMode.VARI_CCF: "colour",
    MeterMode.VARI_LUMI: "luminance",
    MeterMode.VARI_CCF_LUMI: "both",
}
_MODES: Final = {correction: mode for mode, correction in _CORRECTIONS.items()}


class MinoltaLS(SerialMeter):
    """Base class of both models; use `MinoltaLS100` or `MinoltaLS110`, which have their data sheets.

    Parameters
    ----------
    port, identity
        As of `SerialMeter`. `NamedPort` uses the RTS and CTS lines of the cable LS-A12.
    modes : sequence of MeterMode
        Set on opening, since the meter cannot report them; PRESET, ABS, FAST and CONT in the groups that it leaves out.
    **options
        ``timeout_s`` (6 s: the meter itself gives up after 5 s), ``attempts``, ``patience_s`` and ``transcript``, as of
        `SerialMeter`.

    Raises
    ------
    InputError
        If a number is out of its range.
    """

    def __init__(
        self,
        port: str | Port,
        identity: MeterIdentity | None = None,
        *,
        modes: Sequence[MeterMode] = (),
        **options: Unpack[ExchangeOptions],
    ) -> None:
        self._modes = POWER_ON
        for mode in modes:
            self._modes = tuple(
                mode if mode in group else former for group, former in zip(MODE_GROUPS, self._modes, strict=True)
            )
        commands = tuple(f"MDS,{mode.value}" for mode in self._modes)
        super().__init__(port, identity, LineProtocol(commands, parse_acknowledgement, REMOTE_MODE_REMEDY), **options)

    @classmethod
    def configured(
        cls,
        port: str | Port,
        identity: MeterIdentity | None = None,
        *,
        response: Response = "fast",
        correction: Correction = "preset",
        modes: Sequence[MeterMode] = (),
        **options: Unpack[ExchangeOptions],
    ) -> Self:
        """Make the driver with a response and a correction by name, and further modes."""
        return cls(port, identity, modes=(_MODES[correction], MeterMode[response.upper()], *modes), **options)

    @property
    def modes(self) -> tuple[MeterMode, ...]:
        """The mode of each group as set by this driver; empty if the meter is not open.

        The meter cannot report its modes, and its keys change them unnoticed.
        """
        return self._modes if self._line.is_open else ()

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
        slow = MeterMode.SLOW in self._modes
        return self._ask(command, lambda reply, meter, now: parse_reading(reply, self.data_sheet, meter, now), slow)


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
