"""Konica Minolta CS-100A chroma meter over RS-232C.

Error codes and delimiters: Minolta, *CS-100A Communication Manual*, pages 6 and 12. The form of a reply to MES is that
of public programs for the meter (``cs100a.m`` of Mcalibrator2, ``minolta.py`` of PsychoPy): ``OK00,``, a sign and six
characters of the luminance, and a sign and four decimals each of x and y, 28 bytes with CR LF. The meter must be in
remote mode: switch it off and hold F while switching it on; it then shows "C".
"""

from __future__ import annotations

import logging
import re
from datetime import datetime
from typing import Final, Unpack

from ...core.errors import InputError
from ...core.reading import LuminanceUnit, MeterIdentity, Reading, is_chromaticity
from ..meter import MeterProtocolError, MeterReportedError
from .data_sheet import CS100A
from .line import LineProtocol
from .meter import Correction, ExchangeOptions, Response, SerialMeter, require_correction
from .port import Port
from .protocol import NUMBER, REMOTE_MODE_REMEDY, parse_acknowledgement, raise_if_reported

_log = logging.getLogger(__name__)

#: Of the command MDS: the maker's calibration or the user's, chromaticity and no difference, the response.
_MODES: Final = {"preset": "00", "both": "01"}
_ABSOLUTE, _FAST, _SLOW = "04", "06", "07"

_READING: Final = re.compile(rb"(OK00|OK11|OK13), *([-+ ]?)([ 0-9.]{6}), *([-+ ]?)([ .0-9]{5}), *([-+ ]?)([ .0-9]{5})")
_TOO_BRIGHT: Final = (
    "the luminance is too large for the display",
    "measure something darker, or set the response to fast, which reaches higher",
)
_NEGATIVE: Final = (
    "a negative value, as of a difference from its target colour",
    "set the meter to the absolute mode, or switch it off, and on again with F held",
)


def parse_chroma_reading(reply: bytes, unit: LuminanceUnit, meter: MeterIdentity, timestamp: datetime) -> Reading:
    """Read the answer of a CS-100A to ``MES``.

    Parameters
    ----------
    reply : bytes
        The reply, with or without CR LF.
    unit : {'cd/m2', 'fL'}
        Position of the unit switch, which the reply does not tell.
    meter : MeterIdentity
        Meter to name in the reading.
    timestamp : datetime
        Time of the reading, with time zone.

    Returns
    -------
    Reading
        Without chromaticity if the meter says that it is out of range (OK11), or that the luminance is below the range
        of its display (OK13), where x and y mean little.

    Raises
    ------
    MeterReportedError
        If the reply is an error code, or says that the luminance is too large (OK12).
    MeterProtocolError
        If it is not a reading.
    """
    reply = reply.removesuffix(b"\r\n")
    raise_if_reported(reply)
    if reply.startswith(b"OK12,"):
        raise MeterReportedError("OK12", *_TOO_BRIGHT)
    fields = _READING.fullmatch(reply)
    numbers = [] if fields is None else [NUMBER.fullmatch(fields[i].decode("ascii")) for i in (3, 5, 7)]
    if fields is None or None in numbers:
        raise MeterProtocolError(
            f"the meter sent {reply!r}, which is not a reading", "check cable and model, then measure again"
        )
    if b"-" in (fields[2], fields[4], fields[6]):
        raise MeterProtocolError(f"the meter sent {reply!r}, {_NEGATIVE[0]}", _NEGATIVE[1])
    (number, x, y) = (match[1] for match in numbers if match is not None)
    value, resolution = float(number), CS100A.sent_resolution(number)
    has_colour = fields[1] == b"OK00" and is_chromaticity(float(x), float(y))
    return Reading(
        value=value,
        unit=unit,
        resolution=resolution,
        scale_half_width_rel=CS100A.scale_half_width_rel,
        digits_half_width=CS100A.digit_error(value, unit) * resolution,
        repeatability_rel=CS100A.repeatability_rel,
        peak=False,
        correction=None,
        held=True,
        meter=meter,
        timestamp=timestamp,
        raw=reply.decode("ascii"),
        chromaticity=(float(x), float(y)) if has_colour else None,
    )


class MinoltaCS100A(SerialMeter):
    """Konica Minolta CS-100A chroma meter, acceptance angle 1 degree; a `Meter`.

    Parameters
    ----------
    port, identity
        As of `SerialMeter`.
    response : {'fast', 'slow'}
        SLOW averages longer, for light that flickers.
    correction : {'preset', 'both'}
        The maker's calibration, or the user's of luminance and chromaticity (VARI).
    unit : {'cd/m2', 'fL'}
        Position of the meter's unit switch: its replies do not state the unit.
    **options
        ``timeout_s`` (6 s), ``attempts``, ``patience_s`` and ``transcript``, as of `SerialMeter`.

    Raises
    ------
    InputError
        If a number is out of its range, or the meter has no such correction or unit.

    Examples
    --------
    >>> from labcdp.drivers import MinoltaCS100A
    >>> MinoltaCS100A("/dev/ttyUSB0").identity.model
    'CS-100A'
    """

    data_sheet = CS100A

    def __init__(
        self,
        port: str | Port,
        identity: MeterIdentity | None = None,
        *,
        response: Response = "fast",
        correction: Correction = "preset",
        unit: LuminanceUnit = "cd/m2",
        **options: Unpack[ExchangeOptions],
    ) -> None:
        require_correction("CS-100A", correction, ("preset", "both"))
        if unit not in ("cd/m2", "fL"):
            raise InputError(f"unit is {unit!r}: give 'cd/m2' or 'fL', as the meter's switch is set")
        self._unit, self._slow = unit, response == "slow"
        modes = (_MODES[correction], _ABSOLUTE, _SLOW if self._slow else _FAST)
        commands = tuple(f"MDS,{mode}" for mode in modes)
        super().__init__(port, identity, LineProtocol(commands, parse_acknowledgement, REMOTE_MODE_REMEDY), **options)

    def measure(self) -> Reading:
        """Take one reading of luminance and chromaticity.

        Raises
        ------
        MeterReportedError
            If the meter answers with an error code, or its display cannot show the luminance.
        MeterTimeoutError
            If it does not answer in time or completely.
        MeterProtocolError
            If the answer is not a reading, or is a difference.
        MeterLostError
            If the connection was lost; the port is then closed.
        MeterError
            If the meter is not open.
        """
        reading = self._ask(
            "MES", lambda reply, meter, now: parse_chroma_reading(reply, self._unit, meter, now), self._slow
        )
        if reading.raw.startswith("OK13"):
            _log.warning("%s: the light is below the range of the meter's display (%s)", self.port, reading.raw)
        return reading
