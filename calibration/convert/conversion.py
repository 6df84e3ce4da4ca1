"""Conversion of frames to luminance: what depends on the DN is computed once for each of the 2^bits values."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from math import hypot, inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import CalibrationError
from ...core.frame import Frame
from ...core.luminance import RANGE_MARGIN, WHOLE, CommonError, Invalid, LuminanceMap, PixelErrors, Window
from ...core.result import log_findings
from ...core.vignetting import AnyVignetting, Cos4Vignetting, RadialVignetting
from ..converter import Converter, common_errors, numbers_by_pattern, placed
from ..frames.observations import CameraState
from ..sensor.noise import GainSetting
from ..setup import LensIdentity
from ..uncertainty import student_factor

_log = logging.getLogger(__name__)

#: Pixels per block of a table look-up, so that temporary arrays fit in the processor's cache.
_BLOCK = 2**15
#: Signal above dark used instead of exactly 0, where relative errors are undefined.
_LEAST_NET_DN = 1e-6

_Maps = NDArray[np.float32]


def to_luminance(converter: Converter, frame: Frame, window: Window = WHOLE) -> LuminanceMap:
    """Convert a frame: L = h(DN - d(t, T)) / (R t V(x, y)).

    An exposure outside the calibrated ones is logged; a luminance outside the calibrated range is flagged.

    Parameters
    ----------
    converter : Converter
        Of the camera.
    frame : Frame
        DN, shape (height, width); may show a part of the calibrated sensor.
    window : Window
        Rows and columns of the map to be computed.

    Raises
    ------
    CalibrationError
        If camera, settings or gain are not calibrated.
    """
    state = CameraState.of(frame)
    converter = converter.in_region(state)
    converter.require(state, f"frame {frame.frame_id}")
    # Said once for a frame, and not for each of its blocks.
    if window[0].start in (None, 0):
        _log_what_was_not_calibrated(converter, frame)
    library, taken = converter.dark_library, (frame.exposure_s, frame.temperature_c)
    pattern = None if library is None else library.correction_dn(frame.shape, *taken)
    noise_dn = 0.0 if library is None or pattern is None else library.noise_dn(*taken)
    inverse_v = _inverse_v(converter.vignetting, frame.shape)
    inverse_v, pattern = (None if array is None else array[window] for array in (inverse_v, pattern))
    return _Conversion(converter, frame, window, inverse_v, pattern, noise_dn).map()


def require_lens(calibrated: LensIdentity, lens: LensIdentity) -> None:
    """Refuse another lens or f-number; raises CalibrationError."""
    if not lens.is_as_in(calibrated):
        raise CalibrationError(
            f"the calibration is for the lens {calibrated}, the frame was taken with {lens}: "
            "calibrate with this lens and f-number"
        )


def _log_what_was_not_calibrated(converter: Converter, frame: Frame) -> None:
    low, high = converter.exposures_s[0], converter.exposures_s[-1]
    if not low * (1 - 1e-6) <= frame.exposure_s <= high * (1 + 1e-6):
        text = "frame %d has an exposure of %g s, the calibration was made at %g to %g s"
        _log.warning(text, frame.frame_id, frame.exposure_s, low, high)
    taken = [(frame.exposure_s, frame.temperature_c)]
    dark = converter.setting(frame.gain_db).dark
    log_findings(_log, dark.temperature_findings(taken, f"frame {frame.frame_id}"))


@dataclass(frozen=True, eq=False)
class _Conversion:
    """A window of a frame; tables over the DN have luminances on the optical axis (V = 1)."""

    converter: Converter
    frame: Frame
    window: Window
    inverse_v: _Maps | None
    dark_pattern_dn: _Maps | None
    library_noise_dn: float

    def map(self) -> LuminanceMap:
        fit = self.converter.responsivity
        # A map has no degrees of freedom: 1.96 of these uncertainties are the expanded one.
        scatter_rel = fit.scatter_rel * student_factor(fit.scatter_dof or inf)
        return LuminanceMap(
            self._luminance(),
            PixelErrors(
                self._random_rel,
                slow_rel=hypot(self.converter.field_rel, scatter_rel),
                slow_cd_m2=self._slow_cd_m2(),
                fixed_rel=self._fixed_rel,
                fixed_cd_m2=0.0 if self.dark_pattern_dn is None else self._library_noise_cd_m2,
            ),
            self._common,
            self._invalid,
            common_rel=self._common_rel,
        )

    def _luminance(self) -> _Maps:
        if self.dark_pattern_dn is None:
            return _look_up(self._luminance_by_dn, self._dn, self.inverse_v)
        # To first order in the pattern, which is small except at pixels of the defect map.
        luminance = _look_up(self._luminance_by_dn, self._dn)
        luminance -= _look_up(self._slope_by_dn.astype(np.float32), self._dn, self.dark_pattern_dn)
        if self.inverse_v is not None:
            luminance *= self.inverse_v
        return luminance

    def _random_rel(self) -> _Maps:
        """Relative standard uncertainty by noise of pixel and library, and by the pixel's sensitivity."""
        if self.dark_pattern_dn is None:
            magnitude = np.abs(self.converter.response.linearise(self._away_from_zero)) / self._scale
            return _look_up(np.hypot(self._error_by_dn / magnitude, self._fixed_rel).astype(np.float32), self._dn)
        error = _look_up(self._error_by_dn.astype(np.float32), self._dn, self.inverse_v)
        error /= np.maximum(np.abs(self._luminance()), np.float32(1e-30))
        result: _Maps = np.hypot(error, np.float32(self._fixed_rel), out=error)
        return result

    def _library_noise_cd_m2(self) -> _Maps:
        by_dn = (self._slope_by_dn * self.library_noise_dn).astype(np.float32)
        return _look_up(by_dn, self._dn, self.inverse_v)

    def _slow_cd_m2(self) -> _Maps | float:
        """Independent uncertainty of each region by its dark signal; a number for a linear response."""
        dn = hypot(self.converter.responsivity.scatter_dn, self._setting.dark.nonuniformity_dn)
        by_dn = (self._slope_by_dn * dn).astype(np.float32)
        if self.converter.response.kind == "linear":
            return float(by_dn[0]) * _mean_inverse_v(self.converter.vignetting, self.frame.shape)
        return _look_up(by_dn, self._dn, self.inverse_v)

    def _common(self, window: Window) -> tuple[CommonError, ...]:
        dn = self._dn[window]
        by_dn = tuple(
            e if np.ndim(e.relative) == 0 else replace(e, relative=_look_up(np.asarray(e.relative), dn))
            for e in self._common_by_dn
        )
        return placed(self.converter, by_dn, [-pattern[window] for pattern in self._patterns])

    def _common_rel(self) -> _Maps:
        by_dn = np.zeros(self._net_dn.shape)
        for error in self._common_by_dn:
            by_dn += np.square(np.asarray(error.relative, dtype=float))
        patterns, numbers = self._patterns, numbers_by_pattern(self.converter)
        if not patterns:
            return _look_up(np.sqrt(by_dn).astype(np.float32), self._dn)
        total = _look_up(by_dn.astype(np.float32), self._dn)
        for number, pattern in enumerate(patterns):
            of_fit = self._common_by_dn[numbers[number]].relative if number in numbers else np.zeros(1, np.float32)
            total += pattern * (pattern - 2 * _look_up(np.asarray(of_fit), self._dn))
        result: _Maps = np.sqrt(np.maximum(total, 0, out=total), out=total)
        return result

    def _invalid(self) -> NDArray[np.uint8]:
        luminance, flags = self._luminance(), _look_up(self._flags_by_dn(), self._dn)
        margin = _look_up((RANGE_MARGIN * self._error_by_dn).astype(np.float32), self._dn, self.inverse_v)
        low, high = self.converter.range_cd_m2
        flags[luminance < 0] |= Invalid.BELOW_BLACK.value
        flags[(luminance + margin < low) | (luminance - margin > high)] |= Invalid.OUTSIDE_CALIBRATED.value
        if self.converter.defects is not None:
            flags[self.converter.defects.mask(self.frame.shape)[self.window]] |= Invalid.DEFECT.value
        return flags

    def _flags_by_dn(self) -> NDArray[np.uint8]:
        """Saturation, and for a curved response the end of its range."""
        saturation_dn = min(self.frame.saturation_dn, self.converter.state.saturation_dn)
        low, high = self.converter.range_net_dn
        margin, kind = RANGE_MARGIN * self._noise_by_dn, self.converter.response.kind
        flags = np.where(np.arange(self._net_dn.size) >= saturation_dn, Invalid.SATURATED, 0).astype(np.uint8)
        if kind != "linear":
            flags[self._net_dn - margin > high] |= Invalid.OUTSIDE_CALIBRATED.value
        if kind == "table":
            flags[self._net_dn + margin < low] |= Invalid.OUTSIDE_CALIBRATED.value
        return flags

    @cached_property
    def _dn(self) -> NDArray[Any]:
        return self.frame.dn[self.window]

    @cached_property
    def _setting(self) -> GainSetting:
        return self.converter.setting(self.frame.gain_db)

    @property
    def _scale(self) -> float:
        return self.converter.dn_per_cd_m2(self.frame.exposure_s, self.frame.gain_db)

    @property
    def _fixed_rel(self) -> float:
        return self.converter.pixel_rel(self._setting.gain_db)

    @cached_property
    def _net_dn(self) -> NDArray[np.float64]:
        dark_dn = self._setting.dark.mean_dn(self.frame.exposure_s, self.frame.temperature_c)
        return np.arange(2**self.frame.bit_depth, dtype=float) - dark_dn

    @property
    def _away_from_zero(self) -> NDArray[np.float64]:
        return np.where(np.abs(self._net_dn) < _LEAST_NET_DN, _LEAST_NET_DN, self._net_dn)

    @cached_property
    def _luminance_by_dn(self) -> _Maps:
        return (self.converter.response.linearise(self._net_dn) / self._scale).astype(np.float32)

    @cached_property
    def _slope_by_dn(self) -> NDArray[np.float64]:
        """Luminance per DN."""
        return self.converter.response.slope(self._net_dn) / self._scale

    @cached_property
    def _noise_by_dn(self) -> NDArray[np.float64]:
        """Standard deviation of a pixel, and of the library's pattern, in DN."""
        dark_dn2 = self._setting.dark.noise_variance_dn2(self.frame.exposure_s, self.frame.temperature_c)
        variance_dn2 = self._setting.noise.variances_dn2(self._net_dn, dark_dn2)
        return np.sqrt(variance_dn2 + self.library_noise_dn**2)

    @cached_property
    def _error_by_dn(self) -> NDArray[np.float64]:
        """The same in cd/m^2."""
        return self._slope_by_dn * self._noise_by_dn

    @cached_property
    def _common_by_dn(self) -> tuple[CommonError, ...]:
        frame, away = self.frame, self._away_from_zero
        errors = common_errors(self.converter, away, frame.exposure_s, self._setting.gain_db, frame.temperature_c)
        return tuple(
            e if np.ndim(e.relative) == 0 else replace(e, relative=np.asarray(e.relative, np.float32)) for e in errors
        )

    @property
    def _patterns(self) -> list[_Maps]:
        """Patterns of the vignetting's errors in the window."""
        return [pattern[self.window] for pattern in _patterns(self.converter.vignetting, self.frame.shape)]


def _look_up(table: NDArray[Any], dn: NDArray[Any], factor: _Maps | None = None) -> NDArray[Any]:
    """Values of the table at the DN, times a factor, block by block; DN beyond the table get its last value."""
    values = np.empty(dn.shape, table.dtype)
    step = max(_BLOCK // max(dn.shape[1], 1), 1)
    for rows in (slice(start, start + step) for start in range(0, dn.shape[0], step)):
        np.take(table, dn[rows], out=values[rows], mode="clip")
        if factor is not None:
            values[rows] *= factor[rows]
    return values


@lru_cache(maxsize=8)
def _inverse_v(vignetting: AnyVignetting | None, shape: tuple[int, int]) -> _Maps | None:
    """1 / V in float32, cached for the next frame."""
    if vignetting is None:
        return None
    return np.reciprocal(vignetting.relative_illuminance(shape)).astype(np.float32)


@lru_cache(maxsize=8)
def _mean_inverse_v(vignetting: AnyVignetting | None, shape: tuple[int, int]) -> float:
    inverse_v = _inverse_v(vignetting, shape)
    return 1.0 if inverse_v is None else float(inverse_v.mean(dtype=float))


@lru_cache(maxsize=2)
def _patterns(vignetting: AnyVignetting | None, shape: tuple[int, int]) -> list[_Maps]:
    """Patterns of a vignetting's errors over an image; those of a flat field are no patterns."""
    if not isinstance(vignetting, Cos4Vignetting | RadialVignetting):
        return []
    return [pattern.astype(np.float32) for pattern in vignetting.common_patterns(shape)]
