"""Tables of light by DN: from the parameters of a camera, or relative to the end of the scale of DN."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import inf
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ....core.frame import Frame
from ....core.luminance import CommonError, Invalid
from ....files.formats.colour import Encoding, decoded_table
from .dn_light import DnLight

if TYPE_CHECKING:
    from .camera_specification import CameraSpecification

#: Variance of rounding in squares of the step (EMVA 1288 Release 3.1, section 2.2).
_ROUNDING_VARIANCE = 1 / 12


@dataclass(frozen=True)
class _Setting:
    """Properties of a frame, other than its pixels, that determine the light of its DN."""

    bit_depth: int
    saturation_dn: float
    nominal_black_dn: float
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
        Of any camera; its black level is subtracted.
    encoding : {'linear', 'srgb'}
        How its DN are encoded.
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
        How its DN are encoded.
    f_number : float or None
        The f-number that was set, if known; None for that of the specification.
    """
    return _specified(specification, _Setting.of(frame), encoding, f_number)


@lru_cache(maxsize=16)
def _relative(setting: _Setting, encoding: Encoding) -> DnLight:
    n = 2**setting.bit_depth
    linear = np.arange(n) / n if encoding == "linear" else decoded_table(setting.bit_depth, encoding)
    black = np.interp(setting.nominal_black_dn, np.arange(linear.size), linear)
    steps = _steps(linear)
    noise = np.sqrt(_ROUNDING_VARIANCE) * steps
    light = (linear - black).astype(np.float32)
    return DnLight(light, noise.astype(np.float32), steps.astype(np.float32), setting.saturated)


@lru_cache(maxsize=16)
def _specified(
    specification: CameraSpecification, setting: _Setting, encoding: Encoding, f_number: float | None
) -> DnLight:
    top_dn = 2**specification.adc_bits - 1
    linear = decoded_table(setting.bit_depth, encoding)
    black_dn = specification.black_dn
    if black_dn is None:
        black_dn = top_dn * float(np.interp(setting.nominal_black_dn, np.arange(linear.size), linear))
    k_dn_per_e = specification.system_gain_dn_per_e(setting.gain_db)
    dark_e = specification.dark_electrons(setting.exposure_s, setting.temperature_c)
    per_cd_m2 = specification.electrons_per_cd_m2_s(f_number) * setting.exposure_s
    per_cd_m2 *= specification.windscreen_transmittance
    dn = top_dn * linear
    # Photons and dark electrons are one Poisson process.
    noise_e2 = np.maximum((dn - black_dn) / k_dn_per_e, 0) + specification.read_noise_e**2
    noise_e2 += _ROUNDING_VARIANCE * np.square(top_dn * _steps(linear) / k_dn_per_e)
    flags = setting.saturated
    if specification.saturation_dn is not None:
        flags[dn >= specification.saturation_dn] |= Invalid.SATURATED.value
    zero_dn = black_dn + dark_e * k_dn_per_e
    vignetting = specification.optics(f_number).vignetting(specification.pixel_pitch_m)
    light = _proportional(linear, zero_dn, top_dn, top_dn / (k_dn_per_e * per_cd_m2), encoding)
    # Where pixels differ by more than their DN, no contrast lies exactly on an end of the interval.
    place_matters = vignetting is not None or specification.glare_fraction > 0
    return DnLight(
        light=light.astype(np.float32) if place_matters else light,
        noise=(np.sqrt(noise_e2) / per_cd_m2).astype(np.float32),
        steps=_steps(light).astype(np.float32),
        flags=flags,
        vignetting=vignetting,
        glare_fraction=specification.glare_fraction,
        common=(CommonError("guessed camera parameters", inf),),
    )


def _proportional(
    linear: NDArray[np.float64], zero_dn: float, top_dn: int, light_at_top: float, encoding: Encoding
) -> NDArray[np.float64]:
    """Light by DN, 0 at `zero_dn` of a scale that ends at `top_dn` with this light above that of 0.

    The light of linear DN is their exact multiple: the contrast of two integers that lies on an end of the interval
    stays there. For that the factor has the 24 bits of a float32, which leaves enough of the 53 for the DN.
    """
    if encoding != "linear":
        return (linear - zero_dn / top_dn) * light_at_top
    last = linear.size - 1
    zero = zero_dn if last == top_dn else zero_dn / top_dn * last
    return (np.arange(linear.size, dtype=np.float64) - zero) * float(np.float32(light_at_top / last))


def _steps(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """Difference of light from a DN to the next, by DN."""
    return np.gradient(linear) if linear.size > 1 else np.ones(1)
