"""One region of a luminance map: its pixels, and their luminance with its uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import hypot, isfinite, nan, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..contrast import Distribution, Estimate, snr
from ..errors import InputError
from ..luminance import Invalid, LuminanceMap
from ..roi import Roi
from .dn_rounding import rounding_uncertainty
from .noise_correlation import noise_inflation

#: What a reason for pixels that are not valid is called for a person.
REASONS = {
    Invalid.SATURATED: "saturated",
    Invalid.BELOW_BLACK: "below the black",
    Invalid.OUTSIDE_CALIBRATED: "outside the calibrated range",
    Invalid.DEFECT: "defect",
    Invalid.INCONSISTENT: "different between the exposures",
}
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
        Mean, with the standard uncertainty by the scatter of the pixels, which may be correlated, by their rounding to
        DN, and by the calibration; nan for a single pixel, and where a guessed scale has no uncertainty to state.
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
    dn_steps: NDArray[np.floating[Any]] | float

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
        steps = luminance.dn_step_in(window)
        return cls(
            roi=roi,
            window=window,
            image=image,
            mask=mask,
            values=values,
            distribution=Distribution.from_array(values),
            inflation=noise_inflation(image, mask),
            scale_known=all(map(isfinite, of_all)),
            dn_steps=0.0 if steps is None else steps[mask],
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

    @cached_property
    def rounding(self) -> float:
        """Standard uncertainty of the mean by the rounding to whole DN, where noise does not dither it."""
        return rounding_uncertainty(self.std, self.dn_steps)

    @property
    def rounding_rel(self) -> float:
        """The same relative to the mean; 0 where that is not above 0."""
        return self.rounding / self.mean if self.mean > 0 else 0.0

    def changed(self, relative: _Array) -> Distribution:
        """Distribution of the pixels with a relative error."""
        return Distribution.from_array(self.values * (1 + relative)) if np.any(relative) else self.distribution


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
        standard_uncertainty=hypot(pixels.random, pixels.rounding, *of_calibration),
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
