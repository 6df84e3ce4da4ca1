"""A simulated Konica Minolta LS-100 or LS-110: a command in, its reply out.

Protocol: Minolta, *LS-100/LS-110 Communication Manual*, 9222-1842-12 (2000). `PtyMeter` puts it on a port.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from typing import Final, Literal

import numpy as np

from ....core.errors import InputError
from ....core.reading import CD_M2_PER_FL
from ...minolta_ls.memory import four_digits
from ...minolta_ls.protocol import LS110, MODE_GROUPS, SIMULATED_COMMAND, SIMULATED_REPLY, LSDataSheet, MeterMode
from .pty import Fault, PtyMeter

__all__ = ["EXACT", "Fault", "MeterErrorModel", "PtyMeter", "SimulatedLS", "format_number"]

_CRLF: Final = b"\r\n"
_POWER_ON: Final = frozenset({MeterMode.PRESET, MeterMode.ABS, MeterMode.FAST, MeterMode.CONT})
_CORRECTION_FLAGS: Final = {
    MeterMode.PRESET: "P",
    MeterMode.VARI_LUMI: "L",
    MeterMode.VARI_CCF: "K",
    MeterMode.VARI_CCF_LUMI: "T",
}
_SIX_CHARACTERS: Final = re.compile(r"(?=.{6}$) *([0-9]+\.?[0-9]*|\.[0-9]+)")


@dataclass(frozen=True)
class MeterErrorModel:
    """Errors of a simulated meter in addition to its rounding to four digits.

    Parameters
    ----------
    scale_rel : float
        Relative error of this device's scale, the same for each of its readings: 0.01 reads 1 % too much.
    repeatability_rel : float
        Relative standard deviation from reading to reading (normal).
    seed : int
        Random seed of the repeatability.

    Raises
    ------
    InputError
        If a value is not finite, the scale error is -1 or below, or the repeatability is negative.
    """

    scale_rel: float = 0.0
    repeatability_rel: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        if not (isfinite(self.scale_rel) and self.scale_rel > -1):
            raise InputError(f"scale_rel is {self.scale_rel}: give a fraction above -1, 0.01 for 1 % too much")
        if not (isfinite(self.repeatability_rel) and self.repeatability_rel >= 0):
            raise InputError(f"repeatability_rel is {self.repeatability_rel}: give a fraction of at least 0")


#: A meter without errors other than rounding.
EXACT: Final = MeterErrorModel()


def format_number(value: float, decimals: int) -> str | None:
    """Format a number like the meter: at most four digits in six characters.

    Parameters
    ----------
    value : float
        At least 0.
    decimals : int
        Most decimals of the display.

    Returns
    -------
    str or None
        Six characters, padded with blanks on the left: ``  0.05``, `` 83.02``, ``748000``; None if the number does
        not fit. The last digit is rounded half up.
    """
    number = four_digits(value, decimals)
    return None if number is None else f"{number:f}".rjust(6)


class _RefusedError(Exception):
    """The meter answers with an error code, the argument."""


@dataclass(frozen=True)
class _Held:
    """The displayed value: as detected, as corrected, and the reply with it."""

    seen_cd_m2: float
    corrected_cd_m2: float
    reply: str


class SimulatedLS:
    """The meter without a port, with the manual's commands MES DSR MDS CLE CMR CMS CMW LMR LMW CCR CCW.

    Parameters
    ----------
    luminance : callable
        Returns the luminance in the meter's field, in cd/m^2; called once for each MES.
    data_sheet : LSDataSheet
        The model.
    errors : MeterErrorModel
        How it errs.
    unit : {'cd/m2', 'fL'}
        Position of the unit switch; the attribute may be changed at any time.

    Attributes
    ----------
    remote : bool
        Whether the meter is in remote mode; without, it is silent.

    Notes
    -----
    Behaviour not specified by the manual, on which a driver should not rely: What was never measured or stored is
    answered with ER11, a reference or factor of zero with ER01. The user calibration is the reference over the
    luminance held when it is written, or 1 if none is. CLE forgets both references and sets the colour correction
    factor to 1. A single measurement has no other peak than its value. Dark signal reads 0.
    """

    def __init__(
        self,
        luminance: Callable[[], float],
        data_sheet: LSDataSheet = LS110,
        errors: MeterErrorModel = EXACT,
        unit: Literal["cd/m2", "fL"] = "cd/m2",
    ) -> None:
        self.unit = unit
        self.remote = True
        self._luminance = luminance
        self._data_sheet = data_sheet
        self._errors = errors
        self._rng = np.random.default_rng(errors.seed)
        self._modes = _POWER_ON
        self._held: _Held | None = None
        self._clear_memory()
        self._plain: dict[str, Callable[[], str]] = {
            "MES": self._measure,
            "DSR": lambda: self._display().reply,
            "CLE": self._clear_memory,
            "CMR": lambda: self._tell(self._full_scale_cd_m2),
            "CMS": self._store_full_scale,
            SIMULATED_COMMAND: lambda: SIMULATED_REPLY.decode("ascii").strip(),
            "LMR": lambda: self._tell(self._user_reference_cd_m2),
            "CCR": lambda: f"OK00,{self._colour_factor:.3f}",
        }
        self._with_parameter: dict[str, tuple[re.Pattern[str], Callable[[str], str]]] = {
            "MDS": (re.compile(r"(0[0-9])"), self._set_mode),
            "CMW": (_SIX_CHARACTERS, self._write_full_scale),
            "LMW": (_SIX_CHARACTERS, self._write_user_reference),
            "CCW": (re.compile(r"([0-9]\.[0-9]{3})"), self._write_colour_factor),
        }

    def answer(self, command: bytes) -> bytes:
        """Execute one command.

        Parameters
        ----------
        command : bytes
            With its CR LF; without, it is an incomplete command.

        Returns
        -------
        bytes
            The reply with CR LF: ``OK00`` and data, or an error code; empty out of remote mode.
        """
        if not self.remote:
            return b""
        try:
            reply = self._execute(command)
        except _RefusedError as refused:
            reply = str(refused)
        return reply.encode("ascii") + _CRLF

    def _execute(self, command: bytes) -> str:
        if not (command.endswith(_CRLF) and command.isascii()):
            raise _RefusedError("ER00")
        name, comma, parameter = command.removesuffix(_CRLF).decode("ascii").partition(",")
        if not comma and name in self._plain:
            return self._plain[name]()
        if comma and name in self._with_parameter:
            pattern, carry_out = self._with_parameter[name]
            if match := pattern.fullmatch(parameter):
                return carry_out(match[1])
        raise _RefusedError("ER00")

    def _measure(self) -> str:
        luminance = float(self._luminance())
        if not (isfinite(luminance) and luminance >= 0):
            raise InputError(f"the simulated meter is pointed at {luminance} cd/m^2: give a number of at least 0")
        noise = self._errors.repeatability_rel * self._rng.standard_normal()
        seen = max(0.0, luminance * (1 + self._errors.scale_rel) * (1 + noise))
        sheet = self._data_sheet
        _, highest = sheet.slow_range_cd_m2 if MeterMode.SLOW in self._modes else sheet.fast_range_cd_m2
        if seen > highest:
            raise _RefusedError("ER10")
        corrected = seen * self._correction_factor()
        if MeterMode.RATIO in self._modes:
            number, unit_flag = 100 * corrected / self._stored(self._full_scale_cd_m2), "%"
        else:
            number, unit_flag = corrected / self._cd_m2_per_unit, self._unit_flag
        reply = f"OK00,{self._peak_flag}{unit_flag}{self._correction_flag}H{self._formatted(number)}"
        self._held = _Held(seen, corrected, reply)
        return reply

    @property
    def _cd_m2_per_unit(self) -> float:
        return CD_M2_PER_FL if self.unit == "fL" else 1.0

    @property
    def _unit_flag(self) -> str:
        return "f" if self.unit == "fL" else "c"

    @property
    def _peak_flag(self) -> str:
        return "P" if MeterMode.PEAK in self._modes else "C"

    @property
    def _correction_flag(self) -> str:
        if MeterMode.RATIO in self._modes:
            return " "
        return next(flag for mode, flag in _CORRECTION_FLAGS.items() if mode in self._modes)

    def _correction_factor(self) -> float:
        factor = 1.0
        if self._modes & {MeterMode.VARI_CCF, MeterMode.VARI_CCF_LUMI}:
            factor *= self._colour_factor
        if self._modes & {MeterMode.VARI_LUMI, MeterMode.VARI_CCF_LUMI}:
            self._stored(self._user_reference_cd_m2)
            factor *= self._user_factor
        return factor

    def _formatted(self, number: float) -> str:
        text = format_number(number, self._data_sheet.decimals)
        if text is None:
            raise _RefusedError("ER19")
        return text

    def _stored(self, reference: float | None) -> float:
        if reference is None:
            raise _RefusedError("ER11")
        return reference

    def _display(self) -> _Held:
        if self._held is None:
            raise _RefusedError("ER11")
        return self._held

    def _tell(self, reference_cd_m2: float | None) -> str:
        number = self._stored(reference_cd_m2) / self._cd_m2_per_unit
        return f"OK00,{self._unit_flag},{self._formatted(number)}"

    def _to_store(self, number: float) -> float:
        """Check and round a number like the meter before storing it: four digits, the fifth rounded."""
        text = format_number(number, self._data_sheet.decimals)
        if text is None or float(text) == 0:
            raise _RefusedError("ER01")
        return float(text) * self._cd_m2_per_unit

    def _set_mode(self, number: str) -> str:
        mode = MeterMode(number)
        group = next(group for group in MODE_GROUPS if mode in group)
        self._modes = self._modes.difference(group) | {mode}
        return "OK00"

    def _clear_memory(self) -> str:
        self._full_scale_cd_m2: float | None = None
        self._user_reference_cd_m2: float | None = None
        self._user_factor = 1.0
        self._colour_factor = 1.0
        return "OK00"

    def _store_full_scale(self) -> str:
        self._full_scale_cd_m2 = self._to_store(self._display().corrected_cd_m2 / self._cd_m2_per_unit)
        return "OK00"

    def _write_full_scale(self, number: str) -> str:
        self._full_scale_cd_m2 = self._to_store(float(number))
        return "OK00"

    def _write_user_reference(self, number: str) -> str:
        self._user_reference_cd_m2 = self._to_store(float(number))
        if self._held is not None and self._held.seen_cd_m2 > 0:
            self._user_factor = self._user_reference_cd_m2 / self._held.seen_cd_m2
        return "OK00"

    def _write_colour_factor(self, number: str) -> str:
        if float(number) == 0:
            raise _RefusedError("ER01")
        self._colour_factor = float(number)
        return "OK00"
