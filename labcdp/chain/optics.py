"""Optics: from the luminance of the scene to the illuminance on the sensor."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..luminance import Cos4Vignetting
from .parameters import check_number

FloatArray = NDArray[np.floating[Any]]


def axial_illuminance_per_cd_m2(f_number: float, transmittance: float, magnification: float) -> float:
    """Illuminance in lux on the optical axis for 1 cd/m^2: pi t / (4 N^2 (1 + m)).

    Equation 3.1 of the thesis with theta = 0. With N = 1 / (2 sin(theta')), the f-number of a lens that obeys
    the sine condition, pi / (4 N^2) is exact for a distant scene. The form pi / (1 + 4 N^2) takes N for a
    tangent; at f/1.4 the exact one is 13 % larger.

    Parameters
    ----------
    f_number : float
        N.
    transmittance : float
        t, fraction of the light the lens passes.
    magnification : float
        m, image size over object size; 0 for a distant scene.
    """
    return pi * transmittance / (4 * f_number**2 * (1 + magnification))


@dataclass(frozen=True)
class Optics:
    """A lens centred on the sensor: equation 3.1 of the thesis, E = L t pi cos^4(theta) / (4 N^2 (1 + m)).

    Parameters
    ----------
    f_number : float
        N, 0.5 to 128; a lens in air cannot be below 0.5.
    transmittance : float
        t, fraction of the light the lens passes, above 0 up to 1.
    focal_length_m : float
        Focal length in metres; with the pixel pitch it gives theta.
    magnification : float
        m, image size over object size, at least 0; 0 for a distant scene.

    Raises
    ------
    InputError
        If a value is out of its range.
    """

    f_number: float
    transmittance: float
    focal_length_m: float
    magnification: float = 0.0

    def __post_init__(self) -> None:
        check_number("f_number", self.f_number, "", 0.5, 128)
        check_number("transmittance", self.transmittance, "(a fraction)", 0, 1, above=True)
        check_number("focal_length_m", self.focal_length_m, "m", 0, above=True)
        check_number("magnification", self.magnification, "(image over object)", 0)

    @property
    def axial_illuminance_per_cd_m2(self) -> float:
        """Illuminance in lux on the axis for 1 cd/m^2."""
        return axial_illuminance_per_cd_m2(self.f_number, self.transmittance, self.magnification)

    def vignetting(self, pixel_pitch_m: float) -> Cos4Vignetting:
        """Fall-off cos^4(theta) on a sensor; the image lies f (1 + m) behind a thin lens."""
        return Cos4Vignetting(self.focal_length_m * (1 + self.magnification), pixel_pitch_m)

    def apply(self, luminance_cd_m2: FloatArray, pixel_pitch_m: float) -> FloatArray:
        """Illuminance in lux on each pixel, shape (height, width), from the luminance it sees."""
        return luminance_cd_m2 * self._slope(luminance_cd_m2, pixel_pitch_m)

    def invert(self, illuminance_lx: FloatArray, pixel_pitch_m: float) -> FloatArray:
        """Luminance in cd/m^2 each pixel sees, shape (height, width), from the illuminance on it."""
        return illuminance_lx / self._slope(illuminance_lx, pixel_pitch_m)

    def _slope(self, like: FloatArray, pixel_pitch_m: float) -> FloatArray:
        height, width = like.shape
        slope = self.vignetting(pixel_pitch_m).relative_illuminance((height, width))
        slope *= self.axial_illuminance_per_cd_m2
        return slope.astype(like.dtype, copy=False)
