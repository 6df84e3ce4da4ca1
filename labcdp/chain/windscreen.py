"""Windscreen: takes part of the light and lays a veil over the whole scene."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from .parameters import check_number
from .signal import Context, Signal

FloatArray = NDArray[np.floating[Any]]


def through_windscreen(
    luminance_cd_m2: FloatArray, transmittance: float, glare_cd_m2: float | FloatArray
) -> FloatArray:
    """Luminance behind a windscreen: transmittance * (luminance + glare); the thesis, section on the windscreen.

    The glare is its mean; the photons, scene and veil together, get their noise where the sensor collects them.

    Parameters
    ----------
    luminance_cd_m2 : ndarray of float
        Luminance in front of the windscreen.
    transmittance : float
        Fraction of the light that passes.
    glare_cd_m2 : float or ndarray
        Veiling luminance, as a luminance in front of the windscreen.

    Returns
    -------
    ndarray of float, shape as `luminance_cd_m2`
    """
    return transmittance * (luminance_cd_m2 + glare_cd_m2)


def before_windscreen(luminance_cd_m2: FloatArray, transmittance: float, glare_cd_m2: float | FloatArray) -> FloatArray:
    """Luminance in front of a windscreen from that behind it: the inverse of `through_windscreen`."""
    return luminance_cd_m2 / transmittance - glare_cd_m2


@dataclass(frozen=True)
class Windscreen:
    """A windscreen of uniform transmittance whose glare is a fraction of the mean scene luminance.

    Parameters
    ----------
    transmittance : float
        Fraction of the light that passes, above 0 up to 1.
    glare_fraction : float
        Veiling luminance over mean scene luminance, at least 0 (1.0 is 100 %).

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
        check_number("transmittance", self.transmittance, "(a fraction)", 0, 1, above=True)
        check_number("glare_fraction", self.glare_fraction, "(a fraction)", 0, 1e6)

    def glare_cd_m2(self, luminance_cd_m2: FloatArray) -> float:
        """Veiling luminance for a scene, in cd/m^2."""
        return self.glare_fraction * float(luminance_cd_m2.mean(dtype=np.float64))

    def apply(self, luminance_cd_m2: FloatArray) -> FloatArray:
        """Luminance behind the windscreen, from the scene's."""
        return through_windscreen(luminance_cd_m2, self.transmittance, self.glare_cd_m2(luminance_cd_m2))

    def invert(self, luminance_cd_m2: FloatArray, glare_cd_m2: float) -> FloatArray:
        """Luminance in front of the windscreen, from that behind it and the scene's `glare_cd_m2`."""
        return before_windscreen(luminance_cd_m2, self.transmittance, glare_cd_m2)

    def process(self, signal: Signal, _context: Context) -> Signal:
        """Luminance behind the windscreen, with its inverse."""
        glare_cd_m2 = self.glare_fraction * signal.scene_mean()
        return replace(
            signal,
            values=through_windscreen(signal.values, self.transmittance, glare_cd_m2),
            to_luminance=lambda behind: signal.to_luminance(before_windscreen(behind, self.transmittance, glare_cd_m2)),
        )


@dataclass(frozen=True)
class ThesisWindscreen(Windscreen):
    """The windscreen of the 2018 thesis, whose inverse does not quite undo it.

    It takes off glare / transmittance and does not divide by the transmittance, so a luminance L comes back as
    transmittance * L + glare * (transmittance - 1 / transmittance). The published CDP values need it.
    """

    def process(self, signal: Signal, context: Context) -> Signal:
        """Luminance behind the windscreen, with the thesis' inverse."""
        taken_off_cd_m2 = self.glare_fraction * signal.scene_mean() / self.transmittance
        behind = super().process(signal, context)
        return replace(behind, to_luminance=lambda values: signal.to_luminance(values - taken_off_cd_m2))
