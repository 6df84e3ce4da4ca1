"""Conversion of frames to luminance by a calibration."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from math import hypot, inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import CalibrationError
from ...core.finding import log_findings
from ...core.frame import Frame
from ...core.luminance import RANGE_MARGIN, WHOLE, CommonError, Invalid, LuminanceMap, PixelErrors, Window
from ...core.vignetting import AnyVignetting, FlatField, RadialVignetting
from ..errors.uncertainty import student_factor
from ..frames.observations import CameraState
from ..model import Calibration
from ..setup import LensIdentity
from .dn_tables import DnTables
from .region import of_region

_log = logging.getLogger(__name__)

#: Pixels per block of a table look-up, so that temporary arrays fit in the processor's cache.
_BLOCK = 2**15
#: Marker of a DN whose range check depends on the pixel's position; not a flag of `Invalid`.
_DEPENDS = 128

_Maps = NDArray[np.float32]


def to_luminance(calibration: Calibration, frame: Frame, window: Window = WHOLE) -> LuminanceMap:
    """Convert a frame: L = h(DN - d(t, T)) / (R t V(x, y)).

    Functions of the DN are computed once for each of the 2^bits values, and looked up in float32. Uncertainty and flags
    are computed on demand. Pixels below the dark signal have a negative luminance; the relative uncertainty is the
    absolute one over the luminance's magnitude. A frame outside the temperatures of the dark frames is logged.

    Parameters
    ----------
    calibration, frame : Calibration, Frame
        The frame is monochrome, or one colour plane.
    window : Window
        Rows and columns to convert; the map starts at the first of them.

    Returns
    -------
    LuminanceMap
        random_rel: noise of the pixel, flat field and dark library. common: `common_errors` and radial vignetting.

    Raises
    ------
    CalibrationError
        If camera, gain, pixel format, bit depth or image size differ, or the frame shows a part of the sensor that
        the calibration does not cover.
    InputError
        If flat field, defect map or dark library are of another image size.
    """
    state = CameraState.of(frame)
    calibration = of_region(calibration, state)
    calibration.require(state, f"frame {frame.frame_id}")
    setting = calibration.setting(frame.gain_db)
    # Said once for a frame, and not for each of its blocks.
    if window[0].start in (None, 0):
        _say_what_was_not_calibrated(calibration, frame)
    library = calibration.dark_library
    taken = frame.exposure_s, frame.temperature_c
    pattern = None if library is None else library.correction_dn(frame.shape, *taken)
    noise_dn = 0.0 if library is None or pattern is None else library.noise_dn(*taken)
    tables = DnTables(calibration, setting, *taken, frame.bit_depth, library_noise_dn=noise_dn)
    inverse_v = _inverse_v(calibration.vignetting, frame.shape)
    inverse_v, pattern = (None if array is None else array[window] for array in (inverse_v, pattern))
    conversion = _Conversion(frame, frame.dn[window], tables, inverse_v, pattern, window)
    return LuminanceMap(
        conversion.luminance(),
        PixelErrors(
            conversion.random_rel,
            slow_rel=_slow_rel(calibration),
            slow_cd_m2=conversion.slow_cd_m2(),
            fixed_rel=calibration.vignetting.random_rel if isinstance(calibration.vignetting, FlatField) else 0.0,
            fixed_cd_m2=0.0 if pattern is None else conversion.library_noise_cd_m2,
        ),
        conversion.common,
        conversion.invalid,
        common_rel=conversion.common_rel,
    )


def _say_what_was_not_calibrated(calibration: Calibration, frame: Frame) -> None:
    low, high = calibration.exposures_s[0], calibration.exposures_s[-1]
    if not low * (1 - 1e-6) <= frame.exposure_s <= high * (1 + 1e-6):
        _log.warning(
            "frame %d has an exposure of %g s, the calibration was made at %g to %g s",
            frame.frame_id,
            frame.exposure_s,
            low,
            high,
        )
    taken = [(frame.exposure_s, frame.temperature_c)]
    dark = calibration.setting(frame.gain_db).dark
    log_findings(_log, dark.temperature_findings(taken, f"frame {frame.frame_id}"))


def _slow_rel(calibration: Calibration) -> float:
    """Independent relative standard uncertainty of each region of any size: flat field and patch scatter."""
    vignetting = calibration.vignetting
    of_field = vignetting.slow_rel if isinstance(vignetting, FlatField | RadialVignetting) else 0.0
    fit = calibration.responsivity
    # A map has no degrees of freedom: 1.96 of these uncertainties are the expanded one.
    return hypot(of_field, fit.scatter_rel * student_factor(fit.scatter_dof or inf))


@dataclass(frozen=True, eq=False)
class _Conversion:
    """Looks up the pixels of a window of a frame; all arrays are of the window."""

    frame: Frame
    dn: NDArray[Any]
    tables: DnTables
    inverse_v: _Maps | None
    dark_pattern_dn: _Maps | None
    window: Window

    def luminance(self) -> _Maps:
        luminance = _look_up(self.tables.luminance_cd_m2, self.dn, None if self._patterned else self.inverse_v)
        if self.dark_pattern_dn is None:
            return luminance
        # To first order in the pattern, which is small except at pixels of the defect map.
        luminance -= _look_up(self.tables.slope_cd_m2_dn, self.dn, self.dark_pattern_dn)
        if self.inverse_v is not None:
            luminance *= self.inverse_v
        return luminance

    def random_rel(self) -> _Maps:
        if not self._patterned:
            return _look_up(self.tables.random_rel, self.dn)
        margin = _look_up(self.tables.margin_cd_m2, self.dn, self.inverse_v)
        magnitude = np.maximum(np.abs(self.luminance()), np.float32(1e-30))
        return (margin / RANGE_MARGIN / magnitude).astype(np.float32, copy=False)

    def library_noise_cd_m2(self) -> _Maps:
        by_dn = self.tables.slope_cd_m2_dn * np.float32(self.tables.library_noise_dn)
        return _look_up(by_dn, self.dn, self.inverse_v)

    def slow_cd_m2(self) -> _Maps | float:
        """Return a number for a linear response, whose slope is that of all pixels."""
        if self.tables.calibration.response.kind == "linear":
            return float(self.tables.slow_cd_m2[0]) * _mean_inverse_v(
                self.tables.calibration.vignetting, self.frame.shape
            )
        return _look_up(self.tables.slow_cd_m2, self.dn, self.inverse_v)

    def common(self, window: Window) -> tuple[CommonError, ...]:
        dn = self.dn[window]
        by_dn = tuple(
            e if np.ndim(e.relative) == 0 else replace(e, relative=_look_up(np.asarray(e.relative), dn))
            for e in self.tables.common
        )
        by_place = (CommonError("flat field", -p[window]) for p in self._positional[0])
        return (*by_dn, *by_place)

    def common_rel(self) -> _Maps:
        squares = self._positional[1]
        if squares is None:
            return _look_up(np.sqrt(self.tables.common_square), self.dn)
        total = _look_up(self.tables.common_square, self.dn)
        total += squares
        result: _Maps = np.sqrt(total, out=total)
        return result

    def invalid(self) -> NDArray[np.uint8]:
        invalid = self._flags_by_luminance() if self._patterned else self._flags_by_dn()
        if self.tables.calibration.defects is not None:
            invalid[self.tables.calibration.defects.mask(self.frame.shape)[self.window]] |= Invalid.DEFECT.value
        return invalid

    def _flags_by_dn(self) -> NDArray[np.uint8]:
        """Look up the flags; a luminance is computed only where the range check depends on V."""
        tables, flags = self.tables, self.tables.flags(self._saturation_dn)
        darkest, brightest = tables.luminance_cd_m2 + tables.margin_cd_m2, tables.luminance_cd_m2 - tables.margin_cd_m2
        ends = [1.0] if self.inverse_v is None else _ends(self.tables.calibration.vignetting, self.frame.shape)
        low, high = self.tables.calibration.range_cd_m2
        below = np.array([darkest * end < low for end in ends])
        above = np.array([brightest * end > high for end in ends])
        surely = below.all(axis=0) | above.all(axis=0)
        flags[surely] |= Invalid.OUTSIDE_CALIBRATED.value
        flags[(below | above).any(axis=0) & ~surely] |= _DEPENDS
        invalid = _look_up(flags, self.dn)
        if self.inverse_v is not None and flags.max() >= _DEPENDS:
            for rows in _blocks(self.dn.shape):
                block = invalid[rows].reshape(-1)  # a view: rows are contiguous
                at = np.flatnonzero(block >= _DEPENDS)
                dn, scale = self.dn[rows].reshape(-1)[at], self.inverse_v[rows].reshape(-1)[at]
                out = self._outside(darkest[dn] * scale, brightest[dn] * scale)
                block[at] ^= np.where(out, _DEPENDS | Invalid.OUTSIDE_CALIBRATED, _DEPENDS).astype(np.uint8)
        return invalid

    def _flags_by_luminance(self) -> NDArray[np.uint8]:
        luminance = self.luminance()
        margin = _look_up(self.tables.margin_cd_m2, self.dn, self.inverse_v)
        invalid = _look_up(self.tables.flags(self._saturation_dn) & Invalid.SATURATED, self.dn)
        invalid[luminance < 0] |= Invalid.BELOW_BLACK.value
        invalid[self._outside(luminance + margin, luminance - margin)] |= Invalid.OUTSIDE_CALIBRATED.value
        return invalid

    def _outside(self, darkest: _Maps, brightest: _Maps) -> NDArray[np.bool_]:
        """Whether luminances exceed the calibrated range by more than noise."""
        low, high = self.tables.calibration.range_cd_m2
        outside: NDArray[np.bool_] = (darkest < low) | (brightest > high)
        return outside

    @property
    def _saturation_dn(self) -> float:
        return min(self.frame.saturation_dn, self.tables.calibration.state.saturation_dn)

    @property
    def _patterned(self) -> bool:
        return self.dark_pattern_dn is not None

    @property
    def _positional(self) -> tuple[list[_Maps], _Maps | None]:
        vignetting = self.tables.calibration.vignetting
        if not isinstance(vignetting, RadialVignetting) or not np.any(vignetting.covariance):
            return [], None
        patterns, squares = _positional_patterns(vignetting, self.frame.shape)
        return [pattern[self.window] for pattern in patterns], squares[self.window]


def _look_up(table: NDArray[Any], dn: NDArray[Any], factor: _Maps | None = None) -> NDArray[Any]:
    """Values of the table at the DN, times a factor, block by block; DN beyond the table get its last value."""
    values = np.empty(dn.shape, table.dtype)
    for rows in _blocks(dn.shape):
        np.take(table, dn[rows], out=values[rows], mode="clip")
        if factor is not None:
            values[rows] *= factor[rows]
    return values


def _blocks(shape: tuple[int, ...]) -> Iterator[slice]:
    height, width = shape
    rows = max(_BLOCK // max(width, 1), 1)
    return (slice(start, start + rows) for start in range(0, height, rows))


@lru_cache(maxsize=8)
def _inverse_v(vignetting: AnyVignetting | None, shape: tuple[int, int]) -> _Maps | None:
    """1 / V in float32, cached for the next frame."""
    if vignetting is None:
        return None
    return np.reciprocal(vignetting.relative_illuminance(shape)).astype(np.float32)


@lru_cache(maxsize=8)
def _ends(vignetting: AnyVignetting | None, shape: tuple[int, int]) -> tuple[np.float32, np.float32]:
    """Lowest and highest 1 / V."""
    inverse_v = _inverse_v(vignetting, shape)
    assert inverse_v is not None
    return inverse_v.min(), inverse_v.max()


@lru_cache(maxsize=8)
def _mean_inverse_v(vignetting: AnyVignetting | None, shape: tuple[int, int]) -> float:
    inverse_v = _inverse_v(vignetting, shape)
    return 1.0 if inverse_v is None else float(inverse_v.mean(dtype=float))


@lru_cache(maxsize=2)
def _positional_patterns(vignetting: RadialVignetting, shape: tuple[int, int]) -> tuple[list[_Maps], _Maps]:
    """Patterns of the vignetting's uncertainty, and the sum of their squares."""
    patterns = [pattern.astype(np.float32) for pattern in vignetting.common_patterns(shape)]
    return patterns, np.sum(np.square(patterns), axis=0, dtype=np.float32)


def require_lens(calibrated: LensIdentity, lens: LensIdentity) -> None:
    """Refuse another lens or f-number; raises CalibrationError."""
    if not lens.is_as_in(calibrated):
        raise CalibrationError(
            f"the calibration is for the lens {calibrated}, the frame was taken with {lens}: "
            "calibrate with this lens and f-number"
        )
