"""Tables of light by DN: from the parameters of a camera, or relative to the end of the scale of DN."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import inf

import numpy as np
from numpy.typing import NDArray

from ..frame import Frame
from ..luminance import CommonError, Invalid
from ..sources.colour import decoded_table
from ..sources.stored_image import Encoding
from .camera_specification import CameraSpecification
from .dn_light import DnLight

#: Variance of rounding in squares of the step (EMVA 1288 Release 3.1, section 2.2).
_ROUNDING_VARIANCE = 1 / 12


@dataclass(frozen=True)
class _Setting:
    """What of a frame, beside its pixels, matters for the light of its DN."""

    bit_depth: int
    saturation_dn: float
    black_level_dn: float
    exposure_s: float
    gain_db: float
    temperature_c: float | None

    @classmethod
    def of(cls, frame: Frame) -> _Setting:
        return cls(*(getattr(frame, name) for name in cls.__dataclass_fields__))

    @property
    def saturated(self) -> NDArray[np.uint8]:
        """Flags of saturation by DN."""
        dn = np.arange(2**self.bit_depth)
        return np.where(dn >= self.saturation_dn, Invalid.SATURATED, 0).astype(np.uint8)


def relative_light(frame: Frame, encoding: Encoding) -> DnLight:
    """Light of a frame's DN relative to the end of their scale; its noise is taken to be that of rounding.

    Linear DN are divided by 2 to the power of their bits, which is exact in float32: the contrast of two integers that
    lies on an end of the interval stays there. The highest DN is just below 1. Decoded sRGB is 1 at the highest DN.

    Parameters
    ----------
    frame : Frame
        Of any camera; its black level is taken off.
    encoding : {'linear', 'srgb'}
        How its DN follow light.
    """
    return _relative(_Setting.of(frame), encoding)


def specified_light(
    specification: CameraSpecification, frame: Frame, encoding: Encoding, f_number: float | None
) -> DnLight:
    """Luminance of a frame's DN by guessed parameters; what is left uncertain is not known, so stated as infinite.

    The mean DN of a pixel is black + K t (E L + mu_d) with E photo-electrons per second and cd/m^2; of L the windscreen
    passes its transmittance. (Where it must divide by pixel area, exposure, quantum efficiency and optics, the program
    of the 2018 thesis multiplies.) DN of another depth than the converter's are spread over its range.

    Parameters
    ----------
    specification : CameraSpecification
        The parameters.
    frame : Frame
        Exposure, gain, and temperature where it is known.
    encoding : {'linear', 'srgb'}
        How its DN follow light.
    f_number : float or None
        The f-number that was set, if known; None for that of the specification.
    """
    return _specified(specification, _Setting.of(frame), encoding, f_number)


@lru_cache(maxsize=16)
def _relative(setting: _Setting, encoding: Encoding) -> DnLight:
    n = 2**setting.bit_depth
    linear = np.arange(n) / n if encoding == "linear" else decoded_table(setting.bit_depth, encoding)
    black = np.interp(setting.black_level_dn, np.arange(linear.size), linear)
    noise = np.sqrt(_ROUNDING_VARIANCE) * _steps(linear)
    return DnLight((linear - black).astype(np.float32), noise.astype(np.float32), setting.saturated)


@lru_cache(maxsize=16)
def _specified(
    specification: CameraSpecification, setting: _Setting, encoding: Encoding, f_number: float | None
) -> DnLight:
    top_dn = 2**specification.adc_bits - 1
    linear = decoded_table(setting.bit_depth, encoding)
    dn = top_dn * linear
    black_dn = specification.black_dn
    if black_dn is None:
        black_dn = top_dn * float(np.interp(setting.black_level_dn, np.arange(linear.size), linear))
    k_dn_per_e = specification.system_gain_dn_per_e(setting.gain_db)
    electrons = (dn - black_dn) / k_dn_per_e
    dark_e = specification.dark_electrons(setting.exposure_s, setting.temperature_c)
    per_cd_m2 = specification.electrons_per_cd_m2_s(f_number) * setting.exposure_s
    per_cd_m2 *= specification.windscreen_transmittance
    # Photons and dark electrons are one Poisson process.
    noise_e2 = np.maximum(electrons, 0) + specification.read_noise_e**2
    noise_e2 += _ROUNDING_VARIANCE * np.square(top_dn * _steps(linear) / k_dn_per_e)
    flags = setting.saturated
    if specification.saturation_dn is not None:
        flags[dn >= specification.saturation_dn] |= Invalid.SATURATED.value
    return DnLight(
        light=((electrons - dark_e) / per_cd_m2).astype(np.float32),
        noise=(np.sqrt(noise_e2) / per_cd_m2).astype(np.float32),
        flags=flags,
        vignetting=specification.optics(f_number).vignetting(specification.pixel_pitch_m),
        glare_fraction=specification.glare_fraction,
        common=(CommonError("guessed camera parameters", inf),),
    )


def _steps(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """Difference of light from a DN to the next, by DN."""
    return np.gradient(linear) if linear.size > 1 else np.ones(1)
