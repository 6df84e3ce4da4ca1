"""Two regions of a luminance map: their luminance, contrast and CDP, each with its uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot, isfinite, nan, sqrt
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..contrast import (
    CalibratedCdp,
    CdpResult,
    Distribution,
    Epsilon,
    Estimate,
    cdp_range,
    csnr,
    snr,
    weber_contrast,
)
from ..contrast.interval import AskedContrast
from ..contrast.pairs import tally_pairs
from ..contrast.uncertainty import confidence_interval
from ..errors import InputError
from ..luminance import LuminanceMap
from ..roi import Roi
from .noise_correlation import noise_inflation
from .pair_region import (
    RegionPixels,
    RegionResult,
    evaluate_region,
    finite_errors,
    region_result,
    variance_of_changes,
    with_uncertainty,
)

__all__ = ["PairResult", "RegionResult", "evaluate_pair", "evaluate_region", "paired_errors"]

#: Relative errors of the pixels of two regions for one standard uncertainty of what they share.
_Error = tuple[NDArray[np.float64], NDArray[np.float64]]
_Array = NDArray[np.float64]


@dataclass(frozen=True)
class PairResult:
    """Contrast of two regions and how probably it is detected.

    Parameters
    ----------
    a, b : RegionResult
        The regions.
    bright : {'a', 'b'}
        The one with the larger mean.
    results : tuple of CalibratedCdp
        One for each contrast that was asked for; the intervals are for pixels, whose noise may be correlated, and
        calibration together.
    contrast : Estimate
        Weber contrast of the means, with its standard uncertainty; errors that both regions share have cancelled.
    csnr : Estimate
        Mean over standard deviation of the contrasts of all pairs of pixels, with its standard uncertainty.
    warnings : tuple of str
        Pixels that are not valid.
    """

    a: RegionResult
    b: RegionResult
    bright: Literal["a", "b"]
    results: tuple[CalibratedCdp, ...]
    contrast: Estimate
    csnr: Estimate
    warnings: tuple[str, ...]

    @property
    def bright_region(self) -> RegionResult:
        """The brighter region."""
        return self.a if self.bright == "a" else self.b

    @property
    def dark_region(self) -> RegionResult:
        """The darker region."""
        return self.b if self.bright == "a" else self.a


def evaluate_pair(
    luminance: LuminanceMap, a: Roi, b: Roi, contrasts: Sequence[float], epsilon: Epsilon = 0.5
) -> PairResult:
    """Evaluate the contrast of two regions of a map.

    Parameters
    ----------
    luminance : LuminanceMap
        The map; only its rows and columns that hold the regions are used.
    a, b : Roi
        The regions, in pixels of the image, in any order.
    contrasts : sequence of float
        Contrasts to be detected, fractions.
    epsilon : float or DetectionInterval
        Their tolerance, as for `labcdp.contrast.cdp`.

    Raises
    ------
    InputError
        As `evaluate_region`; if the regions have pixels in common, neither has a pixel above 0, or a contrast or the
        tolerance is out of range.

    Notes
    -----
    All pixels of the regions count, as in sessions: without the saturated ones, what is left would look brighter or
    darker than it is. The variance by the pixels is inflated for correlated noise; a slow change across a region is
    none (`labcdp.evaluate.noise_correlation`). The errors of the calibration, independent of it, are propagated as by
    `cdp_with_common_errors`: each is added and subtracted once, and the mean square of the two changes is its variance.
    So is the rounding to DN of each region, where its noise does not dither it (`labcdp.evaluate.dn_rounding`).
    """
    first, second = RegionPixels.of(luminance, a), RegionPixels.of(luminance, b)
    _require_apart(first, second)
    errors = paired_errors(luminance, a, luminance, b)
    base = _Metrics.of(first.distribution, second.distribution, contrasts, epsilon)
    changed = [
        [_Metrics.of(first.changed(sign * x), second.changed(sign * y), contrasts, epsilon).values for sign in (1, -1)]
        for x, y in _joined([*errors, *_of_rounding(first, second)])
    ]
    variances = variance_of_changes(base.values, changed)
    regions = (
        region_result(first, luminance, [x for x, _ in errors], base.snr_a, variances[0]),
        region_result(second, luminance, [y for _, y in errors], base.snr_b, variances[1]),
    )
    bright: Literal["a", "b"] = "b" if second.mean > first.mean else "a"
    return PairResult(
        a=regions[0],
        b=regions[1],
        bright=bright,
        results=tuple(
            _calibrated(_inflated(one, first, second), sqrt(variance))
            for one, variance in zip(base.cdp, variances[3:], strict=True)
        ),
        contrast=_contrast(first, second, bright, errors),
        csnr=with_uncertainty(base.csnr, max(first.inflation, second.inflation), variances[2]),
        warnings=tuple(warning for region in regions for warning in _warnings(region)),
    )


def paired_errors(bright_map: LuminanceMap, bright: Roi, dark_map: LuminanceMap, dark: Roi) -> list[_Error]:
    """Errors that two regions share, and those of each that are alike for its pixels only.

    Parameters
    ----------
    bright_map, dark_map : LuminanceMap
        Of one calibration, so that their common errors are the same unknown numbers in the same order.
    bright, dark : Roi
        A region of each.

    Returns
    -------
    list of (ndarray of float, ndarray of float)
        Signed relative errors in the two regions for one standard uncertainty, of shape () or that of the region's
        pixels.

    Raises
    ------
    InputError
        As `Roi.select`.
    """
    pairs = [
        (finite_errors(x.relative), finite_errors(y.relative))
        for x, y in zip(bright_map.common_of(bright), dark_map.common_of(dark), strict=True)
    ]
    nothing = np.zeros(())
    of_bright = [(finite_errors(error.relative), nothing) for error in bright_map.slow_of(bright)]
    of_dark = [(nothing, finite_errors(error.relative)) for error in dark_map.slow_of(dark)]
    return [*pairs, *of_bright, *of_dark]


@dataclass(frozen=True, eq=False)
class _Metrics:
    """What is propagated of two regions."""

    snr_a: Estimate
    snr_b: Estimate
    csnr: Estimate
    cdp: tuple[CdpResult, ...]

    @classmethod
    def of(cls, a: Distribution, b: Distribution, contrasts: Sequence[float], epsilon: Epsilon) -> _Metrics:
        return cls(snr(a), snr(b), csnr(a, b), cdp_range(a, b, contrasts, epsilon))

    @property
    def values(self) -> _Array:
        """All values: both SNR, the CSNR, and the CDP of each contrast."""
        return np.array([self.snr_a.value, self.snr_b.value, self.csnr.value, *(one.cdp for one in self.cdp)])


def _of_rounding(first: RegionPixels, second: RegionPixels) -> list[_Error]:
    """Errors of each region by rounding to whole DN, as if it moved all pixels alike."""
    nothing = np.zeros(())
    return [(np.array(first.rounding_rel), nothing), (nothing, np.array(second.rounding_rel))]


def _joined(errors: Sequence[_Error]) -> list[_Error]:
    """Errors of each pixel, and those of whole regions as one of the first alone: ratios feel no more of them."""
    ratios = [float((1 + x) / (1 + y) - 1) for x, y in errors if x.ndim == y.ndim == 0]
    together = hypot(*ratios)
    arrays = [(x, y) for x, y in errors if x.ndim or y.ndim]
    return arrays + ([(np.array(together), np.zeros(()))] if together > 0 else [])


def _warnings(region: RegionResult) -> list[str]:
    return [
        f"{100 * share:.3g} % of the pixels of region {region.roi.name!r} are {reason}"
        for reason, share in region.invalid_shares.items()
    ]


def _require_apart(first: RegionPixels, second: RegionPixels) -> None:
    """Refuse regions that have pixels in common."""
    rows, columns = (
        slice(max(x.start, y.start), min(x.stop, y.stop)) for x, y in zip(first.window, second.window, strict=True)
    )
    if rows.start >= rows.stop or columns.start >= columns.stop:
        return

    def inside(pixels: RegionPixels) -> NDArray[np.bool_]:
        top, left = pixels.window[0].start, pixels.window[1].start
        return pixels.mask[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left]

    common = int(np.count_nonzero(inside(first) & inside(second)))
    if common:
        raise InputError(
            f"regions {first.roi.name!r} and {second.roi.name!r} have {common} pixels in common: give two regions that "
            "do not overlap"
        )


def _inflated(result: CdpResult, first: RegionPixels, second: RegionPixels) -> CdpResult:
    """CDP with its standard error inflated for correlated noise, where there is something to look for.

    As in `cdp_correlated`, it is looked for in what each pixel adds to the CDP. The inflation is no larger than that of
    the pixels: what exceeds it comes of a slow change across the region.
    """
    most = max(first.inflation, second.inflation)
    if most == 1:
        return result
    inflation = min(most, _inflation_of_shares(result, first, second)) if 0 < result.cdp < 1 else most
    factor = sqrt(inflation)
    return replace(result, standard_error=result.standard_error * factor, correlation_inflation=factor)


def _inflation_of_shares(result: CdpResult, first: RegionPixels, second: RegionPixels) -> float:
    """Inflation of the variance of a CDP, by the share of pairs that are detected of each pixel of both regions."""
    bright, dark = (second, first) if result.bright == "b" else (first, second)
    asked = AskedContrast(result.contrast, result.epsilon, result.definition)
    tally = tally_pairs(bright.distribution, dark.distribution, asked.low, asked.high)
    plain = inflated = 0.0
    for pixels, shares in ((bright, tally.inside_per_bright), (dark, tally.inside_per_dark)):
        each = np.zeros(pixels.image.shape)
        each[pixels.mask] = shares[np.searchsorted(pixels.distribution.values, pixels.values)]
        scatter = float(each[pixels.mask].var()) / pixels.values.size
        plain += scatter
        inflated += noise_inflation(each, pixels.mask) * scatter
    return inflated / plain


def _calibrated(result: CdpResult, by_calibration: float) -> CalibratedCdp:
    """Join what pixels and calibration leave uncertain."""
    sizes = [size for size in (result.bright_size, result.dark_size) if size is not None]
    interval = confidence_interval(
        result.cdp, result.standard_error**2 + by_calibration**2, min(sizes) / result.correlation_inflation**2
    )
    return CalibratedCdp(result, by_calibration, interval)


def _contrast(
    first: RegionPixels, second: RegionPixels, bright: Literal["a", "b"], errors: Sequence[_Error]
) -> Estimate:
    """Weber contrast of the means, by the law of propagation (JCGM 100:2008, 5.1.2)."""
    upper, lower = (first, second) if bright == "a" else (second, first)
    contrast = float(weber_contrast(upper.mean, lower.mean))
    if not isfinite(contrast):
        return Estimate(contrast, nan)
    of_pixels = [hypot(pixels.random, pixels.rounding) / pixels.mean for pixels in (first, second)]
    of_calibration = [
        float(np.mean(x * first.values)) / first.mean - float(np.mean(y * second.values)) / second.mean
        for x, y in errors
    ]
    return Estimate(contrast, (1 + contrast) * hypot(*of_pixels, *of_calibration))
