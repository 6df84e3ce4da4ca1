"""References and colour correction factor of a Konica Minolta LS-100 or LS-110, read and written.

Protocol: Minolta, *LS-100/LS-110 Communication Manual*, 9222-1842-12 (2000).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import ROUND_HALF_UP, Decimal
from math import isfinite
from typing import ClassVar, Final, Literal

from ...core.errors import InputError
from ...core.reading import CD_M2_PER_FL
from ..meter import MeterProtocolError
from .protocol import NUMBER, LSDataSheet, parse_acknowledgement, raise_if_reported
from .recovery import MeterLink

_REFERENCE: Final = re.compile(rb"OK00, *([cf]), ?([ 0-9.]{6})")
_COLOUR_FACTOR: Final = re.compile(rb"OK00, *([0-9]\.[0-9]{3})")
_HIGHEST_COLOUR_FACTOR: Final = Decimal("9.999")


@dataclass(frozen=True)
class Reference:
    """A luminance in the meter's memory.

    Parameters
    ----------
    value : float
        The number as sent, in `unit`.
    unit : {'cd/m2', 'fL'}
        Unit the meter stated with it.
    """

    value: float
    unit: Literal["cd/m2", "fL"]

    @property
    def luminance_cd_m2(self) -> float:
        """The reference in cd/m^2, converted if the meter stated fL."""
        return self.value * (CD_M2_PER_FL if self.unit == "fL" else 1.0)


def parse_reference(reply: bytes) -> Reference:
    """Read the answer to ``CMR`` or ``LMR``: ``OK00,``, the unit's flag, a comma and a number of six characters.

    Parameters
    ----------
    reply : bytes
        The reply, with or without CR LF.

    Raises
    ------
    MeterReportedError
        If the reply is an error code.
    MeterProtocolError
        If it is not a reference.
    """
    reply = reply.removesuffix(b"\r\n")
    raise_if_reported(reply)
    fields = _REFERENCE.fullmatch(reply)
    number = fields and NUMBER.fullmatch(fields[2].decode("ascii"))
    if fields is None or number is None:
        raise MeterProtocolError(
            f"the meter sent {reply!r}, which is not a reference: check cable and model, then read it again"
        )
    return Reference(float(number[1]), "fL" if fields[1] == b"f" else "cd/m2")


def parse_colour_factor(reply: bytes) -> float:
    """Read the answer to ``CCR``: ``OK00,`` and the factor with three decimals.

    Parameters
    ----------
    reply : bytes
        The reply, with or without CR LF.

    Raises
    ------
    MeterReportedError
        If the reply is an error code.
    MeterProtocolError
        If it is not a factor.
    """
    reply = reply.removesuffix(b"\r\n")
    raise_if_reported(reply)
    fields = _COLOUR_FACTOR.fullmatch(reply)
    if fields is None:
        raise MeterProtocolError(
            f"the meter sent {reply!r}, which is not a colour correction factor: check cable and model, then read it "
            "again"
        )
    return float(fields[1])


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
    for place in range(-decimals, 3):
        digits = int(exact.scaleb(-place).to_integral_value(ROUND_HALF_UP))
        if digits <= 9999:
            return Decimal(digits).scaleb(place)
    return None


def reference_characters(value: float, decimals: int) -> str:
    """Format a reference for ``CMW`` or ``LMW``: six characters, of which four digits are significant.

    The manual requires six characters; they are padded with leading zeros.

    Parameters
    ----------
    value : float
        In the meter's own unit; a fifth digit is rounded, as the meter would.
    decimals : int
        Most decimals of the display.

    Raises
    ------
    InputError
        If it is not a number from the smallest the meter shows to 999900.
    """
    rounded = four_digits(value, decimals) if isfinite(value) and value > 0 else None
    if not rounded:
        raise InputError(
            f"the reference is {value}: give a number from {Decimal(1).scaleb(-decimals)} to 999900 in the meter's unit"
        )
    return f"{rounded:f}".rjust(6, "0")


def colour_factor_characters(factor: float) -> str:
    """Format a colour correction factor for ``CCW``: one digit, the point and three decimals.

    Parameters
    ----------
    factor : float
        A fourth decimal is rounded.

    Raises
    ------
    InputError
        If it is not a number from 0.001 to 9.999.
    """
    if 0 < factor < 10:
        rounded = Decimal(repr(float(factor))).quantize(Decimal("0.001"), ROUND_HALF_UP)
        if 0 < rounded <= _HIGHEST_COLOUR_FACTOR:
            return f"{rounded:f}"
    raise InputError(f"the colour correction factor is {factor}: give a number from 0.001 to 9.999")


class MemoryCommands:
    """The commands of the meter's memory; the driver inherits them."""

    data_sheet: ClassVar[LSDataSheet]
    _link: MeterLink

    def clear_memory(self) -> None:
        """Clear the meter's memory.

        Raises
        ------
        MeterError
            As `MinoltaLS.measure`.
        """
        self._link.ask("CLE", parse_acknowledgement)

    def read_full_scale(self) -> Reference:
        """Read the reference (100 %) of mode RATIO.

        Raises
        ------
        MeterError
            As `MinoltaLS.measure`; MeterReportedError if there is none.
        """
        return self._link.ask("CMR", parse_reference)

    def store_full_scale(self) -> None:
        """Store the displayed value as the reference (100 %) of mode RATIO.

        Raises
        ------
        MeterError
            As `MinoltaLS.measure`; MeterReportedError if the display shows none.
        """
        self._link.ask("CMS", parse_acknowledgement)

    def write_full_scale(self, value: float) -> float:
        """Write the reference (100 %) of mode RATIO.

        Parameters
        ----------
        value : float
            In the current unit of the meter, which `read_full_scale` and every reading state.

        Returns
        -------
        float
            The reference as written: four digits count, the fifth is rounded.

        Raises
        ------
        InputError
            If the value is not from the smallest number the meter shows to 999900; nothing is sent then.
        MeterError
            As `MinoltaLS.measure`.
        """
        return self._write("CMW", reference_characters(value, self.data_sheet.decimals))

    def read_user_reference(self) -> Reference:
        """Read the reference of the user calibration, which VARI_LUMI and VARI_CCF_LUMI use.

        Raises
        ------
        MeterError
            As `MinoltaLS.measure`; MeterReportedError if there is none.
        """
        return self._link.ask("LMR", parse_reference)

    def write_user_reference(self, value: float) -> float:
        """Write the reference of the user calibration: the luminance that the value on the display should have.

        Parameters and errors are those of `write_full_scale`.

        Returns
        -------
        float
            The reference as written.
        """
        return self._write("LMW", reference_characters(value, self.data_sheet.decimals))

    def read_colour_factor(self) -> float:
        """Read the colour correction factor, which VARI_CCF and VARI_CCF_LUMI multiply readings with.

        Raises
        ------
        MeterError
            As `MinoltaLS.measure`.
        """
        return self._link.ask("CCR", parse_colour_factor)

    def write_colour_factor(self, factor: float) -> float:
        """Write the colour correction factor.

        Parameters
        ----------
        factor : float
            From 0.001 to 9.999.

        Returns
        -------
        float
            The factor as written, with three decimals.

        Raises
        ------
        InputError
            If the factor is out of its range; nothing is sent then.
        MeterError
            As `MinoltaLS.measure`.
        """
        return self._write("CCW", colour_factor_characters(factor))

    def _write(self, command: str, number: str) -> float:
        self._link.ask(f"{command},{number}", parse_acknowledgement)
        return float(number)
