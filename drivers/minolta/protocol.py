"""Protocol of the Konica Minolta LS-100 and LS-110; pure functions and constants.

Protocol: Minolta, *LS-100/LS-110 Communication Manual*, 9222-1842-12 (2000).
"""

from __future__ import annotations

import re
from datetime import datetime
from enum import Enum
from typing import Final, Literal

from ...core.reading import LuminanceUnit, MeterIdentity, Reading
from ..meter import MeterProtocolError, MeterReportedError
from .data_sheet import MeterDataSheet


class MeterMode(Enum):
    """Modes of the meter by their number in the command ``MDS,nn``; one of each group is in force.

    PRESET to VARI_CCF_LUMI choose the correction: the maker's calibration, the colour correction factor, the user
    calibration, or both; `Reading.correction` states which. ABS and RATIO choose luminance or % of the stored
    reference; `Reading.unit` is ``%`` then. FAST and SLOW choose the response: SLOW averages longer, for light that
    flickers, and ends at a lower luminance (`MeterDataSheet`). PEAK and CONT choose whether the highest or the present
    value is given; `Reading.peak` states which.
    """

    PRESET = "00"
    VARI_CCF = "01"
    VARI_LUMI = "02"
    VARI_CCF_LUMI = "03"
    ABS = "04"
    RATIO = "05"
    FAST = "06"
    SLOW = "07"
    PEAK = "08"
    CONT = "09"


#: One mode of each group is in force.
MODE_GROUPS: Final = (
    (MeterMode.PRESET, MeterMode.VARI_CCF, MeterMode.VARI_LUMI, MeterMode.VARI_CCF_LUMI),
    (MeterMode.ABS, MeterMode.RATIO),
    (MeterMode.FAST, MeterMode.SLOW),
    (MeterMode.PEAK, MeterMode.CONT),
)


#: Modes of a meter that is switched on, one of each group.
POWER_ON: Final[tuple[MeterMode, ...]] = (MeterMode.PRESET, MeterMode.ABS, MeterMode.FAST, MeterMode.CONT)


#: Meaning and remedy of the manuals' error codes; ER12 is of the CS-100A alone.
ERROR_CODES: Final = {
    "ER00": (
        "the meter did not understand the command, or waited more than 5 s for its next character",
        "check the cable and that no other program uses the port, then repeat the command",
    ),
    "ER01": ("the meter cannot take this setting", "check the mode, reference or factor that was sent"),
    "ER10": (
        "the luminance exceeds the measuring range",
        "measure something darker, or change from SLOW to FAST, which reaches higher",
    ),
    "ER11": (
        "a value in the meter's memory cannot be used",
        "store the reference or user calibration again, or set PRESET and ABS",
    ),
    "ER12": (
        "luminance and chromaticity are outside what the display can show",
        "measure something darker, or nearer to white",
    ),
    "ER19": ("the value is too large for the display", "set PRESET and ABS, or store a larger reference"),
    "ER20": ("the meter's memory (EEPROM) is faulty", "have the meter repaired"),
    "ER30": ("the meter's battery is exhausted", "put in a new one, then switch on with F held so that it shows C"),
}
_UNKNOWN_CODE: Final = ("the manual does not know this code", "switch the meter off, and on again with F held")

#: For a meter that does not answer.
REMOTE_MODE_REMEDY: Final = (
    "check that the meter has power and shows C for remote mode (switch it off, hold F while switching it on), and "
    "check the cable"
)

_READING: Final = re.compile(rb"OK00, *([CP])([cf%])([PLKT ])([MH])([ 0-9.]{6})")
#: A number in six characters, blanks around it.
NUMBER: Final = re.compile(r" *([0-9]+\.?[0-9]*|\.[0-9]+) *")
_UNITS: Final[dict[str, LuminanceUnit]] = {"c": "cd/m2", "f": "fL", "%": "%"}
_CORRECTIONS: Final[dict[str, Literal["preset", "luminance", "colour", "both"]]] = {
    "P": "preset",
    "L": "luminance",
    "K": "colour",
    "T": "both",
}


def parse_acknowledgement(reply: bytes) -> None:
    """Accept ``OK00``.

    Parameters
    ----------
    reply : bytes
        The reply, with or without CR LF.

    Raises
    ------
    MeterReportedError
        If it is an error code.
    MeterProtocolError
        If it is another reply.
    """
    reply = reply.removesuffix(b"\r\n")
    raise_if_reported(reply)
    if reply != b"OK00":
        raise MeterProtocolError(f"the meter sent {reply!r} instead of OK00", "check cable and model, then repeat")


def parse_reading(reply: bytes, data_sheet: MeterDataSheet, meter: MeterIdentity, timestamp: datetime) -> Reading:
    """Read the answer to ``MES`` or ``DSR``: ``OK00,``, four flags and a number of six characters.

    Parameters
    ----------
    reply : bytes
        The reply, with or without CR LF.
    data_sheet : MeterDataSheet
        Accuracy of the model.
    meter : MeterIdentity
        Meter to name in the reading.
    timestamp : datetime
        Time of the reading, with time zone.

    Returns
    -------
    Reading
        In the unit the meter stated.

    Raises
    ------
    MeterReportedError
        If the reply is an error code.
    MeterProtocolError
        If it is not a reading.
    """
    reply = reply.removesuffix(b"\r\n")
    raise_if_reported(reply)
    fields = _READING.fullmatch(reply)
    number = fields and NUMBER.fullmatch(fields[5].decode("ascii"))
    if fields is None or number is None:
        raise MeterProtocolError(
            f"the meter sent {reply!r}, which is not a reading", "check cable and model, then measure again"
        )
    peak, unit_flag, correction, hold = (fields[i].decode("ascii") for i in (1, 2, 3, 4))
    value, unit, resolution = float(number[1]), _UNITS[unit_flag], data_sheet.sent_resolution(number[1])
    return Reading(
        value=value,
        unit=unit,
        resolution=resolution,
        scale_half_width_rel=data_sheet.scale_half_width_rel,
        digits_half_width=data_sheet.digit_error(value, unit) * resolution,
        repeatability_rel=data_sheet.repeatability_rel,
        peak=peak == "P",
        correction=_CORRECTIONS.get(correction),
        held=hold == "H",
        meter=meter,
        timestamp=timestamp,
        raw=reply.decode("ascii"),
    )


def raise_if_reported(reply: bytes) -> None:
    """Raise MeterReportedError if a reply, without its CR LF, is an error code."""
    if re.fullmatch(rb"ER[0-9]{2}", reply):
        code = reply.decode("ascii")
        raise MeterReportedError(code, *ERROR_CODES.get(code, _UNKNOWN_CODE))
