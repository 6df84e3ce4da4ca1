"""Windscreen: takes part of the light and lays a veil over the whole scene."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from .parameters import check_flag, check_number
from .signal import Context, Signal

FloatArray = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Windscreen:
    """A windscreen of uniform transmittance whose glare is a fraction of the mean scene luminance.

    Behind it is transmittance * (luminance + glare); the thesis, section on the windscreen. The photons, scene and veil
    together, get their noise where the sensor collects them.

    Parameters
    ----------
    transmittance : float
        Fraction of the light that passes, above 0 up to 1.
    glare_fraction : float
        Veiling luminance, as a luminance in front of the windscreen, over mean scene luminance, at least 0 (1.0 is
        100 %).
    glare_subtracted : bool
        Whether the inverse subtracts the mean glare, as a camera can that knows it. Otherwise the glare stays in the
        measured luminance and lowers the contrast.

    Raises
    ------
    InputError
        If a value is out of its range.
    """

    takes: ClassVar[str] = "luminance"
    gives: ClassVar[str] = "luminance"

    transmittance: float
    glare_fraction: float = 0.0
    glare_subtracted: bool = False

    def __post_init__(self) -> None:
        check_number("transmittance", self.transmittance, "(a fraction)", 0, 1, above=True)
        check_number("glare_fraction", self.glare_fraction, "(a fraction; 1.0 is 100 %)", 0, 10)
        check_flag("glare_subtracted", self.glare_subtracted)

    def apply(self, luminance_cd_m2: FloatArray) -> FloatArray:
        """Luminance behind the windscreen, from that of a whole scene in front of it."""
        glare_cd_m2 = self.glare_fraction * float(luminance_cd_m2.mean(dtype=np.float64))
        return self.transmittance * (luminance_cd_m2 + glare_cd_m2)

    def process(self, signal: Signal, _context: Context) -> Signal:
        """Luminance behind the windscreen, with its inverse."""
        glare_cd_m2 = self.glare_fraction * signal.scene_mean()
        subtracted_cd_m2 = glare_cd_m2 if self.glare_subtracted else 0.0
        return replace(
            signal,
            values=self.transmittance * (signal.values + glare_cd_m2),
            to_luminance=lambda behind: signal.to_luminance(behind / self.transmittance - subtracted_cd_m2),
        )


@dataclass(frozen=True)
class ThesisWindscreen:
    """The windscreen of the 2018 thesis, whose inverse subtracts the glare and does not quite undo the loss.

    It takes off glare / transmittance and does not divide by the transmittance, so a luminance L comes back as
    transmittance * L + glare * (transmittance - 1 / transmittance). The published CDP values need it.

    Parameters
    ----------
    transmittance, glare_fraction : float
        As those of `Windscreen`.

    Raises
    ------
    InputError
        If a value is out of its range.
    """

    takes: ClassVar[str] = "luminance"
    gives: ClassVar[str] = "luminance"

    transmittance: float
    glare_fraction: float = 0.0

    def __post_init__(self) -> None:
        Windscreen(self.transmittance, self.glare_fraction)

    def process(self, signal: Signal, context: Context) -> Signal:
        """Luminance behind the windscreen, with the thesis' inverse."""
        taken_off_cd_m2 = self.glare_fraction * signal.scene_mean() / self.transmittance
        behind = Windscreen(self.transmittance, self.glare_fraction).process(signal, context)
        return replace(behind, to_luminance=lambda values: signal.to_luminance(values - taken_off_cd_m2))
