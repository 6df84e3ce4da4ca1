"""Optics: from the luminance of the scene to the illuminance on the sensor."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.vignetting import Cos4Vignetting
from .parameters import check_number
from .signal import Context, Signal

FloatArray = NDArray[np.floating[Any]]


def axial_illuminance_per_cd_m2(f_number: float, transmittance: float, magnification: float) -> float:
    """Illuminance in lux on the optical axis for 1 cd/m^2: pi t / (4 N^2 (1 + m)^2).

    With N = 1 / (2 sin(theta')), the f-number of a lens that obeys the sine condition, pi / (4 N^2) is exact for a
    distant scene. The form pi / (1 + 4 N^2) takes N for a tangent; at f/1.4 the exact one is 13 % larger. The image of
    a near scene lies 1 + m times as far behind a symmetric lens, so the working f-number is N (1 + m) (S. F. Ray,
    Applied Photographic Optics). Equation 3.1 of the thesis prints (1 + m) without the square; its values have m = 0.

    Parameters
    ----------
    f_number : float
        N.
    transmittance : float
        t, fraction of the light the lens passes.
    magnification : float
        m, image size over object size; 0 for a distant scene.
    """
    return pi * transmittance / (4 * (f_number * (1 + magnification)) ** 2)


@dataclass(frozen=True)
class Optics:
    """A symmetric lens centred on the sensor: E = L t pi cos^4(theta) / (4 N^2 (1 + m)^2).

    Equation 3.1 of the thesis, but with the square that it lacks (see `axial_illuminance_per_cd_m2`).

    Parameters
    ----------
    f_number : float
        N, 0.5 to 128; a lens in air cannot be below 0.5.
    transmittance : float
        t, fraction of the light the lens passes, above 0 up to 1.
    focal_length_m : float or None
        Focal length in metres; with the pixel pitch it gives theta. None for theta = 0 everywhere, a lens without
        vignetting.
    magnification : float
        m, image size over object size, at least 0; 0 for a distant scene.

    Raises
    ------
    InputError
        If a value is out of its range.
    """

    takes: ClassVar[str] = "luminance"
    gives: ClassVar[str] = "illuminance"

    f_number: float
    transmittance: float
    focal_length_m: float | None = None
    magnification: float = 0.0

    def __post_init__(self) -> None:
        check_number("f_number", self.f_number, "", 0.5, 128)
        check_number("transmittance", self.transmittance, "(a fraction)", 0, 1, above=True)
        if self.focal_length_m is not None:
            check_number("focal_length_m", self.focal_length_m, "m", 1e-4, 100)
        check_number("magnification", self.magnification, "(image over object)", 0, 1e3)

    @property
    def axial_illuminance_per_cd_m2(self) -> float:
        """Illuminance in lux on the axis for 1 cd/m^2."""
        return axial_illuminance_per_cd_m2(self.f_number, self.transmittance, self.magnification)

    def vignetting(self, pixel_pitch_m: float) -> Cos4Vignetting | None:
        """Vignetting cos^4(theta) on a sensor, or None; the image lies f (1 + m) behind a thin lens."""
        if self.focal_length_m is None:
            return None
        return Cos4Vignetting(self.focal_length_m * (1 + self.magnification), pixel_pitch_m)

    def apply(self, luminance_cd_m2: FloatArray, pixel_pitch_m: float) -> FloatArray:
        """Illuminance in lux on each pixel, shape (height, width), from the luminance it sees."""
        return luminance_cd_m2 * self._slope(luminance_cd_m2, pixel_pitch_m)

    def invert(self, illuminance_lx: FloatArray, pixel_pitch_m: float) -> FloatArray:
        """Luminance in cd/m^2 each pixel sees, shape (height, width), from the illuminance on it."""
        return illuminance_lx / self._slope(illuminance_lx, pixel_pitch_m)

    def process(self, signal: Signal, context: Context) -> Signal:
        """Illuminance on the sensor, with its inverse; levels of a scene are taken as on the axis.

        Raises
        ------
        InputError
            If the vignetting needs the pixel pitch of a sensor and there is none.
        """
        axial = self.axial_illuminance_per_cd_m2
        pitch_m = context.pixel_pitch_m
        if signal.shares is not None or self.focal_length_m is None:
            return replace(
                signal,
                values=signal.values * axial,
                quantity="illuminance",
                to_luminance=lambda illuminance_lx: signal.to_luminance(illuminance_lx / axial),
            )
        if pitch_m is None:
            raise InputError(
                f"focal_length_m is {self.focal_length_m:g} m, but no sensor tells the pixel pitch: add a "
                "sensor, or leave focal_length_m out"
            )
        return replace(
            signal,
            values=self.apply(signal.values, pitch_m),
            quantity="illuminance",
            # The map of the vignetting is made anew each time instead of being kept.
            to_luminance=lambda illuminance_lx: signal.to_luminance(self.invert(illuminance_lx, pitch_m)),
        )

    def _slope(self, like: FloatArray, pixel_pitch_m: float) -> FloatArray:
        vignetting = self.vignetting(pixel_pitch_m)
        if vignetting is None:
            return np.full(like.shape, self.axial_illuminance_per_cd_m2, like.dtype)
        slope = vignetting.relative_illuminance((like.shape[0], like.shape[1]))
        slope *= self.axial_illuminance_per_cd_m2
        return slope.astype(like.dtype, copy=False)
