"""Protocol and accuracy of the Konica Minolta LS-100 and LS-110; pure functions and constants.

Protocol: Minolta, *LS-100/LS-110 Communication Manual*, 9222-1842-12 (2000).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import datetime
from decimal import ROUND_HALF_UP, Decimal
from enum import Enum
from math import floor, log10
from typing import Final, Literal

from ...core.reading import LuminanceUnit, MeterIdentity, Reading
from ..meter import MeterProtocolError, MeterReportedError, MeterTimeoutError


class MeterMode(Enum):
    """Modes of the meter by their number in the command ``MDS,nn``; one of each group is in force.

    PRESET to VARI_CCF_LUMI choose the correction: the maker's calibration, the colour correction factor, the user
    calibration, or both; `Reading.correction` states which. ABS and RATIO choose luminance or % of the stored
    reference; `Reading.unit` is ``%`` then. FAST and SLOW choose the response: SLOW averages longer, for light that
    flickers, and ends at a lower luminance (`LSDataSheet`). PEAK and CONT choose whether the highest or the present
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


@dataclass(frozen=True)
class LSDataSheet:
    """Range and accuracy of a model.

    Source: Konica Minolta's data sheet of the LS-100 and LS-110, from memory; prefer the certificate of the
    meter at hand. The accuracy is stated for shown values in cd/m^2 and in fL alike.

    Parameters
    ----------
    model : str
        Name of the model.
    fast_range_cd_m2, slow_range_cd_m2 : (float, float)
        Lowest and highest luminance with FAST and with SLOW response.
    decimals : int
        Most decimals of the display, which has at most four digits.
    two_digits_below : float
        Displayed value above which the digit error is +-1 digit; below, it is +-2 digits.
    scale_half_width_rel : float
        Bound of the scale error, as a fraction.
    repeatability_rel : float
        Repeatability, as a fraction; the data sheet adds +-1 digit, which the digit error covers.
    """

    model: str
    fast_range_cd_m2: tuple[float, float]
    slow_range_cd_m2: tuple[float, float]
    decimals: int
    two_digits_below: float
    scale_half_width_rel: float = 0.02
    repeatability_rel: float = 0.002

    def digit_error(self, value: float, unit: LuminanceUnit) -> int:
        """Bound of the digit error in digits; for a ratio, which hides the luminance, the larger one."""
        return 2 if unit == "%" or value < self.two_digits_below else 1

    def shown_resolution(self, value: float) -> float:
        """Value of the last digit the meter shows for a luminance of at least 0."""
        fourth = floor(log10(value)) - 3 if value > 0 else -self.decimals
        return float(Decimal(1).scaleb(max(fourth, -self.decimals)))


#: Acceptance angle 1 degree; +-2 digits from 0.001 to 0.999.
LS100: Final = LSDataSheet("LS-100", (0.001, 299_900.0), (0.001, 49_990.0), 3, 1.0)
#: Acceptance angle 1/3 degree; +-2 digits from 0.01 to 9.99.
LS110: Final = LSDataSheet("LS-110", (0.01, 999_900.0), (0.01, 499_900.0), 2, 10.0)

#: Meaning and remedy of the manual's error codes.
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
    "ER19": ("the value is too large for the display", "set PRESET and ABS, or store a larger reference"),
    "ER20": ("the meter's memory (EEPROM) is faulty", "have the meter repaired"),
    "ER30": ("the meter's battery is exhausted", "put in a new one, then switch on with F held so that it shows C"),
}
_UNKNOWN_CODE: Final = ("the manual does not know this code", "switch the meter off, and on again with F held")

#: In bytes; the longest reply of the manual has 17.
LONGEST_REPLY: Final = 64
#: Not of the manual: asks the simulated meter what it is. A real one answers ER00.
SIMULATED_COMMAND: Final = "SIM"
SIMULATED_REPLY: Final = b"OK00,labcdp\r\n"

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


def parse_reading(reply: bytes, data_sheet: LSDataSheet, meter: MeterIdentity, timestamp: datetime) -> Reading:
    """Read the answer to ``MES`` or ``DSR``: ``OK00,``, four flags and a number of six characters.

    Parameters
    ----------
    reply : bytes
        The reply, with or without CR LF.
    data_sheet : LSDataSheet
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
    value, unit, resolution = float(number[1]), _UNITS[unit_flag], _resolution(number[1])
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


def require_whole(port: str, reply: bytes, command: str, allowed_s: float) -> None:
    """Raise a specific error if the reply to a command does not end with CR LF within the time allowed."""
    if reply.endswith(b"\r\n"):
        return
    if len(reply) >= LONGEST_REPLY:
        raise MeterProtocolError(
            f"{port}: {command} was answered with {reply!r} and no CR LF", "check that the meter is on this port"
        )
    if reply:
        raise MeterTimeoutError(
            f"{port}: the answer to {command} stopped after {len(reply)} bytes ({reply!r}) and did not continue within "
            f"{allowed_s:.3g} s",
            "check the cable, then repeat",
        )
    raise MeterTimeoutError(
        f"{port}: no answer to {command} within {allowed_s:.3g} s",
        "check that the meter has power and shows C for "
        "remote mode (switch it off, hold F while switching it on), and check the cable",
    )


def raise_if_reported(reply: bytes) -> None:
    """Raise MeterReportedError if a reply, without its CR LF, is an error code."""
    if re.fullmatch(rb"ER[0-9]{2}", reply):
        code = reply.decode("ascii")
        raise MeterReportedError(code, *ERROR_CODES.get(code, _UNKNOWN_CODE))


def _resolution(number: str) -> float:
    """Value of the last digit as sent, but not finer than the fourth significant digit.

    The manual's samples fill all six characters (``125.35``, ``748000``), but the meter shows four digits, and a digit
    of the data sheet's accuracy is the last one shown. The zeros at the end of ``748000`` are placeholders (resolution
    100); a fifth digit is finer than the stated accuracy (``125.35``: 0.1); a number of fewer digits is used as sent
    (``0.05``: 0.01).
    """
    sent = Decimal(number)
    last_place = sent.as_tuple().exponent
    assert isinstance(last_place, int)  # it is a letter only for NaN and infinity
    return float(Decimal(1).scaleb(max(last_place, sent.adjusted() - 3)))


def four_digits(value: float, decimals: int) -> Decimal | None:
    """Round a number like the meter: to four digits, half up.

    Parameters
    ----------
    value : float
        At least 0.
    decimals : int
        Most decimals of the display.

    Returns
    -------
    Decimal or None
        None if the number is larger than 999900, the largest of four digits in six characters.
    """
    exact = Decimal(repr(float(value)))
    for exponent in range(-decimals, 3):
        digits = int(exact.scaleb(-exponent).to_integral_value(ROUND_HALF_UP))
        if digits <= 9999:
            return Decimal(digits).scaleb(exponent)
    return None
