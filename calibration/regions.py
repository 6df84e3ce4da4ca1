"""Luminance of regions of a map, and contrasts between them, with what their uncertainties share taken out."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import CalibrationError
from ..luminance import CommonError, Invalid, LuminanceMap
from ..roi import Roi
from .signal_limits import MAX_CLIPPED_SHARE
from .uncertainty import expanded_half_width


@dataclass(frozen=True)
class RegionLuminance:
    """Mean luminance of a region.

    Parameters
    ----------
    name : str
        Name of the region.
    mean_cd_m2 : float
        Mean over the pixels in use.
    random_cd_m2 : float
        Standard uncertainty of the mean by noise and pattern from pixel to pixel, which average down.
    slow_cd_m2 : float
        Standard uncertainty of the mean by slow changes across the image, which do not.
    common : tuple of CommonError
        Errors shared with other regions of the map; `relative` is the signed number of this region's mean.
    n_pixels : int
        Pixels in use.
    invalid_share : float
        Share of the region's pixels with any `Invalid` flag.
    """

    name: str
    mean_cd_m2: float
    random_cd_m2: float
    slow_cd_m2: float
    common: tuple[CommonError, ...]
    n_pixels: int
    invalid_share: float

    @property
    def random_rel(self) -> float:
        """Relative standard uncertainty that differs from region to region."""
        return hypot(self.random_cd_m2, self.slow_cd_m2) / self.mean_cd_m2

    @property
    def common_rel(self) -> float:
        """Relative standard uncertainty by all common errors."""
        return hypot(*(float(e.relative) for e in self.common))

    @property
    def standard_uncertainty_cd_m2(self) -> float:
        """Combined standard uncertainty of the mean luminance."""
        return abs(self.mean_cd_m2) * hypot(self.random_rel, self.common_rel)

    @property
    def interval_95_cd_m2(self) -> tuple[float, float]:
        """Ends of the 95 % interval."""
        errors = [(float(e.relative), e.rectangular) for e in self.common]
        half_width = abs(self.mean_cd_m2) * _half_width_95(errors, self.random_rel)
        return self.mean_cd_m2 - half_width, self.mean_cd_m2 + half_width


@dataclass(frozen=True)
class RegionContrast:
    """Weber contrast between the mean luminances of two regions, L_bright / L_dark - 1.

    Parameters
    ----------
    contrast : float
        As a fraction.
    standard_uncertainty : float
        Its standard uncertainty.
    interval_95 : (float, float)
        Ends of the 95 % interval.
    bright, dark : RegionLuminance
        The regions.
    """

    contrast: float
    standard_uncertainty: float
    interval_95: tuple[float, float]
    bright: RegionLuminance
    dark: RegionLuminance


def region_luminance(luminance: LuminanceMap, roi: Roi) -> RegionLuminance:
    """Mean luminance of a region of a map.

    Pixels that are defect or inconsistent are left out. Pixels below the black or out of the calibrated range are not:
    leaving out one side of the noise would shift the mean. The noise is that of the map or, if larger, the difference
    of neighbours in a row, which a pattern of the pixels without a flat field adds to; it is taken to be independent
    from pixel to pixel. `LuminanceMap.slow_rel` and `slow_cd_m2` are taken to be one error for the whole region.

    Parameters
    ----------
    luminance : LuminanceMap
        The map.
    roi : Roi
        The region, in pixels of the image.

    Raises
    ------
    InputError
        If the region lies outside the map or holds no pixel.
    CalibrationError
        If more than `MAX_CLIPPED_SHARE` of its pixels are saturated, it has no usable pixel or no light.
    """
    region = luminance.scaled(roi)
    values = luminance.select(roi).astype(float)
    invalid = region.select(luminance.invalid)
    saturated = float(np.mean(np.not_equal(invalid & Invalid.SATURATED, 0)))
    if saturated > MAX_CLIPPED_SHARE:
        raise CalibrationError(
            f"{saturated:.1%} of the pixels of region {roi.name!r} are saturated, so its luminance is only known to be "
            "higher: use a shorter exposure"
        )
    used = np.equal(invalid & (Invalid.SATURATED | Invalid.DEFECT | Invalid.INCONSISTENT), 0)
    n = int(np.count_nonzero(used))
    if n == 0:
        raise CalibrationError(f"region {roi.name!r} has no usable pixel: choose another")
    kept = values[used]
    mean = float(kept.mean())
    if mean <= 0:
        raise CalibrationError(f"region {roi.name!r} is not brighter than the dark: use a longer exposure")
    stated = float(np.mean((region.select(luminance.random_rel)[used] * kept) ** 2))
    seen = _neighbour_variance(luminance, region)
    common = tuple(
        CommonError(
            e.source,
            float(e.relative) if np.ndim(e.relative) == 0 else float(np.asarray(e.relative)[used] @ kept / (n * mean)),
            e.rectangular,
        )
        for e in luminance.common_of(roi)
    )
    random_cd_m2 = sqrt(max(stated, seen) / n)
    share = float(np.mean(np.not_equal(invalid, 0)))
    slow = luminance.slow_cd_m2
    slow_cd_m2 = float(slow) if np.ndim(slow) == 0 else float(region.select(np.asarray(slow))[used].mean())
    slow_cd_m2 = hypot(luminance.slow_rel * mean, slow_cd_m2)
    return RegionLuminance(roi.name, mean, random_cd_m2, slow_cd_m2, common, n, share)


def region_contrast(luminance: LuminanceMap, bright: Roi, dark: Roi) -> RegionContrast:
    """Weber contrast between two regions of a map.

    Common errors are numbers shared by both regions: the signed relative errors of the two are subtracted, so that
    the meter's scale cancels and the fit and the darkness nearly do. What differs from pixel to pixel, and slow changes
    across the image, are independent for the two.

    Parameters
    ----------
    luminance : LuminanceMap
        The map.
    bright, dark : Roi
        The regions, without common pixels.

    Raises
    ------
    InputError, CalibrationError
        As `region_luminance`.
    """
    a, b = region_luminance(luminance, bright), region_luminance(luminance, dark)
    ratio = a.mean_cd_m2 / b.mean_cd_m2
    differences = [
        (float(x.relative) - float(y.relative), x.rectangular) for x, y in zip(a.common, b.common, strict=True)
    ]
    independent = hypot(a.random_rel, b.random_rel)
    half_width = ratio * _half_width_95(differences, independent)
    return RegionContrast(
        contrast=ratio - 1,
        standard_uncertainty=ratio * hypot(independent, *(d for d, _ in differences)),
        interval_95=(ratio - 1 - half_width, ratio - 1 + half_width),
        bright=a,
        dark=b,
    )


def _half_width_95(errors: list[tuple[float, bool]], normal: float) -> float:
    """Half width of the 95 % interval; all rectangular errors but the largest count as normal."""
    rectangular = sorted((abs(value) for value, is_rectangular in errors if is_rectangular), reverse=True)
    others = [value for value, is_rectangular in errors if not is_rectangular]
    largest = rectangular[0] if rectangular else 0.0
    return expanded_half_width(sqrt(3) * largest, hypot(normal, *others, *rectangular[1:]))


def _neighbour_variance(luminance: LuminanceMap, region: Roi) -> float:
    """Variance of a pixel by the differences of neighbours in a row: half their mean square."""
    window = region.window(luminance.shape)
    values: NDArray[np.floating[Any]] = luminance.luminance_cd_m2[window].astype(float)
    unusable = Invalid.SATURATED | Invalid.DEFECT | Invalid.INCONSISTENT
    used = region.mask(luminance.shape) & np.equal(luminance.invalid[window] & unusable, 0)
    both = used[:, 1:] & used[:, :-1]
    differences = np.diff(values, axis=1)[both]
    return float(np.mean(differences**2)) / 2 if differences.size else 0.0
