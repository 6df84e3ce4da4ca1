"""Conversion from DN to luminance by the parameters of a linear sensor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.errors import CalibrationError, InputError
from ...core.frame import Frame
from ...core.luminance import RANGE_MARGIN, CommonError, Invalid, LuminanceMap
from ...core.vignetting import Vignetting


@dataclass(frozen=True)
class LinearConversion:
    """L = (DN - d(t)) / (R t V(x, y)), with the dark signal d(t) = `dark_offset_dn` + `dark_rate_dn_s` t.

    Parameters
    ----------
    responsivity_dn_s_cd_m2 : float
        R, DN per second and cd/m^2 on the optical axis (DN s^-1 / (cd m^-2)), at `gain_db`.
    responsivity_common_rel : float
        Relative standard uncertainty of R, common to all pixels.
    dark_offset_dn, dark_rate_dn_s : float
        Dark signal at zero exposure, and its growth per second.
    k_dn_per_e, dark_noise_dn : float
        Overall system gain K and temporal noise in dark signal; they give each pixel's random uncertainty,
        s^2 = K (DN - d) + dark_noise^2 (EMVA 1288).
    vignetting : Vignetting or None
        V; None for no vignetting.
    gain_db : float
        Gain the conversion is valid for.
    range_cd_m2 : (float, float)
        Lowest and highest luminance the conversion is valid for.
    """

    responsivity_dn_s_cd_m2: float
    responsivity_common_rel: float
    dark_offset_dn: float
    dark_rate_dn_s: float
    k_dn_per_e: float
    dark_noise_dn: float
    vignetting: Vignetting | None
    gain_db: float
    range_cd_m2: tuple[float, float]

    def __post_init__(self) -> None:
        if not (np.isfinite(self.responsivity_dn_s_cd_m2) and self.responsivity_dn_s_cd_m2 > 0):
            raise InputError(
                f"responsivity_dn_s_cd_m2 is {self.responsivity_dn_s_cd_m2}: a camera that sees light has a "
                "positive one"
            )

    def dark_dn(self, exposure_s: float) -> float:
        """Mean DN of dark signal at an exposure time."""
        return self.dark_offset_dn + self.dark_rate_dn_s * exposure_s

    def dn_per_cd_m2(self, frame: Frame) -> NDArray[np.float64] | float:
        """Slope of DN over luminance for a frame: a number, or one for each pixel with vignetting."""
        slope = self.responsivity_dn_s_cd_m2 * frame.exposure_s
        if self.vignetting is None:
            return slope
        return slope * self.vignetting.relative_illuminance(frame.shape)

    def to_luminance(self, frame: Frame) -> LuminanceMap:
        """Convert a frame to luminance.

        A pixel counts as outside the calibrated range if it is so by more than three standard deviations of its noise.

        Raises
        ------
        CalibrationError
            If the frame was taken with another gain, or has a colour filter.
        """
        if abs(frame.gain_db - self.gain_db) > 1e-6:
            raise CalibrationError(
                f"the conversion is for a gain of {self.gain_db:g} dB, the frame was taken with "
                f"{frame.gain_db:g} dB: take the frame with the calibrated gain, or calibrate at this one"
            )
        if frame.colour_filter is not None:
            raise CalibrationError(
                f"the frame has a colour filter ({frame.colour_filter}), the conversion is for a monochrome "
                "sensor: use a monochrome pixel format"
            )
        net = frame.dn - self.dark_dn(frame.exposure_s)
        slope = self.dn_per_cd_m2(frame)
        luminance = net / slope
        noise_dn = np.sqrt(self.k_dn_per_e * np.maximum(net, 0) + self.dark_noise_dn**2)
        with np.errstate(divide="ignore", invalid="ignore"):
            random_rel = np.where(net > 0, noise_dn / net, np.inf)
        low, high = self.range_cd_m2
        invalid = np.where(frame.saturated, Invalid.SATURATED, 0).astype(np.uint8)
        invalid |= np.where(net < 0, Invalid.BELOW_BLACK, 0).astype(np.uint8)
        # Noise alone must not push half the pixels of the darkest and of the brightest calibrated patch out.
        margin = RANGE_MARGIN * noise_dn / slope
        outside = (luminance < low - margin) | (luminance > high + margin)
        invalid |= np.where(outside, Invalid.OUTSIDE_CALIBRATED, 0).astype(np.uint8)
        common = (CommonError("responsivity", self.responsivity_common_rel),)
        return LuminanceMap(luminance, random_rel, common, invalid)
