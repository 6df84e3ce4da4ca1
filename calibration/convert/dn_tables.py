"""Luminance and uncertainty of every DN, computed once for each of the 2^bits values."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import hypot

import numpy as np
from numpy.typing import NDArray

from ...core.luminance import RANGE_MARGIN, CommonError, Invalid
from ...core.vignetting import FlatField
from ..errors.common import common_errors
from ..gains import GainSetting
from ..model import Calibration

Table = NDArray[np.float32]

#: Signal above dark used instead of exactly 0, where relative errors are undefined.
_LEAST_NET_DN = 1e-6


@dataclass(frozen=True, eq=False)
class DnTables:
    """Functions of the DN as tables, computed on demand, with luminances on the optical axis (V = 1).

    Parameters
    ----------
    calibration : Calibration
        The calibration.
    setting : GainSetting
        Properties of the frame's gain.
    exposure_s, temperature_c, bit_depth : float, float or None, int
        Of the frame.
    library_noise_dn : float
        Noise of the dark pattern that is subtracted; 0 if none is.
    """

    calibration: Calibration
    setting: GainSetting
    exposure_s: float
    temperature_c: float | None
    bit_depth: int
    library_noise_dn: float

    @cached_property
    def net_dn(self) -> NDArray[np.float64]:
        """DN above dark."""
        dark_dn = self.setting.dark.mean_dn(self.exposure_s, self.temperature_c)
        return np.arange(2**self.bit_depth, dtype=float) - dark_dn

    @cached_property
    def luminance_cd_m2(self) -> Table:
        """Luminance."""
        return (self.calibration.response.linearise(self.net_dn) / self._scale).astype(np.float32)

    @cached_property
    def slope_cd_m2_dn(self) -> Table:
        """Luminance per DN."""
        return self._slope_cd_m2_dn.astype(np.float32)

    @cached_property
    def random_rel(self) -> Table:
        """Relative standard uncertainty by noise of pixel and flat field."""
        vignetting = self.calibration.vignetting
        of_pixel = vignetting.random_rel if isinstance(vignetting, FlatField) else 0.0
        magnitude = np.abs(self.calibration.response.linearise(self._away_from_zero)) / self._scale
        return np.hypot(self._error_cd_m2 / magnitude, of_pixel).astype(np.float32)

    @cached_property
    def margin_cd_m2(self) -> Table:
        """Tolerance of the calibrated range for noise."""
        return (RANGE_MARGIN * self._error_cd_m2).astype(np.float32)

    @cached_property
    def common(self) -> tuple[CommonError, ...]:
        """Common errors, those that depend on the DN as tables."""
        errors = common_errors(
            self.calibration, self._away_from_zero, self.exposure_s, self.setting.gain_db, self.temperature_c
        )
        return tuple(
            e if np.ndim(e.relative) == 0 else replace(e, relative=np.asarray(e.relative, np.float32)) for e in errors
        )

    @cached_property
    def common_square(self) -> Table:
        """Sum of the squares of the common errors."""
        total = np.zeros(self.net_dn.shape)
        for error in self.common:
            total += np.square(np.asarray(error.relative, dtype=float))
        return total.astype(np.float32)

    def flags(self, saturation_dn: float) -> NDArray[np.uint8]:
        """Return the flags by DN; a curved response is invalid beyond its range."""
        saturated = np.arange(self.net_dn.size) >= saturation_dn
        flags = np.where(saturated, Invalid.SATURATED, 0) | np.where(self.net_dn < 0, Invalid.BELOW_BLACK, 0)
        if self.calibration.response.kind != "linear":
            beyond = self.net_dn - RANGE_MARGIN * self._noise_dn > self.calibration.range_net_dn[1]
            flags |= np.where(beyond, Invalid.OUTSIDE_CALIBRATED, 0)
        if self.calibration.response.kind == "table":
            below = self.net_dn + RANGE_MARGIN * self._noise_dn < self.calibration.range_net_dn[0]
            flags |= np.where(below, Invalid.OUTSIDE_CALIBRATED, 0)
        return flags.astype(np.uint8)

    @property
    def slow_cd_m2(self) -> Table:
        """Independent standard uncertainty of each region by its dark signal, on the axis."""
        dn = hypot(self.calibration.responsivity.scatter_dn, self.setting.dark.nonuniformity_dn)
        return self.slope_cd_m2_dn * np.float32(dn)

    @property
    def _scale(self) -> float:
        """Linearised DN per cd/m^2 on the axis."""
        return self.calibration.responsivity.responsivity_dn_s_cd_m2 * self.setting.factor * self.exposure_s

    @cached_property
    def _slope_cd_m2_dn(self) -> NDArray[np.float64]:
        return self.calibration.response.slope(self.net_dn) / self._scale

    @cached_property
    def _error_cd_m2(self) -> NDArray[np.float64]:
        return self._slope_cd_m2_dn * self._noise_dn

    @cached_property
    def _noise_dn(self) -> NDArray[np.float64]:
        dark_dn2 = self.setting.dark.noise_variance_dn2(self.exposure_s, self.temperature_c)
        variance_dn2 = self.setting.noise.variances_dn2(self.net_dn, dark_dn2)
        total: NDArray[np.float64] = np.sqrt(variance_dn2 + self.library_noise_dn**2)
        return total

    @property
    def _away_from_zero(self) -> NDArray[np.float64]:
        return np.where(np.abs(self.net_dn) < _LEAST_NET_DN, _LEAST_NET_DN, self.net_dn)
