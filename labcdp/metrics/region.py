"""One region of a luminance map: its pixels, and their luminance with its uncertainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import hypot, isfinite, nan, sqrt
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError
from ..core.luminance import WHOLE, CommonError, Invalid, LuminanceMap, Window
from ..core.quantity import Quantity
from ..core.roi import Roi
from . import Distribution, snr
from .detection import NoisyRegion

#: Reasons for invalid pixels.
REASONS = {reason: str(reason.name).lower() for reason in Invalid}
#: Share of saturated pixels from which the mean of a region is a bound only.
SATURATED_SHARE = 0.01
#: How a value is bounded: the true one is larger or smaller, not known, or the value itself.
Bound = Literal[">", "<", "?", ""]
#: An error of the calibration beyond the light itself leaves at least this part of it.
LEAST_FACTOR = 1e-3
_Array = NDArray[np.float64]
#: Values with and without an error.
_Values: TypeAlias = _Array | float


@dataclass(frozen=True)
class RegionLight:
    """Luminance of a region, in the unit of the map.

    Parameters
    ----------
    roi : Roi
        The region.
    n_pixels : int
        Number of its pixels, valid or not.
    mean, u : float
        Mean, with the standard uncertainty by the scatter of the pixels, which may be correlated, by their rounding to
        DN, and by the calibration; nan for a single pixel, for a guessed scale of unknown uncertainty, and if it is
        saturated.
    std : float
        Standard deviation of the pixels, with n - 1.
    snr : Quantity
        Mean over standard deviation, with its standard uncertainty; nan if it is saturated.
    invalid_shares : dict of str to float
        Share of invalid pixels by reason (`REASONS`); only reasons that occur.
    """

    roi: Roi
    n_pixels: int
    mean: float
    u: float
    std: float
    snr: Quantity
    invalid_shares: dict[str, float]

    def clipped(self) -> RegionLight:
        """Return the region as one whose pixels are all saturated: its mean is a bound."""
        unknown = Quantity(nan, nan)
        return replace(
            self, u=nan, snr=unknown, invalid_shares={**self.invalid_shares, REASONS[Invalid.SATURATED]: 1.0}
        )

    @property
    def bound(self) -> Bound:
        """Whether the luminance is larger than `mean`, as pixels are saturated."""
        return ">" if is_saturated(self.invalid_shares) else ""


def mean_light(luminance: LuminanceMap, roi: Roi, mask: NDArray[np.bool_]) -> tuple[float, float]:
    """Return the mean of a region of a map, and the share of its pixels that are saturated.

    Parameters
    ----------
    luminance : LuminanceMap
        The bounding box of the region.
    roi : Roi
        The region.
    mask : ndarray of bool
        Its pixels in the map.

    Raises
    ------
    InputError
        If a pixel is not finite.
    """
    image, invalid = luminance.luminance_cd_m2, luminance.invalid
    values = image if mask.all() else image[mask]
    mean = float(values.sum(dtype=np.float64)) / values.size
    if not isfinite(mean):
        raise _not_finite(roi, values)
    saturated = float(np.mean(invalid[mask] & Invalid.SATURATED.value != 0)) if invalid.any() else 0.0
    return mean, saturated


def _not_finite(roi: Roi, values: NDArray[np.floating[Any]]) -> InputError:
    n_unusable = int(np.count_nonzero(~np.isfinite(values)))
    return InputError(
        f"region {roi.name!r} has {n_unusable} pixels that are not finite: correct the image, or draw the region "
        "without them"
    )


def evaluate_region(luminance: LuminanceMap, roi: Roi) -> RegionLight:
    """Evaluate one region of a map, of which only its bounding box is used.

    Raises
    ------
    InputError
        If the region, in pixels of the image, lies outside it, contains no pixel or a non-finite one.
    """
    return measure_region(RegionPixels.from_map(luminance, roi))


def measure_region(region: RegionPixels) -> RegionLight:
    """Evaluate one region as `evaluate_region`."""
    errors = [*region.common, *region.region_errors, *region.smooth]
    ratio = snr(region.distribution)
    changed = [[snr(region.changed(sign * x)).value for sign in (1, -1)] for x in errors if x.ndim]
    return region_light(region, errors, ratio, float(variance_of_changes(ratio.value, changed)))


@dataclass(frozen=True, eq=False)
class RegionPixels(NoisyRegion):
    """A region of a luminance map, with the errors of its pixels.

    Parameters
    ----------
    image, mask, distribution, window
        As for `NoisyRegion`.
    roi : Roi
        The region.
    luminance : LuminanceMap
        A map of the image, or of a part of it.
    part : (slice, slice)
        Bounding box of the region in that map.
    """

    roi: Roi
    luminance: LuminanceMap
    part: Window

    @classmethod
    def from_map(cls, luminance: LuminanceMap, roi: Roi) -> RegionPixels:
        """Take a region from a map; raises InputError as `evaluate_region`."""
        region = luminance.scaled(roi)
        window = region.window(luminance.shape)
        return cls.from_part(luminance, roi, window, region.mask(luminance.shape), window)

    @classmethod
    def from_part(
        cls,
        luminance: LuminanceMap,
        roi: Roi,
        window: Window,
        mask: NDArray[np.bool_],
        part: Window = WHOLE,
        dn: NDArray[np.unsignedinteger[Any]] | None = None,
    ) -> RegionPixels:
        """Take a region from a map of a part of an image; 8-bit DN of its bounding box make that faster."""
        image = luminance.luminance_cd_m2[part].astype(np.float64, order="C")
        values = image[mask]
        if not np.isfinite(values).all():
            raise _not_finite(roi, values)
        distribution = None if dn is None else _distribution_by_dn(dn[mask], values)
        return cls(image, mask, distribution or Distribution.from_array(values), window, roi, luminance, part)

    @property
    def placed(self) -> tuple[Roi, Window, NDArray[np.bool_]]:
        """The region with its bounding box in the image."""
        return self.roi, self.window, self.mask

    @cached_property
    def values(self) -> _Array:
        """Its pixels, shape (n,)."""
        return self.image[self.mask]

    @cached_property
    def invalid_shares(self) -> dict[str, float]:
        """Share of the pixels that are invalid for a reason, by its name; without reasons that no pixel has."""
        flags = self.luminance.invalid[self.part][self.mask]
        shares = {name: float(np.mean(flags & reason != 0)) for reason, name in REASONS.items()} if flags.any() else {}
        return {name: share for name, share in shares.items() if share}

    @cached_property
    def _common_errors(self) -> tuple[CommonError, ...]:
        return self.luminance.common_in(self.part)

    @cached_property
    def _calibration_errors(self) -> list[NDArray[np.floating[Any]] | float]:
        """Relative errors common to all pixels of the image: numbers, or one for each pixel of the region."""
        errors = [error.relative for error in self._common_errors if not error.smooth]
        return [float(error) if np.ndim(error) == 0 else np.asarray(error)[self.mask] for error in errors]

    @cached_property
    def common(self) -> list[_Array]:
        """Relative errors common to all pixels of the image, with 0 where they are not finite."""
        return [finite_errors(error) for error in self._calibration_errors]

    @cached_property
    def smooth(self) -> list[_Array]:
        """Relative errors common to all pixels of the image that hardly change within the region: one number each."""
        errors = (np.broadcast_to(error.relative, self.mask.shape) for error in self._common_errors if error.smooth)
        return [np.array(np.mean(error[self.mask], dtype=float)) for error in errors]

    @property
    def scale_known(self) -> bool:
        """Whether the scale is known, not guessed."""
        return all(isfinite(error) for error in self._calibration_errors if isinstance(error, float))

    @cached_property
    def region_errors(self) -> list[_Array]:
        """Relative errors common to its pixels only: vignetting and dark signal."""
        slow_rel, slow_cd_m2 = self.luminance.slow_rel, self.luminance.slow_cd_m2
        errors = [np.asarray(slow_rel)] if slow_rel else []
        if np.any(slow_cd_m2):
            darkness = np.broadcast_to(slow_cd_m2, self.luminance.shape)[self.part][self.mask]
            with np.errstate(divide="ignore", invalid="ignore"):
                errors.append(darkness / np.abs(self.values))
        return [finite_errors(error) for error in errors if np.any(error)]

    @property
    def mean(self) -> float:
        """Mean of the pixels."""
        return self.distribution.mean

    @property
    def std(self) -> float:
        """Standard deviation of the pixels with n - 1; nan for one."""
        return sqrt(self.distribution.variance)

    @property
    def random(self) -> float:
        """Standard uncertainty of the mean by the pixels only."""
        return self.std * sqrt(self.inflation / self.values.size)

    @cached_property
    def rounding(self) -> float:
        """Standard uncertainty of the mean by the rounding to whole DN, where noise does not dither it."""
        steps = self.luminance.dn_step_in(self.part)
        return 0.0 if steps is None else rounding_uncertainty(self.std, float(np.mean(steps[self.mask])))

    @property
    def rounding_rel(self) -> float:
        """Rounding uncertainty relative to the mean; 0 where the mean is not above 0."""
        return self.rounding / self.mean if self.mean > 0 else 0.0

    def changed(self, relative: _Array) -> Distribution:
        """Distribution of the pixels with a relative error."""
        if not np.any(relative):
            return self.distribution
        if np.ndim(relative) == 0:
            counts = self.distribution.weights.astype(np.int64)
            return Distribution(with_error(self.distribution.values, relative), counts)
        return Distribution.from_array(with_error(self.values, relative))


def _distribution_by_dn(dn: NDArray[np.unsignedinteger[Any]], light: _Array) -> Distribution | None:
    """Distribution, without sorting, of 8-bit pixels whose luminance depends only on the DN; None for others."""
    light_by_dn = np.empty(256)
    light_by_dn[dn] = light
    counts = np.bincount(dn, minlength=256)
    levels = np.flatnonzero(counts)
    values = light_by_dn[levels]
    # Several DN may have the same luminance, and a response may decrease.
    alike = np.array_equal(light_by_dn[dn], light)
    return Distribution(values, counts[levels]) if alike and (values[1:] > values[:-1]).all() else None


def is_saturated(invalid_shares: Mapping[str, float]) -> bool:
    """Whether so many pixels of a region are saturated that its mean is a bound only."""
    return invalid_shares.get(REASONS[Invalid.SATURATED], 0.0) > SATURATED_SHARE


def region_light(pixels: RegionPixels, errors: Sequence[_Array], ratio: Quantity, ratio_variance: float) -> RegionLight:
    """Make the result of a region, given its SNR and the variance these errors add to it."""
    by_calibration = [float(np.mean(error * pixels.values)) for error in errors] if pixels.scale_known else [nan]
    saturated = is_saturated(pixels.invalid_shares)
    return RegionLight(
        roi=pixels.roi,
        n_pixels=pixels.values.size,
        mean=pixels.mean,
        u=nan if saturated else hypot(pixels.random, pixels.rounding, *by_calibration),
        std=pixels.std,
        # What clipping takes from the noise is no signal.
        snr=Quantity(nan, nan) if saturated else with_uncertainty(ratio, pixels.inflation, ratio_variance),
        invalid_shares=pixels.invalid_shares,
    )


def with_uncertainty(metric: Quantity, inflation: float, variance: float) -> Quantity:
    """Return a quantity with an uncertainty for correlated noise and calibration.

    The inflation is that of the pixels, an upper bound for functions of them.
    """
    return Quantity(metric.value, sqrt(metric.u**2 * inflation + variance))


def finite_errors(relative: NDArray[np.floating[Any]] | float) -> _Array:
    """Replace errors by 0 where a pixel is exactly at the dark signal and relative errors are undefined.

    A non-finite number, of an unknown scale, is common to all pixels and does not affect ratios.
    """
    values = np.asarray(relative, dtype=float)
    return np.where(np.isfinite(values), values, 0.0)


def rounding_uncertainty(std: float, step: float) -> float:
    """Return the standard uncertainty by which rounding to whole DN shifts the mean of pixels, in luminance.

    Parameters
    ----------
    std : float
        Standard deviation of the pixels after rounding; nan for a single one.
    step : float
        Mean luminance difference between successive DN; 0 where nothing was rounded.

    Returns
    -------
    float
        step / sqrt(12) where all pixels have one DN, 0 where they scatter by half a DN or more: noise then dithers the
        rounding (B. Widrow and I. Kollar, Quantization Noise, 2008).

    Notes
    -----
    sqrt((1/4 - s^2) / 3) for s = std / step: pixels with noise of less than half a DN have two DN, a share p of them
    the upper one, and s^2 = p (1 - p). With negligible noise the true value lies midway between both, and the error of
    the mean is 1/2 - p; with more noise it is smaller. Errors in between are assumed to be equally likely.
    """
    if not step > 0:
        return 0.0
    return step * sqrt(max(0.25 - (std / step if std >= 0 else 0.0) ** 2, 0.0) / 3)


def with_error(values: NDArray[np.floating[Any]], relative: ArrayLike) -> NDArray[np.float64]:
    """Return values with a relative error, which leaves at least `LEAST_FACTOR` of them: no light is negative.

    Errors of single values, as of the dark signal, may make some of them negative, but not all.
    """
    error = np.asarray(relative, dtype=float)
    changed: NDArray[np.float64] = values * (light_factor(error) if error.ndim == 0 else 1 + error)
    if changed.max(initial=0.0) <= 0 < values.max(initial=0.0):
        changed = values * np.float64(LEAST_FACTOR)
    return changed


def light_factor(relative: NDArray[np.float64]) -> float:
    """Return the factor on the light of a whole region by a relative error, at least `LEAST_FACTOR`."""
    return max(1 + float(relative), LEAST_FACTOR)


def variance_of_changes(base: _Values, changed: Sequence[Sequence[_Values]]) -> NDArray[np.float64]:
    """Sum over the errors of the mean square of the two changes by each.

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
