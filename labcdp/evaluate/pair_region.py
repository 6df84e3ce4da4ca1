"""One region of a luminance map: its pixels, and their luminance with its uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import hypot, isfinite, nan, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..contrast import Distribution, Estimate, snr, variance_inflation
from ..errors import InputError
from ..luminance import Invalid, LuminanceMap
from ..roi import Roi

#: What a reason for pixels that are not valid is called for a person.
REASONS = {
    Invalid.SATURATED: "saturated",
    Invalid.BELOW_BLACK: "below the black",
    Invalid.OUTSIDE_CALIBRATED: "outside the calibrated range",
    Invalid.DEFECT: "defect",
    Invalid.INCONSISTENT: "different between the exposures",
}
#: Ratio of variances from which a change across a region is none of noise. Patterns of rows and columns reach 10.
_SIGNIFICANT_CHANGE = 30.0
#: Share of a variance that is due to the digits of floats.
_ROUNDING = 1e-10
_Array = NDArray[np.float64]


@dataclass(frozen=True)
class RegionResult:
    """Luminance of a region, in the unit of the map.

    Parameters
    ----------
    roi : Roi
        The region.
    n_pixels : int
        Its pixels, all of which count, valid or not.
    mean, standard_uncertainty : float
        Mean, with the standard uncertainty by the scatter of the pixels, which may be correlated, and by the
        calibration; nan for a single pixel, and where a guessed scale has no uncertainty to state.
    std : float
        Standard deviation of the pixels, with n - 1.
    snr : Estimate
        Mean over standard deviation, with its standard uncertainty.
    invalid_shares : dict of str to float
        Share of the pixels that are not valid for a reason (`REASONS`); only reasons that occur.
    """

    roi: Roi
    n_pixels: int
    mean: float
    standard_uncertainty: float
    std: float
    snr: Estimate
    invalid_shares: dict[str, float]


def evaluate_region(luminance: LuminanceMap, roi: Roi) -> RegionResult:
    """Evaluate one region of a map.

    Parameters
    ----------
    luminance : LuminanceMap
        The map; only its rows and columns that hold the region are used.
    roi : Roi
        The region, in pixels of the image.

    Raises
    ------
    InputError
        If the region lies outside the image, holds no pixel, or one that is not a finite number.
    """
    region = RegionPixels.of(luminance, roi)
    errors = [finite_errors(error.relative) for error in luminance.common_of(roi) + luminance.slow_of(roi)]
    ratio = snr(region.distribution)
    changed = [[snr(region.changed(sign * x)).value for sign in (1, -1)] for x in errors if x.ndim]
    return region_result(region, luminance, errors, ratio, float(variance_of_changes(ratio.value, changed)))


@dataclass(frozen=True, eq=False)
class RegionPixels:
    """Rows and columns of a map that hold a region, the region in them, and how correlated its noise is."""

    roi: Roi
    window: tuple[slice, slice]
    image: _Array
    mask: NDArray[np.bool_]
    values: _Array
    distribution: Distribution
    inflation: float
    scale_known: bool

    @classmethod
    def of(cls, luminance: LuminanceMap, roi: Roi) -> RegionPixels:
        """Take a region from a map; raises InputError as `evaluate_region`."""
        region = luminance.scaled(roi)
        window, mask = region.window(luminance.shape), region.mask(luminance.shape)
        image = luminance.luminance_cd_m2[window].astype(np.float64)
        values = image[mask]
        unusable = int(np.count_nonzero(~np.isfinite(values)))
        if unusable:
            raise InputError(
                f"region {roi.name!r} holds {unusable} pixels that are not finite numbers: mend the image, or draw the "
                "region without them"
            )
        one_pixel = (slice(window[0].start, window[0].start + 1), slice(window[1].start, window[1].start + 1))
        of_all = [float(error.relative) for error in luminance.common_in(one_pixel) if np.ndim(error.relative) == 0]
        return cls(
            roi=roi,
            window=window,
            image=image,
            mask=mask,
            values=values,
            distribution=Distribution.from_array(values),
            inflation=noise_inflation(image, mask),
            scale_known=all(map(isfinite, of_all)),
        )

    @cached_property
    def mean(self) -> float:
        """Mean of the pixels."""
        return float(self.values.mean())

    @cached_property
    def std(self) -> float:
        """Standard deviation of the pixels with n - 1; nan for one."""
        return float(self.values.std(ddof=1)) if self.values.size > 1 else nan

    @property
    def random(self) -> float:
        """Standard uncertainty of the mean by the pixels alone."""
        return self.std * sqrt(self.inflation / self.values.size)

    def changed(self, relative: _Array) -> Distribution:
        """Distribution of the pixels with a relative error."""
        return Distribution.from_array(self.values * (1 + relative)) if np.any(relative) else self.distribution


def noise_inflation(image: _Array, mask: NDArray[np.bool_]) -> float:
    """Factor by which noise that is correlated from pixel to pixel raises the variance of a region's mean.

    A slow change across the region, of the light or by the lens' fall-off, is the same in each picture, and no noise.
    Where the surface of second degree that fits best explains far more of the variance than noise would, it is taken
    off. Without that condition a part of the noise went with it, above all of patterns of rows and columns.

    Parameters
    ----------
    image : ndarray of float, shape (height, width)
        Rows and columns that hold the region.
    mask : ndarray of bool, shape (height, width)
        Its pixels.

    Returns
    -------
    float
        As from `labcdp.contrast.variance_inflation`; 1 if all pixels are equal.
    """
    inflation = variance_inflation(image, mask)
    if not inflation > 1:
        return 1.0
    values = image[mask]
    y, x = (2 * place / length - 1 for place, length in zip(np.nonzero(mask), mask.shape, strict=True))
    design = np.stack([np.ones(values.size), x, y, x * x, x * y, y * y])
    factors = np.linalg.lstsq(design @ design.T, design @ values, rcond=None)[0]
    level = np.zeros(image.shape)
    level[mask] = values - factors @ design
    left = float(level[mask].var())
    if left <= _ROUNDING * float(values.var()):
        return 1.0
    without = max(variance_inflation(level, mask), 1.0)
    # Ratio of variances as in an F test, for as many independent pixels as there seem to be.
    ratio = (float(values.var()) - left) / (len(design) - 1) / (left * without / values.size)
    return without if ratio > _SIGNIFICANT_CHANGE else inflation


def region_result(
    pixels: RegionPixels, luminance: LuminanceMap, errors: Sequence[_Array], ratio: Estimate, ratio_variance: float
) -> RegionResult:
    """Report a region, with the errors of its pixels, its SNR and what these errors add to the variance of that."""
    flags = luminance.invalid[pixels.window][pixels.mask]
    shares = {name: float(np.mean(flags & reason != 0)) for reason, name in REASONS.items()} if flags.any() else {}
    of_calibration = [float(np.mean(error * pixels.values)) for error in errors] if pixels.scale_known else [nan]
    return RegionResult(
        roi=pixels.roi,
        n_pixels=pixels.values.size,
        mean=pixels.mean,
        standard_uncertainty=hypot(pixels.random, *of_calibration),
        std=pixels.std,
        snr=with_uncertainty(ratio, pixels.inflation, ratio_variance),
        invalid_shares={name: share for name, share in shares.items() if share},
    )


def variance_of_changes(base: _Array | float, changed: Sequence[Sequence[_Array | float]]) -> _Array:
    """Sum over the errors of the mean square of the two changes that each makes.

    Parameters
    ----------
    base : ndarray of float, shape (k,), or float
        Values without an error.
    changed : sequence of two ndarray of float, shape (k,), or two floats
        For each error, the values with it added and with it subtracted.

    Returns
    -------
    ndarray of float, shape (k,) or ()
        nan where a value is not finite.
    """
    variance = np.zeros(np.shape(base))
    with np.errstate(invalid="ignore"):
        for both in changed:
            variance = variance + np.square(np.asarray(both) - base).mean(axis=0)
    return variance


def with_uncertainty(metric: Estimate, inflation: float, variance: float) -> Estimate:
    """Estimate with an uncertainty for correlated noise and calibration.

    The inflation is that of the pixels, the most that a function of them can have.
    """
    return Estimate(metric.value, sqrt(metric.standard_error**2 * inflation + variance))


def finite_errors(relative: NDArray[np.floating[Any]] | float) -> _Array:
    """Put 0 where a pixel is exactly at the darkness: it has no relative error, and nothing is seen there.

    A number that is not finite, of a scale that nobody knows, is one that all pixels share: ratios do not feel it.
    """
    values = np.asarray(relative, dtype=float)
    return np.where(np.isfinite(values), values, 0.0)
