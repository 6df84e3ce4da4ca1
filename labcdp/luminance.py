"""LuminanceMap, and the conversion of frames to it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from .errors import CalibrationError, InputError
from .frame import Frame

#: Standard deviations of its noise a pixel may lie beyond the calibrated range.
_RANGE_MARGIN = 3.0


class Invalid(IntFlag):
    """Why a pixel of a luminance map is not valid; 0 means it is."""

    SATURATED = 1
    BELOW_BLACK = 2
    OUTSIDE_CALIBRATED = 4


@dataclass(frozen=True, eq=False)
class LuminanceMap:
    """Luminance for each pixel, with its uncertainty and the reasons why a pixel is not valid.

    Parameters
    ----------
    luminance_cd_m2 : ndarray of float, shape (height, width)
        Luminance; also given for pixels that are not valid.
    random_rel : ndarray of float, shape (height, width)
        Relative standard uncertainty that differs from pixel to pixel (noise), as a fraction.
    common_rel : float
        Relative standard uncertainty shared by all pixels (meter scale, fit), which cancels in contrasts.
    invalid : ndarray of uint8, shape (height, width)
        `Invalid` flags, 0 where the pixel is valid.
    """

    luminance_cd_m2: NDArray[np.floating[Any]]
    random_rel: NDArray[np.floating[Any]]
    common_rel: float
    invalid: NDArray[np.uint8]

    def __post_init__(self) -> None:
        shapes = {self.luminance_cd_m2.shape, self.random_rel.shape, self.invalid.shape}
        if len(shapes) != 1 or self.luminance_cd_m2.ndim != 2:
            raise InputError(f"the arrays of a luminance map are 2-D of one shape, got {sorted(shapes)}")

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Mask of the pixels that are valid."""
        return np.equal(self.invalid, 0)


@dataclass(frozen=True)
class Cos4Vignetting:
    """Natural light fall-off of a lens, cos^4 of the off-axis angle; 1 on the axis.

    Parameters
    ----------
    focal_length_m, pixel_pitch_m : float
        Image-side focal length and distance of pixel centres, in metres.

    Raises
    ------
    InputError
        If a value is not a positive number.
    """

    focal_length_m: float
    pixel_pitch_m: float

    def __post_init__(self) -> None:
        for name in ("focal_length_m", "pixel_pitch_m"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise InputError(f"{name} is {value}: give a positive number of metres")

    def relative_illuminance(self, shape: tuple[int, int]) -> NDArray[np.float64]:
        """Illuminance relative to the axis, for a sensor of `shape` (height, width) centred on it.

        cos(theta) = 1 / sqrt(1 + r^2 / f^2) with r the distance from the axis and f the focal length.
        """
        height, width = shape
        scale = self.pixel_pitch_m / self.focal_length_m
        y = (np.arange(height) - (height - 1) / 2) * scale
        x = (np.arange(width) - (width - 1) / 2) * scale
        result: NDArray[np.float64] = np.add.outer(1 + y**2, x**2)
        # In place: for a large sensor each intermediate would be a third of all memory.
        result *= result
        return np.reciprocal(result, out=result)


class Conversion(Protocol):
    """A monotone map from DN to cd/m^2; the evaluation does not know who made it."""

    def to_luminance(self, frame: Frame) -> LuminanceMap:
        """Convert a frame; raises CalibrationError if the conversion is not for such frames."""


@dataclass(frozen=True)
class LinearConversion:
    """L = (DN - d(t)) / (R t V(x, y)), with the darkness d(t) = `dark_offset_dn` + `dark_rate_dn_s` t.

    Parameters
    ----------
    responsivity_dn_s_cd_m2 : float
        R, DN per second and cd/m^2 on the optical axis (DN s^-1 / (cd m^-2)), at `gain_db`.
    responsivity_common_rel : float
        Relative standard uncertainty of R, common to all pixels.
    dark_offset_dn, dark_rate_dn_s : float
        Darkness at zero exposure, and its growth per second.
    k_dn_per_e, dark_noise_dn : float
        Overall system gain K and temporal noise in darkness; they give each pixel's random uncertainty,
        s^2 = K (DN - d) + dark_noise^2 (EMVA 1288).
    vignetting : Cos4Vignetting or None
        V; None for no fall-off.
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
    vignetting: Cos4Vignetting | None
    gain_db: float
    range_cd_m2: tuple[float, float]

    def __post_init__(self) -> None:
        if not (np.isfinite(self.responsivity_dn_s_cd_m2) and self.responsivity_dn_s_cd_m2 > 0):
            raise InputError(
                f"responsivity_dn_s_cd_m2 is {self.responsivity_dn_s_cd_m2}: a camera that sees light has a "
                "positive one"
            )

    def dark_dn(self, exposure_s: float) -> float:
        """Mean DN of darkness at an exposure time."""
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
        margin = _RANGE_MARGIN * noise_dn / slope
        outside = (luminance < low - margin) | (luminance > high + margin)
        invalid |= np.where(outside, Invalid.OUTSIDE_CALIBRATED, 0).astype(np.uint8)
        return LuminanceMap(luminance, random_rel, self.responsivity_common_rel, invalid)
