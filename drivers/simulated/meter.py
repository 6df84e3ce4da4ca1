"""Errors of a simulated meter, and its replies as an LS-100 or LS-110 gives them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal
from math import isfinite
from typing import Final, Literal

import numpy as np

from ...core.errors import InputError
from ...core.reading import CD_M2_PER_FL
from ..minolta_ls.protocol import (
    LS110,
    MODE_GROUPS,
    POWER_ON,
    SIMULATED_COMMAND,
    SIMULATED_REPLY,
    LSDataSheet,
    MeterMode,
    four_digits,
)
from .noise import announced, running
from .port import CRLF

_CORRECTION_FLAGS: Final = {MeterMode.PRESET: "P", MeterMode.VARI_CCF: "K"}
#: Modes that need what is stored in the memory, which is empty.
_NEEDS_MEMORY: Final = {MeterMode.VARI_LUMI, MeterMode.VARI_CCF_LUMI, MeterMode.RATIO}


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


def _seen_cd_m2(luminance: Callable[[], float], errors: MeterErrorModel, key: tuple[int, ...]) -> float:
    """Luminance in the meter's field with the errors of the meter."""
    cd_m2 = float(luminance())
    if not (isfinite(cd_m2) and cd_m2 >= 0):
        raise InputError(f"the simulated meter is pointed at {cd_m2} cd/m²: give a number of at least 0")
    drawn = np.random.default_rng(np.random.SeedSequence(errors.seed, spawn_key=key))
    return max(0.0, cd_m2 * (1 + errors.scale_rel) * (1 + errors.repeatability_rel * drawn.standard_normal()))


class SimulatedDisplay:
    """An instrument without an interface, whose display a person reads off.

    Parameters
    ----------
    luminance : callable
        Returns the luminance in the meter's field, in cd/m^2.
    errors : MeterErrorModel
        Errors of the display.
    """

    def __init__(self, luminance: Callable[[], float], errors: MeterErrorModel) -> None:
        self._luminance = luminance
        self._errors = errors
        self._keys = running()

    def announce(self, series: str, number: int) -> None:
        """Let the next measurement have the noise of a reading in a series."""
        self._keys = announced(f"{series}, reading {number}", 0)

    def shown(self) -> str:
        """Measure, and return what the display shows: cd/m² with four digits."""
        seen_cd_m2 = _seen_cd_m2(self._luminance, self._errors, next(self._keys))
        return f"{Decimal(f'{seen_cd_m2:.4g}'):f}"


class SimulatedLS:
    """The meter without a port, with the manual's commands MES, DSR and MDS.

    Parameters
    ----------
    luminance : callable
        Returns the luminance in the meter's field, in cd/m^2; called once for each MES.
    data_sheet : LSDataSheet
        The model.
    errors : MeterErrorModel
        Errors of the meter.

    Attributes
    ----------
    unit : {'cd/m2', 'fL'}
        Position of the unit switch.
    remote : bool
        Whether the meter is in remote mode; without, it is silent.

    Notes
    -----
    Its memory is empty: the colour correction factor is 1, and modes that need a reference are answered with ER11, as
    is DSR before the first measurement. A single measurement has no other peak than its value. Dark signal reads 0.
    """

    def __init__(
        self,
        luminance: Callable[[], float],
        data_sheet: LSDataSheet = LS110,
        errors: MeterErrorModel = MeterErrorModel(),
    ) -> None:
        self.unit: Literal["cd/m2", "fL"] = "cd/m2"
        self.remote = True
        self._luminance = luminance
        self._data_sheet = data_sheet
        self._errors = errors
        self._keys = running()
        self._modes = POWER_ON
        self._held = "ER11"

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
        return self._execute(command).encode("ascii") + CRLF if self.remote else b""

    def announce(self, series: str, number: int) -> None:
        """Let the next measurement have the noise of a reading in a series."""
        self._keys = announced(f"{series}, reading {number}", 0)

    def _execute(self, command: bytes) -> str:
        words = command.removesuffix(CRLF).decode("ascii", "replace") if command.endswith(CRLF) else ""
        if words == "MES":
            return self._measure()
        if words == "DSR":
            return self._held
        if words == SIMULATED_COMMAND:
            return SIMULATED_REPLY.decode("ascii").strip()
        for group in MODE_GROUPS:
            for mode in group:
                if words == f"MDS,{mode.value}":
                    self._modes = tuple(mode if old in group else old for old in self._modes)
                    return "OK00"
        return "ER00"

    def _measure(self) -> str:
        seen = _seen_cd_m2(self._luminance, self._errors, next(self._keys))
        sheet = self._data_sheet
        _, highest = sheet.slow_range_cd_m2 if MeterMode.SLOW in self._modes else sheet.fast_range_cd_m2
        if seen > highest:
            return "ER10"
        if not _NEEDS_MEMORY.isdisjoint(self._modes):
            return "ER11"
        peak = "P" if MeterMode.PEAK in self._modes else "C"
        unit, cd_m2_per_unit = ("f", CD_M2_PER_FL) if self.unit == "fL" else ("c", 1.0)
        correction = _CORRECTION_FLAGS[self._modes[0]]
        number = four_digits(seen / cd_m2_per_unit, sheet.decimals)
        if number is None:
            return "ER19"
        # Six characters, padded with blanks on the left.
        self._held = f"OK00,{peak}{unit}{correction}H{number:>6f}"
        return self._held
