"""Meters behind a program that answers on a port: LS-150, LS-160, CS-150, CS-160, and a meter of one's own.

Konica Minolta publishes no serial protocol for these models, only a library for Windows (LC-MISDK). The lines spoken
here are those of a public program on top of it, cs150server (H. Ban, https://github.com/hiroshiban), which a relay such
as ncat puts on a port: each command ends with CR LF and is answered with one line.

======================  ==================================================================
``CONNECT``             ``SUCCESS,`` and a text
``INTEG AUTO``          ``SUCCESS,`` and a text; also with a number of seconds for ``AUTO``
``MEASURE``             ``SUCCESS,`` luminance in cd/m^2 ``,`` x ``,`` y
any                     ``ERROR,`` and a reason
======================  ==================================================================

A luminance meter's program may leave x and y out.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from datetime import datetime
from math import inf, isfinite
from typing import Any, ClassVar, Final, Unpack

from ...core.reading import MeterIdentity, Reading, is_chromaticity
from ..meter import MeterLostError, MeterProtocolError, MeterReportedError
from .data_sheet import CS150, CS160, LS150, LS160, MeterDataSheet
from .line import LineProtocol
from .meter import Correction, ExchangeOptions, Response, SerialMeter, require_correction
from .port import Port

#: Integration of the slow response, in seconds: whole periods of mains light at 50 and 60 Hz.
_SLOW_S: Final = 1.0
_NO_RANGE: Final = (0.0, inf)
_ALL_DIGITS: Final = 15
_NUMBER: Final = re.compile(r"[-+]?[0-9]+(?:\.[0-9]*)?(?:[eE][-+]?[0-9]{1,2})?")
_SILENCE: Final = (
    "check that the program of the meter runs and listens there, and that the meter is connected to its computer"
)


def parse_program_reading(
    reply: bytes,
    data_sheet: MeterDataSheet,
    meter: MeterIdentity,
    timestamp: datetime,
    *,
    digits: int | None = None,
) -> Reading:
    """Read the answer to ``MEASURE``.

    Parameters
    ----------
    reply : bytes
        The reply, with or without its line end.
    data_sheet : MeterDataSheet
        Accuracy of the model.
    meter : MeterIdentity
        Meter to name in the reading.
    timestamp : datetime
        Time of the reading, with time zone.
    digits : int or None
        Bound of the digit error in units of the last digit sent; None for that of the data sheet, in units of the last
        digit shown: programs of meters drop zeros at the end and add digits.

    Returns
    -------
    Reading
        In cd/m²; with chromaticity if x and y were sent and can be coordinates.

    Raises
    ------
    MeterReportedError
        If the program reports an error.
    MeterLostError
        If it has no meter.
    MeterProtocolError
        If the reply is not a reading.
    """
    text = _text(reply)
    _raise_if_reported(text)
    fields = [field.strip() for field in text.split(",")[1:]]
    numbers = [float(field) for field in fields if _NUMBER.fullmatch(field)]
    if not text.startswith("SUCCESS,") or len(numbers) < len(fields) or len(fields) not in (1, 3):
        comma = len(fields) > 3 and len(numbers) == len(fields)
        remedy = (
            "its numbers have a decimal comma: set a point in the regional settings of its computer"
            if comma
            else "check which program listens there, then measure again"
        )
        raise MeterProtocolError(f"the program sent {reply!r}, which is not a reading", remedy)
    value, *xy = numbers
    if not (isfinite(value) and value >= 0):
        raise MeterProtocolError(f"the program sent {reply!r}", "a luminance is at least 0: check the meter")
    if digits is None:
        resolution, digits = data_sheet.shown_resolution(value), data_sheet.digit_error(value, "cd/m2")
    else:
        resolution = data_sheet.sent_resolution(fields[0])
    return Reading(
        value=value,
        unit="cd/m2",
        resolution=resolution,
        scale_half_width_rel=data_sheet.scale_half_width_rel,
        digits_half_width=digits * resolution,
        repeatability_rel=data_sheet.repeatability_rel,
        peak=False,
        correction=None,
        held=True,
        meter=meter,
        timestamp=timestamp,
        raw=text,
        chromaticity=(xy[0], xy[1]) if xy and is_chromaticity(*xy) else None,
    )


def _text(reply: bytes) -> str:
    return reply.removesuffix(b"\n").removesuffix(b"\r").decode("ascii", "backslashreplace")


def _raise_if_reported(text: str) -> None:
    if text.startswith("ERROR"):
        reason = text.partition(",")[2].strip() or "no reason is given"
        if reason == "Not connected":
            raise MeterLostError("the program has no meter", "check the cable of the meter, and that it is switched on")
        raise MeterReportedError("ERROR", reason, "see the display of the meter and its program")


def _parse_acknowledgement(reply: bytes) -> None:
    """Accept ``SUCCESS,`` and a text; a number there is a late reading."""
    text = _text(reply)
    _raise_if_reported(text)
    word, _, rest = text.partition(",")
    if word != "SUCCESS" or _NUMBER.fullmatch(rest.partition(",")[0].strip()):
        raise MeterProtocolError(
            f"the program sent {reply!r} instead of SUCCESS and a text", "check which program listens there"
        )


class ProgramMeter(SerialMeter):
    """Base class of the meters behind a program that answers CONNECT, INTEG and MEASURE; use a model.

    Parameters
    ----------
    port, identity
        As of `SerialMeter`; the port is usually one of the network, ``socket://HOST:PORT``.
    response : {'fast', 'slow'}
        Integration as the meter chooses, or over 1 s, for light that flickers.
    correction : {'preset'}
        Others are set at the meter.
    **options
        ``timeout_s`` (30 s: an automatic measurement in the dark takes some), ``attempts``, ``patience_s`` and
        ``transcript``, as of `SerialMeter`.

    Raises
    ------
    InputError
        If a number is out of its range, or another correction is given.
    """

    settings: ClassVar[Mapping[str, Any]] = {"baudrate": 9600}
    longest_reply_s: ClassVar[float] = 30.0
    _digits: int | None = None

    def __init__(
        self,
        port: str | Port,
        identity: MeterIdentity | None = None,
        *,
        response: Response = "fast",
        correction: Correction = "preset",
        **options: Unpack[ExchangeOptions],
    ) -> None:
        require_correction(self.data_sheet.model, correction, ("preset",))
        integration = f"{_SLOW_S:g}" if response == "slow" else "AUTO"
        self._slow = response == "slow"
        protocol = LineProtocol(("CONNECT", f"INTEG {integration}"), _parse_acknowledgement, _SILENCE, b"\n", 512)
        super().__init__(port, identity, protocol, **options)

    def measure(self) -> Reading:
        """Take one reading.

        Raises
        ------
        MeterReportedError
            If the program reports an error.
        MeterTimeoutError
            If it does not answer in time or completely.
        MeterProtocolError
            If the answer is not a reading.
        MeterLostError
            If the connection was lost, or the program has no meter.
        MeterError
            If the meter is not open.
        """
        return self._ask(
            "MEASURE",
            lambda reply, meter, now: parse_program_reading(reply, self.data_sheet, meter, now, digits=self._digits),
            self._slow,
        )


class MinoltaLS150(ProgramMeter):
    """Konica Minolta LS-150, acceptance angle 1 degree, behind its program. Parameters as of `ProgramMeter`.

    Examples
    --------
    >>> from labcdp.drivers import MinoltaLS150
    >>> MinoltaLS150("socket://192.168.0.7:7000").identity.model
    'LS-150'
    """

    data_sheet = LS150


class MinoltaLS160(ProgramMeter):
    """Konica Minolta LS-160, acceptance angle 1/3 degree, behind its program. Parameters as of `ProgramMeter`.

    Examples
    --------
    >>> from labcdp.drivers import MinoltaLS160
    >>> MinoltaLS160("socket://192.168.0.7:7000").identity.model
    'LS-160'
    """

    data_sheet = LS160


class MinoltaCS150(ProgramMeter):
    """Konica Minolta CS-150 chroma meter, 1 degree, behind its program. Parameters as of `ProgramMeter`.

    Examples
    --------
    >>> from labcdp.drivers import MinoltaCS150
    >>> MinoltaCS150("socket://192.168.0.7:7000").identity.model
    'CS-150'
    """

    data_sheet = CS150


class MinoltaCS160(ProgramMeter):
    """Konica Minolta CS-160 chroma meter, 1/3 degree, behind its program. Parameters as of `ProgramMeter`.

    Examples
    --------
    >>> from labcdp.drivers import MinoltaCS160
    >>> MinoltaCS160("socket://192.168.0.7:7000").identity.model
    'CS-160'
    """

    data_sheet = CS160


class OwnProgramMeter(ProgramMeter):
    """A meter of one's own behind a program that answers CONNECT, INTEG and MEASURE; a `Meter`.

    Parameters
    ----------
    port, response, correction, **options
        As of `ProgramMeter`.
    identity : MeterIdentity
        Model and serial number.
    scale_half_width_rel, repeatability_rel : float
        Accuracy by its data sheet or certificate, as of `MeterDataSheet`.
    digits : int
        Bound of the digit error, in units of the last digit that the program sends.

    Examples
    --------
    >>> from labcdp.core.reading import MeterIdentity
    >>> from labcdp.drivers.minolta.program import OwnProgramMeter
    >>> stated = {"scale_half_width_rel": 0.03, "repeatability_rel": 0.002, "digits": 1}
    >>> OwnProgramMeter("socket://192.168.0.7:7000", MeterIdentity("L 1009", "4711"), **stated).identity.model
    'L 1009'
    """

    def __init__(
        self,
        port: str | Port,
        identity: MeterIdentity,
        *,
        scale_half_width_rel: float,
        repeatability_rel: float,
        digits: int,
        **options: Any,
    ) -> None:
        # What the program sends counts: no range is known, and no digit is one too many.
        accuracy = (0.0, scale_half_width_rel, repeatability_rel, _ALL_DIGITS)
        self.data_sheet = MeterDataSheet(identity.model, _NO_RANGE, _NO_RANGE, _ALL_DIGITS, *accuracy)  # type: ignore[misc]
        self._digits = digits
        super().__init__(port, identity, **options)
