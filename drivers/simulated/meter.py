"""Errors of a simulated meter, and its replies as each model gives them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal
from math import isfinite
from typing import Final, Literal

import numpy as np

from ...core.errors import InputError
from ...core.reading import CD_M2_PER_FL
from ..minolta.data_sheet import CS100A, CS150, LS110, MeterDataSheet
from ..minolta.line import CRLF, SIMULATED_COMMAND, SIMULATED_NAME
from ..minolta.protocol import MODE_GROUPS, POWER_ON, MeterMode
from .noise import announced, running

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
    lag : float
        Share of each reading that is the one before, as of a meter that settles slowly.

    Raises
    ------
    InputError
        If a value is not finite, the scale error is -1 or below, the repeatability is negative, or the lag is not a
        fraction below 1.
    """

    scale_rel: float = 0.0
    repeatability_rel: float = 0.0
    seed: int = 0
    lag: float = 0.0

    def __post_init__(self) -> None:
        if not (isfinite(self.scale_rel) and self.scale_rel > -1):
            raise InputError(f"scale_rel is {self.scale_rel}: give a fraction above -1, 0.01 for 1 % too much")
        if not (isfinite(self.repeatability_rel) and self.repeatability_rel >= 0):
            raise InputError(f"repeatability_rel is {self.repeatability_rel}: give a fraction of at least 0")
        if not 0 <= self.lag < 1:
            raise InputError(f"lag is {self.lag}: give a fraction of at least 0 and below 1")


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


class SimulatedMeter:
    """A meter without a port: what the simulated meters of all models share.

    Parameters
    ----------
    luminance : callable
        Returns the luminance in the meter's field, in cd/m^2; called once for each measurement.
    data_sheet : MeterDataSheet
        The model.
    errors : MeterErrorModel
        Errors of the meter.
    chromaticity : callable or None
        Returns x and y of the light in the meter's field; None for a luminance meter.

    Attributes
    ----------
    unit : {'cd/m2', 'fL'}
        Position of the unit switch.
    remote : bool
        Whether the meter is in remote mode; without, it is silent.
    """

    def __init__(
        self,
        luminance: Callable[[], float],
        data_sheet: MeterDataSheet,
        errors: MeterErrorModel = MeterErrorModel(),
        chromaticity: Callable[[], tuple[float, float]] | None = None,
    ) -> None:
        self.unit: Literal["cd/m2", "fL"] = "cd/m2"
        self.remote = True
        self._luminance = luminance
        self._data_sheet = data_sheet
        self._errors = errors
        self._chromaticity = chromaticity
        self._keys = running()
        self._before_cd_m2: float | None = None

    def answer(self, command: bytes) -> bytes:
        """Execute one command.

        Parameters
        ----------
        command : bytes
            With its CR LF; without, it is an incomplete command.

        Returns
        -------
        bytes
            The reply with CR LF; empty out of remote mode.
        """
        return self._execute(command).encode("ascii") + CRLF if self.remote else b""

    def announce(self, series: str, number: int) -> None:
        """Let the next measurement have the noise of a reading in a series."""
        self._keys = announced(f"{series}, reading {number}", 0)

    def _execute(self, command: bytes) -> str:
        """Return the reply to a command, without CR LF."""
        raise NotImplementedError

    def _measured_cd_m2(self) -> float:
        """Measure once: the luminance with the errors of the meter, partly that of the measurement before."""
        seen = _seen_cd_m2(self._luminance, self._errors, next(self._keys))
        if self._before_cd_m2 is not None:
            seen += self._errors.lag * (self._before_cd_m2 - seen)
        self._before_cd_m2 = seen
        return seen

    def _xy(self) -> tuple[float, float]:
        """Chromaticity of the light, or that of equal energy."""
        return (1 / 3, 1 / 3) if self._chromaticity is None else self._chromaticity()


def _words(command: bytes) -> str:
    """Return a whole command without its CR LF, an incomplete one as an empty text."""
    return command.removesuffix(CRLF).decode("ascii", "replace") if command.endswith(CRLF) else ""


class SimulatedLS(SimulatedMeter):
    """The LS-100 or LS-110 without a port, with the manual's commands MES, DSR and MDS. Parameters as above.

    Notes
    -----
    Its memory is empty: the colour correction factor is 1, and modes that need a reference are answered with ER11, as
    is DSR before the first measurement. A single measurement has no other peak than its value. Dark signal reads 0.
    """

    def __init__(
        self,
        luminance: Callable[[], float],
        data_sheet: MeterDataSheet = LS110,
        errors: MeterErrorModel = MeterErrorModel(),
    ) -> None:
        super().__init__(luminance, data_sheet, errors)
        self._modes = POWER_ON
        self._held = "ER11"

    def _execute(self, command: bytes) -> str:
        words = _words(command)
        if words == "MES":
            return self._measure()
        if words == "DSR":
            return self._held
        if words == SIMULATED_COMMAND:
            return f"OK00,{SIMULATED_NAME.decode('ascii')}"
        for group in MODE_GROUPS:
            for mode in group:
                if words == f"MDS,{mode.value}":
                    self._modes = tuple(mode if old in group else old for old in self._modes)
                    return "OK00"
        return "ER00"

    def _measure(self) -> str:
        seen = self._measured_cd_m2()
        sheet = self._data_sheet
        _, highest = sheet.slow_range_cd_m2 if MeterMode.SLOW in self._modes else sheet.fast_range_cd_m2
        if seen > highest:
            return "ER10"
        if not _NEEDS_MEMORY.isdisjoint(self._modes):
            return "ER11"
        peak = "P" if MeterMode.PEAK in self._modes else "C"
        unit, cd_m2_per_unit = ("f", CD_M2_PER_FL) if self.unit == "fL" else ("c", 1.0)
        correction = _CORRECTION_FLAGS[self._modes[0]]
        number = sheet.display(seen / cd_m2_per_unit)
        if number is None:
            return "ER19"
        # Six characters, padded with blanks on the left.
        self._held = f"OK00,{peak}{unit}{correction}H{number:>6f}"
        return self._held


class SimulatedCS100A(SimulatedMeter):
    """The CS-100A without a port, with the commands MES and MDS. Parameters as of `SimulatedMeter`.

    Notes
    -----
    Its modes are 00 and 01 (calibration), 04 and 05 (absolute and difference), 06 and 07 (response). Its memory is
    empty: differences are answered with ER11. Below the display's first digit it answers OK13.
    """

    _GROUPS: Final = (("00", "01"), ("04", "05"), ("06", "07"))

    def __init__(
        self,
        luminance: Callable[[], float],
        data_sheet: MeterDataSheet = CS100A,
        errors: MeterErrorModel = MeterErrorModel(),
        chromaticity: Callable[[], tuple[float, float]] | None = None,
    ) -> None:
        super().__init__(luminance, data_sheet, errors, chromaticity)
        self._modes: tuple[str, ...] = ("00", "04", "06")

    def _execute(self, command: bytes) -> str:
        words = _words(command)
        if words == "MES":
            return self._measure()
        if words == SIMULATED_COMMAND:
            return f"OK00,{SIMULATED_NAME.decode('ascii')}"
        for group in self._GROUPS:
            if words.startswith("MDS,") and words[4:] in group:
                self._modes = tuple(words[4:] if old in group else old for old in self._modes)
                return "OK00"
        return "ER00"

    def _measure(self) -> str:
        seen, sheet = self._measured_cd_m2(), self._data_sheet
        lowest, highest = sheet.slow_range_cd_m2 if "07" in self._modes else sheet.fast_range_cd_m2
        if "05" in self._modes:
            return "ER11"
        x, y = (f"+{coordinate:.4f}".replace("0.", ".", 1) for coordinate in self._xy())
        number = sheet.display(seen / (CD_M2_PER_FL if self.unit == "fL" else 1.0))
        if number is None or seen > highest:
            return f"OK12,-999999,{x},{y}"
        return f"{'OK13' if seen < lowest else 'OK00'},+{number:>6f},{x},{y}"


class SimulatedProgram(SimulatedMeter):
    """The program of an LS-150, LS-160, CS-150 or CS-160, with CONNECT, INTEG and MEASURE; parameters as above.

    Attributes
    ----------
    connected : bool
        Whether CONNECT was sent; a meter that was switched off is not connected.
    """

    def __init__(
        self,
        luminance: Callable[[], float],
        data_sheet: MeterDataSheet = CS150,
        errors: MeterErrorModel = MeterErrorModel(),
        chromaticity: Callable[[], tuple[float, float]] | None = None,
    ) -> None:
        super().__init__(luminance, data_sheet, errors, chromaticity)
        self.connected = False

    def _execute(self, command: bytes) -> str:
        word, _, argument = _words(command).partition(" ")
        if word == "CONNECT":
            text = "Already connected" if self.connected else f"Connected to {self._data_sheet.model}"
            self.connected = True
            return f"SUCCESS,{text}"
        if word == SIMULATED_COMMAND:
            return f"SUCCESS,{SIMULATED_NAME.decode('ascii')}"
        if word not in ("MEASURE", "INTEG"):
            return "ERROR,Unknown command"
        if not self.connected:
            return "ERROR,Not connected"
        return self._measure() if word == "MEASURE" else self._integrate(argument)

    def _integrate(self, argument: str) -> str:
        known = argument.upper() == "AUTO" or argument.replace(".", "", 1).isdecimal()
        return "SUCCESS,Integration time set" if known else "ERROR,Invalid time value. It must be 'AUTO' or a number."

    def _measure(self) -> str:
        seen = self._measured_cd_m2()
        if seen > self._data_sheet.fast_range_cd_m2[1]:
            return "ERROR,Measure command failed"
        number = self._data_sheet.display(seen) or seen
        colour = "" if self._chromaticity is None else "".join(f",{coordinate:.4f}" for coordinate in self._xy())
        return f"SUCCESS,{float(number):.6g}{colour}"
