"""Two regions of a luminance map: their luminance, contrast and CDP, each with its uncertainty."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from math import hypot, isfinite, nan
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.luminance import LuminanceMap, Window
from ..core.quantity import Z_95, Quantity
from ..core.result import Finding, warning
from ..core.roi import Roi
from . import Cdp, Distribution, Epsilon, csnr, snr, weber_contrast
from .contrast import checked_contrast, detected_ratios
from .detection import region_cdp, size_findings
from .pixel_pairs import bright_and_dark, share_inside
from .region import (
    Bound,
    RegionLight,
    RegionPixels,
    is_saturated,
    light_factor,
    region_light,
    variance_of_changes,
    with_uncertainty,
)

_Array = NDArray[np.float64]
#: Signed relative errors in two regions for one standard uncertainty, of shape () or that of the pixels.
PairError = tuple[_Array, _Array]
#: Standard uncertainty of a ratio of two regions by the vignetting from which a warning names it.
VIGNETTING_MATTERS = 0.02
#: Code of that warning.
VIGNETTING_CODE = "contrast-with-vignetting"
#: A region with its bounding box in the image and its mask in the box.
Placed = tuple[Roi, Window, NDArray[np.bool_]]


@dataclass(frozen=True)
class Pair:
    """Contrast of two regions and its detection probability.

    Parameters
    ----------
    a, b : RegionLight
        The regions.
    bright : {'a', 'b'}
        Name of the region with the larger mean.
    cdp : Cdp
        Of all target contrasts, nan if a region is saturated; the intervals combine pixels, whose noise may be
        correlated, and calibration.
    contrast : Quantity
        Weber contrast of the means, with its standard uncertainty, nan if a region is saturated; common errors of both
        regions have cancelled.
    contrast_pixels : float
        Part of that standard uncertainty by the pixels; the rest is by calibration and vignetting.
    contrast_vignetting : float
        Part of that standard uncertainty by a vignetting that was not measured.
    csnr : Quantity
        Mean over standard deviation of the contrasts of all pairs of pixels, with its standard uncertainty; nan if a
        region is saturated.
    findings : tuple of Finding
        Findings on invalid pixels, and on a missing CDP of the measured contrast.
    """

    a: RegionLight
    b: RegionLight
    bright: Literal["a", "b"]
    cdp: Cdp[_Array]
    contrast: Quantity
    contrast_pixels: float
    contrast_vignetting: float
    csnr: Quantity
    findings: tuple[Finding, ...]

    @property
    def name(self) -> str:
        """``bright / dark``."""
        return f"{self.bright_region.roi.name} / {self.dark_region.roi.name}"

    @property
    def bound(self) -> Bound:
        """Whether the contrast is larger or smaller than `contrast`, or not known, as pixels are saturated."""
        return bound_of_contrast(bool(self.bright_region.bound), bool(self.dark_region.bound))

    @property
    def targets_measured_contrast(self) -> bool:
        """Whether the target contrast is the measured one."""
        return len(self.cdp) == 1 and bool(self.cdp.contrast[0] == self.contrast.value)

    def clipped(self, names: Collection[str]) -> Pair:
        """Return the pair with the regions of some names as saturated ones, without a CDP if it has one of them."""
        if not {self.a.roi.name, self.b.roi.name} & set(names):
            return self
        a, b = (region.clipped() if region.roi.name in names else region for region in (self.a, self.b))
        unknown = Quantity(nan, nan)
        return replace(
            self, a=a, b=b, cdp=self.cdp.unanswered(), contrast=Quantity(self.contrast.value, nan),
            contrast_pixels=nan, contrast_vignetting=nan, csnr=unknown,
        )  # fmt: skip

    @property
    def bright_region(self) -> RegionLight:
        """The brighter region."""
        return self.a if self.bright == "a" else self.b

    @property
    def dark_region(self) -> RegionLight:
        """The darker region."""
        return self.b if self.bright == "a" else self.a


def bound_of_contrast(bright_is_saturated: bool, dark_is_saturated: bool) -> Bound:
    """Whether a contrast is larger or smaller than that of the means, or not known, as regions are saturated."""
    if bright_is_saturated and dark_is_saturated:
        return "?"
    return ">" if bright_is_saturated else "<" if dark_is_saturated else ""


def evaluate_pair(
    luminance: LuminanceMap, a: Roi, b: Roi, contrasts: Sequence[float] | None = None, epsilon: Epsilon = 0.5
) -> Pair:
    """Evaluate the contrast of two regions of a map.

    Parameters
    ----------
    luminance : LuminanceMap
        The map; only the bounding boxes of the regions are used.
    a, b : Roi
        The regions, in pixels of the image, in any order.
    contrasts : sequence of float or None
        Target contrasts, fractions; None for the measured contrast of the regions, without a result if that is
        undefined or 0.
    epsilon : float or DetectionInterval
        Their tolerance, as for `labcdp.metrics.cdp`.

    Raises
    ------
    InputError
        As `evaluate_region`; if the regions have pixels in common, neither has a pixel above 0, or a contrast or the
        tolerance is out of range.

    Notes
    -----
    All pixels of the regions are used, as in sessions: without the saturated ones the mean would be biased. The
    variance by the pixels is inflated for correlated noise; a slow change across a region is not noise
    (`labcdp.metrics.variance_inflation`). An error of the calibration, independent of it, is added and
    subtracted once, and the mean square of the two changes of the CDP is its variance: for small errors the law of
    propagation (JCGM 100:2008, 5.1.2), and non-zero also at a maximum of the CDP. The contrast of a pair is a ratio, so
    an equal relative error of both regions cancels; numbers are combined to one error by their root sum of squares.
    The rounding to DN of each region is treated likewise where its noise does not dither it
    (`labcdp.metrics.region`).
    """
    first, second = RegionPixels.from_map(luminance, a), RegionPixels.from_map(luminance, b)
    require_apart(first.placed, second.placed)
    return evaluate_regions(first, second, contrasts, epsilon)


def evaluate_regions(
    first: RegionPixels,
    second: RegionPixels,
    contrasts: Sequence[float] | None = None,
    epsilon: Epsilon = 0.5,
    measured: Sequence[bool] | None = None,
) -> Pair:
    """Evaluate the contrast of two regions as `evaluate_pair`, possibly of two frames with one calibration.

    Which of the contrasts were measured at these places, so that they have the same vignetting, `measured` says; by
    default those are that are not given.
    """
    name = bright_and_dark(first.distribution, second.distribution)[2]
    bright, dark = (first, second) if name == "a" else (second, first)
    errors, lens = paired_errors(first, second), [*zip(first.smooth, second.smooth, strict=True)]
    contrast, by_pixels, by_lens = _contrast(bright, dark, *(
        both if name == "a" else [(y, x) for x, y in both] for both in (errors, lens)
    ))  # fmt: skip
    saturated = is_saturated(first.invalid_shares) or is_saturated(second.invalid_shares)
    # A bound is no target.
    usable = (contrast.value,) if isfinite(contrast.value) and contrast.value > 0 and not saturated else ()
    targets = [checked_contrast(target, epsilon) for target in (usable if contrasts is None else contrasts)]
    limits = [detected_ratios(target, epsilon) for target in targets]
    ratios = snr(first.distribution), snr(second.distribution), csnr(first.distribution, second.distribution)
    cdp = region_cdp(bright, dark, targets, epsilon, swapped=name == "b")

    def changes(by: Sequence[PairError]) -> list[list[_Array]]:
        return [
            [_values(first.changed(sign * x), second.changed(sign * y), limits) for sign in (1, -1)]
            for x, y in joined_errors(by)
        ]

    base = np.array([*(ratio.value for ratio in ratios), *cdp.cdp])
    # A contrast that was measured there changes with the vignetting as the pixels do.
    with_lens = [True] * len(cdp) if contrasts is None else measured or [False] * len(cdp)
    others, alike = [*errors, *_rounding_errors(first, second)], [False] * len(ratios) + list(with_lens)
    changed = changes(others if any(alike) else [*others, *lens])
    if any(alike):
        changed += [[np.where(alike, base, values) for values in both] for both in changes(lens)]
    variances = variance_of_changes(base, changed)
    regions = (
        region_light(first, [*(x for x, _ in errors), *first.smooth], ratios[0], variances[0]),
        region_light(second, [*(y for _, y in errors), *second.smooth], ratios[1], variances[1]),
    )
    findings = [finding for region in regions for finding in _pixel_findings(region)]
    if contrasts is None and not usable and not saturated:
        findings.append(warning("contrast-undefined", f"{first.roi.name} / {second.roi.name}"))
    if not saturated:
        findings += vignetting_findings(bright.roi.name, dark.roi.name, by_lens / (1 + contrast.value))
    return Pair(
        a=regions[0],
        b=regions[1],
        bright=name,
        cdp=cdp.unanswered() if saturated else cdp.with_calibration(variances[3:]),
        contrast=Quantity(contrast.value, nan) if saturated else contrast,
        contrast_pixels=nan if saturated else by_pixels,
        contrast_vignetting=nan if saturated else by_lens,
        csnr=Quantity(nan, nan)
        if saturated
        else with_uncertainty(ratios[2], max(first.inflation, second.inflation), variances[2]),
        findings=tuple(findings),
    )


def vignetting_findings(bright: str, dark: str, ratio_rel: float) -> tuple[Finding, ...]:
    """Return a warning if the relative standard uncertainty of the ratio of two regions by the vignetting matters."""
    if not ratio_rel > VIGNETTING_MATTERS:
        return ()
    return (warning(VIGNETTING_CODE, f"{bright} / {dark}", share=Z_95 * ratio_rel),)


def paired_errors(first: RegionPixels, second: RegionPixels) -> list[PairError]:
    """Errors common to two regions, then errors common to the pixels of one region only.

    Parameters
    ----------
    first, second : RegionPixels
        Regions with one calibration, so that their common errors are the same, in the same order.

    Returns
    -------
    list of (ndarray of float, ndarray of float)
        Signed relative errors in the two regions for one standard uncertainty, of shape () or that of the region's
        pixels.
    """
    nothing = np.zeros(())
    return [
        *zip(first.common, second.common, strict=True),
        *((error, nothing) for error in first.region_errors),
        *((nothing, error) for error in second.region_errors),
    ]


def require_apart(first: Placed, second: Placed) -> None:
    """Refuse regions of one image that have pixels in common; raises InputError."""
    rows, columns = (
        slice(max(x.start, y.start), min(x.stop, y.stop)) for x, y in zip(first[1], second[1], strict=True)
    )
    if rows.start >= rows.stop or columns.start >= columns.stop:
        return

    def inside(placed: Placed) -> NDArray[np.bool_]:
        _, window, mask = placed
        top, left = window[0].start, window[1].start
        return mask[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left]

    common = int(np.count_nonzero(inside(first) & inside(second)))
    if common:
        raise InputError(
            f"regions {first[0].name!r} and {second[0].name!r} have {common} pixels in common: give two regions that "
            "do not overlap"
        )


def joined_errors(errors: Sequence[PairError]) -> list[PairError]:
    """Errors per pixel unchanged; those of whole regions combined to one of the first: only their ratio matters."""
    numbers = [light_factor(x) / light_factor(y) - 1 for x, y in errors if x.ndim == y.ndim == 0]
    arrays = [(x, y) for x, y in errors if x.ndim or y.ndim]
    together = hypot(*numbers)
    return arrays + ([(np.array(together), np.zeros(()))] if together > 0 else [])


def _values(a: Distribution, b: Distribution, limits: Sequence[tuple[float, float]]) -> _Array:
    """Quantities for error propagation: both SNR, the CSNR, and the CDP of each contrast."""
    bright, dark, _ = bright_and_dark(a, b)
    cdps = [share_inside(bright, dark, ratios) for ratios in limits]
    return np.array([snr(a).value, snr(b).value, csnr(a, b).value, *cdps])


def _rounding_errors(first: RegionPixels, second: RegionPixels) -> list[PairError]:
    """Errors of each region by rounding to whole DN, as a common shift of its pixels."""
    nothing = np.zeros(())
    return [(np.array(first.rounding_rel), nothing), (nothing, np.array(second.rounding_rel))]


def _pixel_findings(region: RegionLight) -> list[Finding]:
    return [
        *size_findings(region.roi.name, region.n_pixels),
        *(
            warning(f"region-{reason.replace('_', '-')}", region.roi.name, share=share)
            for reason, share in region.invalid_shares.items()
        ),
    ]


def _contrast(
    bright: RegionPixels, dark: RegionPixels, errors: Sequence[PairError], lens: Sequence[PairError]
) -> tuple[Quantity, float, float]:
    """Weber contrast of the means, by the law of propagation (JCGM 100:2008, 5.1.2); its parts by pixels and lens."""
    contrast = float(weber_contrast(bright.mean, dark.mean))
    if not isfinite(contrast):
        return Quantity(contrast, nan), nan, nan
    by_pixels = hypot(*(hypot(pixels.random, pixels.rounding) / pixels.mean for pixels in (bright, dark)))
    by_calibration = [
        float(np.mean(x * bright.values)) / bright.mean - float(np.mean(y * dark.values)) / dark.mean for x, y in errors
    ]
    by_lens = hypot(*(float(x - y) for x, y in lens))
    together = hypot(by_pixels, by_lens, *by_calibration)
    return Quantity(contrast, (1 + contrast) * together), (1 + contrast) * by_pixels, (1 + contrast) * by_lens
