"""Conversion of DN to luminance by a table, for a camera specification or relative values."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, reduce
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.companding import Companding
from ...core.dn import look_up
from ...core.frame import DnLevels, Frame, luminance_pixels
from ...core.luminance import WHOLE, CommonError, Invalid, LuminanceMap, Window
from ...core.vignetting import AssumedVignetting, Cos4Vignetting
from ...files.transfer import Encoding, decoded_table

if TYPE_CHECKING:
    from .camera_specification import CameraSpecification


#: Source of the errors by a vignetting that was not measured.
ASSUMED = "assumed vignetting"
_Maps = NDArray[np.float32]
_Light = NDArray[np.float32] | NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LightTable:
    """Light of each DN; of more than 16 bits, of each that a frame has: by `Frame.levels`.

    Parameters
    ----------
    light : ndarray of float32 or float64, shape (n,)
        Light by DN, on the optical axis, as seen through the windscreen but divided by its transmittance. The map has
        the same type.
    noise : ndarray of float32, shape (n,)
        Standard deviation of a pixel's light by DN.
    steps : ndarray of float32, shape (n,)
        Difference of light from a DN to the next, by DN.
    flags : ndarray of uint8, shape (n,)
        `Invalid` flags by DN.
    glare_fraction : float
        Veiling light over mean light of the scene.
    common : tuple of CommonError
        Errors that all pixels share.
    """

    light: _Light
    noise: _Maps
    steps: _Maps
    flags: NDArray[np.uint8]
    glare_fraction: float = 0.0
    common: tuple[CommonError, ...] = ()


class AssumedVignettingMap(LuminanceMap):
    """Map of a picture whose vignetting was not measured.

    Parameters
    ----------
    luminance_cd_m2, random_rel, common, invalid
        As of `LuminanceMap`.
    vignetting : AssumedVignetting or None
        Of the whole image, whose errors are common errors of the map; None for none.
    """

    def __init__(
        self,
        luminance_cd_m2: _Light,
        random_rel: _Light,
        common: tuple[CommonError, ...],
        invalid: NDArray[np.uint8],
        vignetting: AssumedVignetting | None,
    ) -> None:
        super().__init__(luminance_cd_m2, random_rel, common, invalid)
        self._vignetting, self._image_shape, self._window = vignetting, self.shape, WHOLE

    def common_in(self, window: Window) -> tuple[CommonError, ...]:
        """Return the common errors of some rows and columns of the map."""
        by_place = vignetting_errors(self._vignetting, self._image_shape, self.step, self._window, window)
        return (*super().common_in(window), *by_place)


class TableMap(AssumedVignettingMap):
    """Map of a frame, or of some rows and columns of it, by the light of each DN.

    Parameters
    ----------
    frame : Frame
        Grey, or behind a colour filter; of the latter the mean of the green or clear pixels counts for each group of
        2 x 2.
    table : LightTable
        Light of its DN.
    vignetting : AssumedVignetting or None
        Vignetting of the frame, which its light is corrected for where it is known; None for none.
    window : Window
        Rows and columns of the map.
    """

    def __init__(
        self, frame: Frame, table: LightTable, vignetting: AssumedVignetting | None, window: Window = WHOLE
    ) -> None:
        self._frame, self._table, self._vignetting, self._window = frame, table, vignetting, window
        self._image_shape, self._errors = frame.shape, table.common
        self.step = 1 if frame.colour_filter is None else 2
        known = vignetting if isinstance(vignetting, Cos4Vignetting) else None
        inverse_v = None if known is None else _inverse_v(known, frame.shape)
        dn = frame.levels.index
        offsets = None if frame.black_pattern is None else frame.black_pattern.offsets_dn(frame.shape)
        self._planes = [
            (
                dn[green],
                None if inverse_v is None else inverse_v[green],
                None if offsets is None else offsets[green],
            )
            for green in _plane_windows(frame)
        ]
        light = _mean(self._look_up(table.light, window))
        if table.glare_fraction:
            # Behind the windscreen is t (L + g mean(L)), whose mean over the image is t (1 + g) mean(L).
            mean = float(np.mean([plane.mean(dtype=float) for plane in self._look_up(table.light, WHOLE)]))
            light = light - np.float32(mean * table.glare_fraction / (1 + table.glare_fraction))
        self.luminance_cd_m2 = light

    def _look_up(self, table: _Light, window: Window, inside: Window = WHOLE) -> list[_Light]:
        """Look up values at the pixels of each plane, in the part `inside` of a window."""
        planes = []
        for dn, inverse, offset in self._planes:
            values = _values(table, dn[window][inside], None if offset is None else offset[window][inside])
            planes.append(values if inverse is None else np.multiply(values, inverse[window][inside], out=values))
        return planes

    @cached_property
    def random_rel(self) -> _Maps:
        """Relative standard uncertainty by the noise of the pixels."""
        squares = [np.square(noise) for noise in self._look_up(self._table.noise, self._window)]
        with np.errstate(divide="ignore"):
            # In one expression, of which NumPy reuses the memory.
            return np.asarray(np.sqrt(_mean(squares) / len(squares)) / np.abs(self.luminance_cd_m2), dtype=np.float32)

    @cached_property
    def invalid(self) -> NDArray[np.uint8]:
        """Flags of the pixels."""
        planes = [look_up(self._table.flags, dn[self._window]) for dn, *_ in self._planes]
        flags: NDArray[np.uint8] = np.bitwise_or.reduce(planes)
        flags[self.luminance_cd_m2 < 0] |= Invalid.BELOW_BLACK.value
        if self._frame.clipped is not None:
            flags[self._frame.clipped[self._window]] |= Invalid.SATURATED.value
        return flags

    def dn_step_in(self, window: Window) -> _Light:
        """Return the difference of luminance from a DN to the next in some rows and columns."""
        return _mean(self._look_up(self._table.steps, self._window, window))


def vignetting_errors(
    vignetting: AssumedVignetting | None, shape: tuple[int, int], step: int, *windows: Window
) -> tuple[CommonError, ...]:
    """Return the common errors of a map by its vignetting.

    Parameters
    ----------
    vignetting : AssumedVignetting or None
        Of the image; None for none.
    shape : (int, int)
        Height and width of the image.
    step : int
        Pixels of the image, along each side, for one of the map.
    *windows : (slice, slice)
        Rows and columns of the map, and of these again.
    """
    if vignetting is None:
        return ()
    rows, columns = (step * (np.arange(length // step, dtype=np.float64) + 0.5) for length in shape)
    for window in windows:
        rows, columns = rows[window[0]], columns[window[1]]
    patterns = vignetting.patterns_at(shape, rows, columns)
    return tuple(CommonError(ASSUMED, pattern.astype(np.float32), smooth=True) for pattern in patterns)


def _values(table: _Light, dn: NDArray[np.unsignedinteger[Any]], offset_dn: _Maps | None) -> _Light:
    """Values of a table at DN from which the black level of each pixel is subtracted, by linear interpolation."""
    if offset_dn is None:
        return look_up(table, dn)
    at = dn - offset_dn.astype(np.float64)
    below = np.clip(np.floor(at), 0, table.size - 2).astype(np.uint16)
    low = look_up(table, below).astype(np.float64)
    between = (at - below) * (look_up(table, below + np.uint16(1)) - low)
    values: _Light = (low + between).astype(table.dtype)
    return values


def _plane_windows(frame: Frame) -> list[tuple[slice, slice]]:
    if frame.colour_filter is None:
        return [WHOLE]
    height, width = (n // 2 * 2 for n in frame.shape)
    return [(slice(y, height, 2), slice(x, width, 2)) for y, x in luminance_pixels(frame.colour_filter)]


def _mean(values: list[_Light]) -> _Light:
    return values[0] if len(values) == 1 else reduce(np.add, values) / np.float32(len(values))


@lru_cache(maxsize=4)
def _inverse_v(vignetting: Cos4Vignetting, shape: tuple[int, int]) -> _Maps:
    """Return the vignetting of an image size, which a video asks for again and again."""
    return np.reciprocal(vignetting.relative_illuminance(shape)).astype(np.float32)


#: Variance of rounding in squares of the step (EMVA 1288 Release 3.1, section 2.2).
_ROUNDING_VARIANCE = 1 / 12


def make_light_table(
    frame: Frame,
    encoding: Encoding,
    specification: CameraSpecification | None,
    f_number: float | None = None,
    vignetting: AssumedVignetting | None = None,
) -> LightTable:
    """Light of a frame's DN, relative to the end of their scale or by guessed parameters of the camera.

    Of relative light, linear DN are divided by 2 to the power of their bits, which is exact in float32: the contrast of
    two integers that lies on an end of the interval stays there. The highest DN is just below 1. Decoded sRGB is 1 at
    the highest DN. The noise is taken to be that of rounding.

    By guessed parameters, the mean DN of a pixel is black + K t (E L + mu_d) with E photo-electrons per second and
    cd/m^2; of L the windscreen passes its transmittance. (Where it must divide by pixel area, exposure, quantum
    efficiency and optics, the program of the 2018 thesis multiplies.) DN of another depth than the converter's are
    spread over its range. What is left uncertain is not known, so stated as infinite.

    Parameters
    ----------
    frame : Frame
        Of any camera, with its black level, exposure and gain, and temperature where it is known.
    encoding : str
        Encoding of its DN.
    specification : CameraSpecification or None
        The parameters; None for relative light.
    f_number : float or None
        The f-number that was set, if known; None for that of the specification.
    vignetting : AssumedVignetting or None
        Vignetting of the frame; None for none.
    """
    scale = frame.bit_depth, frame.saturation_dn, frame.nominal_black_dn
    if specification is None:
        return _relative(*scale, encoding) if frame.bit_depth <= 16 else _relative_of(frame.levels, *scale, encoding)
    setting = frame.exposure_s, frame.gain_db, frame.temperature_c
    corrected = isinstance(vignetting, Cos4Vignetting)
    if frame.bit_depth <= 16:
        return _specified(specification, *scale, *setting, encoding, f_number, corrected)
    return _specified_of(frame.levels, specification, *scale, *setting, encoding, f_number, corrected)


@lru_cache(maxsize=16)
def _relative(bit_depth: int, saturation_dn: float, nominal_black_dn: float, encoding: Encoding) -> LightTable:
    """As `_relative_of`, of all DN of up to 16 bits: a table that the next frame has too."""
    table = _relative_of(_all_dn(bit_depth), bit_depth, saturation_dn, nominal_black_dn, encoding)
    return replace(table, light=table.light.astype(np.float32))


def _all_dn(bit_depth: int) -> DnLevels:
    dn = np.arange(2**bit_depth)
    return DnLevels(dn.astype(np.float64), np.ones(dn.size), dn.reshape(1, -1).astype(np.uint32))


def _relative_of(
    levels: DnLevels, bit_depth: int, saturation_dn: float, nominal_black_dn: float, encoding: Encoding
) -> LightTable:
    n, dn = 2**bit_depth, levels.values_dn
    linear = dn / n if encoding == "linear" else decoded_table(bit_depth, encoding)
    steps = _steps(dn, linear)
    noise = np.sqrt(_ROUNDING_VARIANCE) * steps
    light = linear - _black_in(dn, linear, nominal_black_dn)
    return LightTable(light, noise.astype(np.float32), steps.astype(np.float32), _saturated(dn, saturation_dn))


@lru_cache(maxsize=16)
def _specified(camera: CameraSpecification, bit_depth: int, *setting: Any) -> LightTable:
    """As `_specified_of`, of all DN of up to 16 bits."""
    return _specified_of(_all_dn(bit_depth), camera, bit_depth, *setting)


def _specified_of(
    levels: DnLevels,
    camera: CameraSpecification,
    bit_depth: int,
    saturation_dn: float,
    nominal_black_dn: float,
    exposure_s: float,
    gain_db: float,
    temperature_c: float | None,
    encoding: Encoding,
    f_number: float | None,
    corrected: bool,
) -> LightTable:
    values_dn = levels.values_dn
    linear = values_dn / (2**bit_depth - 1) if encoding == "linear" else decoded_table(bit_depth, encoding)
    # Linear values of companded data are DN of the sensor, which has more bits than its codes, without black level.
    top_dn = encoding.scale if isinstance(encoding, Companding) else 2.0**camera.adc_bits - 1
    black_dn = top_dn * _black_in(values_dn, linear, nominal_black_dn) if camera.black_dn is None else camera.black_dn
    k_dn_per_e = camera.system_gain_dn_per_e(gain_db)
    dark_e = camera.dark_electrons(exposure_s, temperature_c)
    per_cd_m2 = camera.electrons_per_cd_m2_s(f_number) * exposure_s * camera.windscreen_transmittance
    dn = top_dn * linear
    # Photons and dark electrons are one Poisson process.
    noise_e2 = np.maximum((dn - black_dn) / k_dn_per_e, 0) + camera.read_noise_e**2
    noise_e2 += _ROUNDING_VARIANCE * np.square(top_dn * _steps(values_dn, linear) / k_dn_per_e)
    flags = _saturated(values_dn, saturation_dn)
    if camera.saturation_dn is not None:
        # That of the sensor is with its black level.
        below_dn = encoding.black_value if isinstance(encoding, Companding) else 0.0
        flags[dn + below_dn >= camera.saturation_dn] |= Invalid.SATURATED.value
    zero_dn, light_at_top = black_dn + dark_e * k_dn_per_e, top_dn / (k_dn_per_e * per_cd_m2)
    light = _proportional(values_dn, 2**bit_depth - 1, zero_dn, top_dn, light_at_top)
    if encoding != "linear":
        light = (linear - zero_dn / top_dn) * light_at_top
    # Where pixels differ by more than their DN, no contrast lies exactly on an end of the interval.
    place_matters = corrected or camera.glare_fraction > 0
    return LightTable(
        light=light.astype(np.float32) if place_matters and bit_depth <= 16 else light,
        noise=(np.sqrt(noise_e2) / per_cd_m2).astype(np.float32),
        steps=_steps(values_dn, light).astype(np.float32),
        flags=flags,
        glare_fraction=camera.glare_fraction,
        common=(CommonError("guessed camera parameters", inf),),
    )


def _black_in(dn: NDArray[np.float64], linear: NDArray[np.float64], black_dn: float) -> float:
    """Light of a black level, by that of each DN, and straight on below the first."""
    if dn.size == 1 or not black_dn > dn[0]:
        # Those of a few DN of many bits are in proportion.
        slope = (linear[1] - linear[0]) / (dn[1] - dn[0]) if dn.size > 1 else linear[0] / max(dn[0], 1.0)
        return float(linear[0] + (black_dn - dn[0]) * slope)
    return float(np.interp(black_dn, dn, linear))


def _saturated(dn: NDArray[np.float64], saturation_dn: float) -> NDArray[np.uint8]:
    """Flag saturated DN."""
    return np.where(dn >= saturation_dn, Invalid.SATURATED, 0).astype(np.uint8)


def _proportional(
    dn: NDArray[np.float64], last_dn: float, zero_dn: float, top_dn: float, light_at_top: float
) -> NDArray[np.float64]:
    """Light by DN, 0 at `zero_dn` of a scale that ends at `top_dn` with this light above that of 0.

    The light of linear DN is their exact multiple: the contrast of two integers that lies on an end of the interval
    stays there. For that the factor has the 24 bits of a float32, which leaves enough of the 53 for the DN.
    """
    zero = zero_dn if last_dn == top_dn else zero_dn / top_dn * last_dn
    return (dn - zero) * float(np.float32(light_at_top / last_dn))


def _steps(dn: NDArray[np.float64], light: NDArray[np.float64]) -> NDArray[np.float64]:
    """Difference of light from a DN to the next, by DN."""
    if dn.size > 1:
        return np.gradient(light, dn)
    return light / np.maximum(dn, 1.0) if dn[0] > 0 else np.ones(1)
