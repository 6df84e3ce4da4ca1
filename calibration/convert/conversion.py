"""Conversion of frames to luminance: what depends on the DN is computed once for each of the 2^bits values."""

from __future__ import annotations

import logging
from dataclasses import replace
from functools import cached_property, lru_cache
from math import hypot, inf

import numpy as np
from numpy.typing import NDArray

from ...core.dn import look_up
from ...core.errors import CalibrationError
from ...core.frame import Frame
from ...core.luminance import RANGE_MARGIN, WHOLE, CommonError, Invalid, LuminanceMap, Window
from ...core.result import log_findings
from ...core.vignetting import AnyVignetting, Cos4Vignetting, RadialVignetting
from ..camera import CalibratedCamera, common_errors, numbers_by_pattern, placed
from ..frames.observations import CameraState
from ..setup import LensIdentity
from ..uncertainty import student_factor

_log = logging.getLogger(__name__)

#: Signal above dark used instead of exactly 0, where relative errors are undefined.
_LEAST_NET_DN = 1e-6

_Maps = NDArray[np.float32]
_Light = NDArray[np.float32] | NDArray[np.float64]
#: Most bits of DN whose luminances are kept in float32, which then are as many as the DN.
_FLOAT32_BITS = 16


def to_luminance(camera: CalibratedCamera, frame: Frame, window: Window = WHOLE) -> LuminanceMap:
    """Convert a frame: L = h(DN - d(t, T)) / (R t V(x, y)).

    An exposure outside the calibrated ones is logged; a luminance outside the calibrated range is flagged.

    Parameters
    ----------
    camera : CalibratedCamera
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
    camera = camera.in_region(state)
    camera.require(state, f"frame {frame.frame_id}")
    # Said once for a frame, and not for each of its blocks.
    if window[0].start in (None, 0):
        _log_what_was_not_calibrated(camera, frame)
    library, taken = camera.dark_library, (frame.exposure_s, frame.temperature_c)
    pattern = None if library is None else library.correction_dn(frame.shape, *taken)
    noise_dn = 0.0 if library is None or pattern is None else library.noise_dn(*taken)
    inverse_v = _inverse_v(camera.vignetting, frame.shape)
    inverse_v, pattern = (None if array is None else array[window] for array in (inverse_v, pattern))
    return _CalibratedMap(camera, frame, window, inverse_v, pattern, noise_dn)


def require_lens(calibrated: LensIdentity, lens: LensIdentity) -> None:
    """Refuse another lens or f-number; raises CalibrationError."""
    if not lens.is_as_in(calibrated):
        raise CalibrationError(
            f"the calibration is for the lens {calibrated}, the frame was taken with {lens}: "
            "calibrate with this lens and f-number"
        )


def _log_what_was_not_calibrated(camera: CalibratedCamera, frame: Frame) -> None:
    low, high = camera.exposures_s[0], camera.exposures_s[-1]
    if not low * (1 - 1e-6) <= frame.exposure_s <= high * (1 + 1e-6):
        text = "frame %d has an exposure of %g s, the calibration was made at %g to %g s"
        _log.warning(text, frame.frame_id, frame.exposure_s, low, high)
    taken = [(frame.exposure_s, frame.temperature_c)]
    dark = camera.setting(frame.gain_db).dark
    log_findings(_log, dark.temperature_findings(taken, f"frame {frame.frame_id}"))


class _CalibratedMap(LuminanceMap):
    """Map of a window of a frame; tables over the DN have luminances on the optical axis (V = 1)."""

    def __init__(
        self,
        camera: CalibratedCamera,
        frame: Frame,
        window: Window,
        inverse_v: _Maps | None,
        dark_pattern_dn: _Maps | None,
        library_noise_dn: float,
    ) -> None:
        self._camera, self._frame, self._window, self._inverse_v = camera, frame, window, inverse_v
        self._dark_pattern_dn, self._library_noise_dn = dark_pattern_dn, library_noise_dn
        # Of companded data the index is the code, and all that depends on it follows from its linear value.
        levels = frame.levels
        self.step, self._dn, self._setting = 1, levels.index[window], camera.setting(frame.gain_db)
        self._values_dn, self._is_wide = levels.values_dn, frame.bit_depth > _FLOAT32_BITS
        self._scale = camera.dn_per_cd_m2(frame.exposure_s, frame.gain_db)
        self.luminance_cd_m2 = self._luminance()
        fit = camera.responsivity
        # A map has no degrees of freedom: 1.96 of these uncertainties are the expanded one.
        self.slow_rel = hypot(camera.field_rel, fit.scatter_rel * student_factor(fit.scatter_dof or inf))
        self.fixed_rel = camera.pixel_rel(self._setting.gain_db)

    def _luminance(self) -> _Light:
        if self._dark_pattern_dn is None:
            return look_up(self._luminance_by_dn, self._dn, self._inverse_v)
        # To first order in the pattern, which is small except at pixels of the defect map.
        luminance = look_up(self._luminance_by_dn, self._dn)
        luminance -= look_up(self._slope_by_dn.astype(np.float32), self._dn, self._dark_pattern_dn)
        if self._inverse_v is not None:
            luminance *= self._inverse_v
        return luminance

    @cached_property
    def random_rel(self) -> _Maps:
        """Relative standard uncertainty by noise of pixel and library, and by the pixel's sensitivity."""
        if self._dark_pattern_dn is None:
            magnitude = np.abs(self._camera.response.linearise(self._away_from_zero)) / self._scale
            return look_up(np.hypot(self._error_by_dn / magnitude, self.fixed_rel).astype(np.float32), self._dn)
        error = look_up(self._error_by_dn.astype(np.float32), self._dn, self._inverse_v)
        error /= np.maximum(np.abs(self.luminance_cd_m2), np.float32(1e-30))
        result: _Maps = np.hypot(error, np.float32(self.fixed_rel), out=error)
        return result

    @cached_property
    def fixed_cd_m2(self) -> _Maps | float:
        """Noise of the dark library."""
        if self._dark_pattern_dn is None:
            return 0.0
        by_dn = (self._slope_by_dn * self._library_noise_dn).astype(np.float32)
        return look_up(by_dn, self._dn, self._inverse_v)

    @cached_property
    def slow_cd_m2(self) -> _Maps | float:
        """Independent uncertainty of each region by its dark signal; a number for a linear response."""
        dn = hypot(self._camera.responsivity.scatter_dn, self._setting.dark.nonuniformity_dn)
        by_dn = (self._slope_by_dn * dn).astype(np.float32)
        if self._camera.response.kind == "linear":
            return float(by_dn[0]) * _mean_inverse_v(self._camera.vignetting, self._frame.shape)
        return look_up(by_dn, self._dn, self._inverse_v)

    def common_in(self, window: Window) -> tuple[CommonError, ...]:
        """Return the common errors of some rows and columns of the map."""
        dn = self._dn[window]
        by_dn = tuple(
            e if np.ndim(e.relative) == 0 else replace(e, relative=look_up(np.asarray(e.relative), dn))
            for e in self._common_by_dn
        )
        return placed(self._camera, by_dn, [-pattern[window] for pattern in self._patterns])

    @cached_property
    def common_rel(self) -> _Maps:
        """All common errors together, by tables where patterns of the vignetting allow it."""
        by_dn = np.zeros(self._net_dn.shape)
        for error in self._common_by_dn:
            by_dn += np.square(np.asarray(error.relative, dtype=float))
        patterns, numbers = self._patterns, numbers_by_pattern(self._camera)
        if not patterns:
            return look_up(np.sqrt(by_dn).astype(np.float32), self._dn)
        total = look_up(by_dn.astype(np.float32), self._dn)
        for number, pattern in enumerate(patterns):
            of_fit = self._common_by_dn[numbers[number]].relative if number in numbers else np.zeros(1, np.float32)
            total += pattern * (pattern - 2 * look_up(np.asarray(of_fit), self._dn))
        result: _Maps = np.sqrt(np.maximum(total, 0, out=total), out=total)
        return result

    @cached_property
    def invalid(self) -> NDArray[np.uint8]:
        """Flags of the pixels."""
        luminance, flags = self.luminance_cd_m2, look_up(self._flags_by_dn(), self._dn)
        margin = look_up((RANGE_MARGIN * self._error_by_dn).astype(np.float32), self._dn, self._inverse_v)
        low, high = self._camera.range_cd_m2
        flags[luminance < 0] |= Invalid.BELOW_BLACK.value
        flags[(luminance + margin < low) | (luminance - margin > high)] |= Invalid.OUTSIDE_CALIBRATED.value
        if self._camera.defects is not None:
            flags[self._camera.defects.mask(self._frame.shape)[self._window]] |= Invalid.DEFECT.value
        return flags

    def _flags_by_dn(self) -> NDArray[np.uint8]:
        """Saturation, and for a curved response the end of its range."""
        saturation_dn = min(self._frame.linear_saturation_dn, self._camera.state.saturation_dn)
        low, high = self._camera.range_net_dn
        margin, kind = RANGE_MARGIN * self._noise_by_dn, self._camera.response.kind
        flags = np.where(self._values_dn >= saturation_dn, Invalid.SATURATED, 0).astype(np.uint8)
        if kind != "linear":
            flags[self._net_dn - margin > high] |= Invalid.OUTSIDE_CALIBRATED.value
        if kind == "table":
            flags[self._net_dn + margin < low] |= Invalid.OUTSIDE_CALIBRATED.value
        return flags

    @cached_property
    def _net_dn(self) -> NDArray[np.float64]:
        dark_dn = self._setting.dark.mean_dn(self._frame.exposure_s, self._frame.temperature_c)
        return self._values_dn - dark_dn

    @property
    def _away_from_zero(self) -> NDArray[np.float64]:
        return np.where(np.abs(self._net_dn) < _LEAST_NET_DN, _LEAST_NET_DN, self._net_dn)

    @cached_property
    def _luminance_by_dn(self) -> _Light:
        luminance = self._camera.response.linearise(self._net_dn) / self._scale
        return luminance if self._is_wide else luminance.astype(np.float32)

    @cached_property
    def _slope_by_dn(self) -> NDArray[np.float64]:
        """Luminance per DN."""
        return self._camera.response.slope(self._net_dn) / self._scale

    @cached_property
    def _noise_by_dn(self) -> NDArray[np.float64]:
        """Standard deviation of a pixel, and of the library's pattern, in DN."""
        dark_dn2 = self._setting.dark.noise_variance_dn2(self._frame.exposure_s, self._frame.temperature_c)
        variance_dn2 = self._setting.noise.variances_dn2(self._net_dn, dark_dn2)
        return np.sqrt(variance_dn2 + self._library_noise_dn**2)

    @cached_property
    def _error_by_dn(self) -> NDArray[np.float64]:
        """The same in cd/m^2."""
        return self._slope_by_dn * self._noise_by_dn

    @cached_property
    def _common_by_dn(self) -> tuple[CommonError, ...]:
        frame, away = self._frame, self._away_from_zero
        errors = common_errors(self._camera, away, frame.exposure_s, self._setting.gain_db, frame.temperature_c)
        return tuple(
            e if np.ndim(e.relative) == 0 else replace(e, relative=np.asarray(e.relative, np.float32)) for e in errors
        )

    @property
    def _patterns(self) -> list[_Maps]:
        """Patterns of the vignetting's errors in the window."""
        return [pattern[self._window] for pattern in _patterns(self._camera.vignetting, self._frame.shape)]


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
