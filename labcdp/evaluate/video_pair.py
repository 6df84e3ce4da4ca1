"""Two regions of a video's frame: their luminance, contrast and CDP, at the speed of a video."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import hypot, isfinite, nan, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..contrast import Distribution, Epsilon, Estimate, csnr, snr, weber_contrast
from ..contrast.pairs import bright_and_dark
from ..contrast.uncertainty import confidence_interval, variance_of_scatters
from ..errors import InputError
from ..frame import Frame
from ..luminance import LuminanceMap, Window
from ..roi import Roi
from .dn_rounding import rounding_uncertainty
from .light import PictureConversion
from .noise_correlation import noise_inflation
from .pair_region import REASONS, with_uncertainty
from .video_tally import ManyContrasts, Tally

_Array = NDArray[np.float64]
#: A window begins and ends at an even pixel, so that it holds whole groups of a colour filter.
_GROUP = 2


@dataclass(frozen=True)
class PairOfFrame:
    """What a frame says about two regions; of what belongs to a region, the first one's comes first.

    Parameters
    ----------
    cdp, standard_uncertainty, low, high, below, above : list of float
        One for each contrast: CDP, its standard uncertainty and 95 % interval by pixels, whose noise may be correlated,
        and calibration, and the shares of pairs with a lower and a higher contrast.
    contrast, contrast_standard_uncertainty : float
        Weber contrast of the means.
    csnr, csnr_standard_uncertainty : float
        Mean over standard deviation of the contrasts of all pairs of pixels.
    mean, mean_standard_uncertainty, snr, snr_standard_uncertainty : list of float
        Of the regions.
    invalid_shares : list of dict
        Share of the pixels of a region that are not valid for a reason.
    """

    cdp: list[float]
    standard_uncertainty: list[float]
    low: list[float]
    high: list[float]
    below: list[float]
    above: list[float]
    contrast: float
    contrast_standard_uncertainty: float
    csnr: float
    csnr_standard_uncertainty: float
    mean: list[float]
    mean_standard_uncertainty: list[float]
    snr: list[float]
    snr_standard_uncertainty: list[float]
    invalid_shares: list[dict[str, float]]


def evaluate_frame_pair(
    frame: Frame, conversion: PictureConversion, rois: Sequence[Roi], contrasts: Sequence[float], epsilon: Epsilon
) -> PairOfFrame:
    """Evaluate two regions of a frame.

    Parameters
    ----------
    frame : Frame
        The frame; only rows and columns around the regions are converted.
    conversion : PictureConversion
        To light.
    rois : sequence of two Roi
        The regions, in any order.
    contrasts : sequence of float
        Contrasts to be detected.
    epsilon : float or DetectionInterval
        Their tolerance.

    Raises
    ------
    InputError
        If a region lies outside the frame or holds no pixel, the regions have pixels in common, or neither has a pixel
        above 0.
    CalibrationError
        If the conversion is not for such frames.

    Notes
    -----
    All values are those of `labcdp.evaluate.pair.evaluate_pair`; what is uncertain about them is estimated in two
    shorter ways, as there are many frames. The correlation of the noise is looked for in the pixels and not in what
    each contrast makes of them, which is the most it can be (see `labcdp.contrast.cdp_correlated`). And an error of the
    calibration counts for a region as one number, its mean over the region's pixels, weighted by their light.
    """
    first, second = (_Region.of(frame, conversion, roi) for roi in rois)
    _require_apart(*((region.roi, region.window, region.mask) for region in (first, second)))
    bright_light, dark_light, name = bright_and_dark(first.light, second.light)
    bright, dark = (first, second) if name == "a" else (second, first)
    many = ManyContrasts.of(contrasts, epsilon)
    tally = many.tally(bright_light, dark_light)
    relative = _relative_errors(bright, dark)
    together = hypot(*((1 + x) / (1 + y) - 1 for x, y in relative)) if relative else 0.0
    by_calibration = np.zeros(len(contrasts))
    ratio = csnr(bright_light, dark_light)
    ratio_variance = 0.0 if isfinite(together) else nan
    if 0 < together < np.inf:
        changed = [_scaled(bright_light, 1 + s * together) for s in (1, -1)]
        by_calibration = np.mean([np.square(many.inside(one, dark_light) - tally.inside) for one in changed], axis=0)
        ratio_variance = float(np.mean([(csnr(one, dark_light).value - ratio.value) ** 2 for one in changed]))
    contrast = float(weber_contrast(bright.mean, dark.mean))
    by_pixels, effective_size = _by_pixels(tally, bright, dark)
    standard = [sqrt(v + c) for v, c in zip(by_pixels, by_calibration, strict=True)]
    intervals = [
        confidence_interval(share, one**2, effective_size)
        for share, one in zip(tally.inside.tolist(), standard, strict=True)
    ]
    return PairOfFrame(
        cdp=tally.inside.tolist(),
        standard_uncertainty=standard,
        low=[low for low, _ in intervals],
        high=[high for _, high in intervals],
        below=tally.below.tolist(),
        above=tally.above.tolist(),
        contrast=contrast,
        contrast_standard_uncertainty=(1 + contrast)
        * hypot(bright.random / bright.mean, dark.random / dark.mean, *(x - y for x, y in relative))
        if isfinite(contrast)
        else nan,
        csnr=ratio.value,
        csnr_standard_uncertainty=with_uncertainty(
            ratio, max(bright.inflation, dark.inflation), ratio_variance
        ).standard_error,
        mean=[region.mean for region in (first, second)],
        mean_standard_uncertainty=[region.standard_uncertainty for region in (first, second)],
        snr=[region.snr.value for region in (first, second)],
        snr_standard_uncertainty=[region.snr.standard_error for region in (first, second)],
        invalid_shares=[region.invalid_shares for region in (first, second)],
    )


@dataclass(frozen=True, eq=False)
class _Region:
    """A region, and the rows and columns of the map that hold it."""

    roi: Roi
    window: Window
    mask: NDArray[np.bool_]
    map: LuminanceMap
    image: _Array
    light: Distribution

    @classmethod
    def of(cls, frame: Frame, conversion: PictureConversion, roi: Roi) -> _Region:
        group = _GROUP if frame.colour_filter is not None else 1
        shape = (frame.shape[0] // group, frame.shape[1] // group)
        region = roi if group == 1 else Roi(roi.name, tuple((x / group, y / group) for x, y in roi.corners))
        window, mask = region.window(shape), _mask(region, shape)
        found = conversion.convert(frame, window)
        image = found.luminance_cd_m2.astype(np.float64, order="C")
        return cls(roi, window, mask, found, image, _light(frame, roi, window, mask, image))

    @cached_property
    def mean(self) -> float:
        return self.light.mean

    @property
    def size(self) -> int:
        assert self.light.size is not None
        return self.light.size

    @cached_property
    def inflation(self) -> float:
        """Factor of the variance of a mean by the correlation of the pixels."""
        return noise_inflation(self.image, self.mask)

    @cached_property
    def std(self) -> float:
        """Standard deviation of the pixels with n - 1; nan for one."""
        off = self.light.values - self.mean
        return sqrt(float(self.light.weights @ off**2) / (self.size - 1)) if self.size > 1 else nan

    @property
    def random(self) -> float:
        """Standard uncertainty of the mean by the pixels alone; nan for one."""
        return self.std * sqrt(self.inflation / self.size)

    @cached_property
    def snr(self) -> Estimate:
        """Signal-to-noise ratio; an error of the darkness moves the mean and not the noise."""
        of_darkness = (self.darkness / self.std) ** 2 if self.std > 0 else 0.0
        return with_uncertainty(snr(self.light), self.inflation, of_darkness)

    @cached_property
    def shared(self) -> list[float]:
        """Relative errors of the mean that the whole image shares, in the order of the calibration."""
        return [self._mean_of(error.relative) for error in self.map.common]

    @cached_property
    def own(self) -> list[float]:
        """Relative errors of the mean that the region shares with no other; rounding as if it moved all alike."""
        absolute = (self.darkness, self.rounding)
        errors = [self.map.slow_rel, *(error / abs(self.mean) if self.mean else 0.0 for error in absolute)]
        return [error for error in errors if error]

    @cached_property
    def darkness(self) -> float:
        """Error of the mean by that of the darkness, which differs from place to place."""
        slow = self.map.slow_cd_m2
        return float(np.mean(np.broadcast_to(slow, self.mask.shape)[self.mask])) if np.ndim(slow) else float(slow)

    @cached_property
    def rounding(self) -> float:
        """Error of the mean by the rounding to whole DN, where noise does not dither it."""
        height, width = self.mask.shape
        steps = self.map.dn_step_in((slice(0, height), slice(0, width)))
        return 0.0 if steps is None else rounding_uncertainty(self.std, steps[self.mask])

    def _mean_of(self, relative: NDArray[np.floating[Any]] | float) -> float:
        if np.ndim(relative) == 0:
            return float(relative)
        light = self.image[self.mask]
        errors = np.asarray(relative)[self.mask] * light
        finite = np.isfinite(errors)
        return float(errors[finite].sum() / light.sum()) if finite.any() and light.sum() else 0.0

    @property
    def standard_uncertainty(self) -> float:
        """Standard uncertainty of the mean."""
        return hypot(self.random, *(error * self.mean for error in (*self.shared, *self.own)))

    @property
    def invalid_shares(self) -> dict[str, float]:
        flags = self.map.invalid
        if not flags.any():
            return {}
        flags = flags[self.mask]
        shares = {name: float(np.mean(flags & reason != 0)) for reason, name in REASONS.items()}
        return {name: share for name, share in shares.items() if share}


def _by_pixels(tally: Tally, bright: _Region, dark: _Region) -> tuple[list[float], float]:
    """Variances by the pixels for the correlation of their noise, and how many independent pixels know as much."""
    regions = (bright, dark)
    inflations = [region.inflation for region in regions]
    scatters = [
        (np.square(shares - tally.inside[:, None]) @ region.light.weights).tolist()
        for region, shares in zip(regions, (tally.per_bright, tally.per_dark), strict=True)
    ]
    variances = []
    for share, *both in zip(tally.inside.tolist(), *scatters, strict=True):
        parts = [scatter / region.size**2 for scatter, region in zip(both, regions, strict=True)]
        # All pairs agree and tell nothing about correlation where nothing scatters.
        factor = sum(map(float.__mul__, parts, inflations)) / sum(parts) if sum(parts) > 0 else max(inflations)
        variances.append(factor * variance_of_scatters(share, both[1], dark.size, both[0], bright.size))
    return variances, min(region.size / inflation for region, inflation in zip(regions, inflations, strict=True))


def _relative_errors(bright: _Region, dark: _Region) -> list[tuple[float, float]]:
    """Errors of both regions for one standard uncertainty of each thing that is not known."""
    return [
        # What is equal has cancelled, however large.
        *((x, y) for x, y in zip(bright.shared, dark.shared, strict=True) if x != y),
        *((error, 0.0) for error in bright.own),
        *((0.0, error) for error in dark.own),
    ]


def _scaled(light: Distribution, factor: float) -> Distribution:
    return Distribution(light.values * factor, light.weights.astype(np.int64))


def _light(frame: Frame, roi: Roi, window: Window, mask: NDArray[np.bool_], image: _Array) -> Distribution:
    """How often each light occurs in a region."""
    if frame.colour_filter is None and frame.dn.dtype == np.uint8:
        by_level = _by_level(frame.dn[window], image, mask)
        if by_level is not None:
            return by_level
    return Distribution.from_array(image[mask], f"region {roi.name!r}")


def _by_level(dn: NDArray[np.unsignedinteger[Any]], image: _Array, mask: NDArray[np.bool_]) -> Distribution | None:
    """Distribution of 8-bit pixels whose light follows from the DN alone, without sorting; None for any other."""
    from .pair_kernel import light_by_level

    counts, of_level, alike = light_by_level(dn.copy(), image, mask)
    if not alike:
        return None
    levels = np.flatnonzero(counts)
    values, counts = of_level[levels], counts[levels]
    if not (values[1:] > values[:-1]).all():
        # Several DN may have one light, and a response may fall.
        values, place = np.unique(values, return_inverse=True)
        counts = np.bincount(place, weights=counts).astype(np.int64)
    return Distribution(values, counts)


@lru_cache(maxsize=16)
def _mask(roi: Roi, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Mask of a region; that of one that stays is kept."""
    mask = roi.mask(shape)
    mask.flags.writeable = False
    return mask


def require_apart(rois: Sequence[Roi], shape: tuple[int, int]) -> None:
    """Refuse two regions that have pixels in common, or do not lie in frames of a shape; raises InputError."""
    _require_apart(*((roi, roi.window(shape), _mask(roi, shape)) for roi in rois))


def _require_apart(first: tuple[Roi, Window, NDArray[np.bool_]], second: tuple[Roi, Window, NDArray[np.bool_]]) -> None:
    parts = []
    for x, y in zip(first[1], second[1], strict=True):
        start, stop = max(x.start, y.start), min(x.stop, y.stop)
        if start >= stop:
            return
        parts.append((start, stop))
    inside = [
        mask[
            tuple(slice(start - own.start, stop - own.start) for (start, stop), own in zip(parts, window, strict=True))
        ]
        for _, window, mask in (first, second)
    ]
    common = int(np.count_nonzero(inside[0] & inside[1]))
    if common:
        raise InputError(f"regions {first[0].name!r} and {second[0].name!r} have {common} pixels in common")
