"""What a picture of a chart tells of a camera: all patches against all, and its dynamic range."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from math import nan
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.luminance import LuminanceMap
from ...core.quantity import Quantity
from ...core.result import Finding, info, warning
from ...core.roi import Roi
from ...metrics.contrast import Epsilon
from ...metrics.matrix import MatrixContrasts, region_matrix
from ...metrics.ranges import DynamicRange, dynamic_range
from ...metrics.region import RegionLight, RegionPixels, is_saturated, measure_region
from ...regions.chart import Chart

if TYPE_CHECKING:
    from xarray import Dataset

#: Signal-to-noise ratios between which the range is stated, as measurements of dynamic range have them.
SNR_LIMITS = (1.0, 2.0, 4.0, 10.0)
#: Ratio of stated values from which two patches must be seen in this order, whatever glare and vignetting do.
_ORDER_RATIO = 1.2
#: Least contrast-to-noise ratio of neighbouring patches: their difference is as large as the noise.
CNR_LIMIT = 1.0
_Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ChartRange:
    """Dynamic range by one figure of merit.

    Parameters
    ----------
    figure : {'SNR', 'CNR', 'CDP'}
        The figure of merit: of each patch, or of two patches next to each other in luminance.
    without_glare : bool
        Whether the veiling glare was subtracted from the signal.
    range : DynamicRange
        The range.
    """

    figure: str
    without_glare: bool
    range: DynamicRange

    @property
    def name(self) -> str:
        """The figure of merit, for tables and pages."""
        return f"{self.figure} without glare" if self.without_glare else self.figure


@dataclass(frozen=True, eq=False)
class MeasuredChart:
    """A chart in a picture.

    Parameters
    ----------
    chart : Chart
        The chart.
    regions : tuple of RegionLight
        Its patches, in their order.
    luminance : ndarray of float, shape (n,)
        Luminance of each patch on the axis of the ranges: the stated ones, or where they are not stated the measured
        ones; nan of black patches.
    unit : str
        Its unit.
    saturated : ndarray of bool, shape (n,)
        Which patches are saturated or clipped.
    matrix : xarray.Dataset
        As `labcdp.cdp_matrix`; nan where a patch is saturated.
    ranges : tuple of ChartRange
        Dynamic ranges.
    glare : Quantity or None
        Veiling glare, in `unit`; None if the chart has no black patch and there is no picture with dark surroundings.
    targets_stated : bool
        Whether the target contrasts are those of the stated values.
    findings : tuple of Finding
        Findings on the chart.
    """

    chart: Chart
    regions: tuple[RegionLight, ...]
    luminance: _Array
    unit: str
    saturated: NDArray[np.bool_]
    matrix: Dataset
    ranges: tuple[ChartRange, ...]
    glare: Quantity | None
    targets_stated: bool
    findings: tuple[Finding, ...]


def measure_chart(
    luminance: LuminanceMap,
    unit: str,
    chart: Chart,
    rois: Sequence[Roi],
    contrasts: Sequence[float] | None,
    epsilon: Epsilon,
    cdp_limit: float,
    dark_surroundings: LuminanceMap | None = None,
) -> MeasuredChart:
    """Measure a chart in a picture.

    Parameters
    ----------
    luminance : LuminanceMap
        The picture.
    unit : str
        Unit of the map.
    chart : Chart
        The chart.
    rois : sequence of Roi
        Its patches in the picture, by their names.
    contrasts : sequence of float or None
        Target contrasts; None for those of the chart's stated values, or without them the measured ones.
    epsilon : float or DetectionInterval
        Their tolerance.
    cdp_limit : float
        CDP from which a contrast counts as detected, for the dynamic range by CDP.
    dark_surroundings : LuminanceMap or None
        Another picture of the chart from the same place, with dark surroundings.

    Raises
    ------
    InputError
        If a patch cannot be measured, or the other picture does not fit.

    Notes
    -----
    The figures of merit are SNR of each patch, with the mean as it is and, where the chart has a black patch, less the
    veiling glare seen there; and of patches next to each other in luminance CNR and CDP, at the luminance of the darker
    one. The intervals of the ranges are by the pixels, the calibration and the uncertainties of the stated luminances,
    of which that of white is common to both ends and cancels in their ratio.

    The other picture has the veiling glare of darker surroundings: means in both lie on a straight line, whose slope is
    the change of light or exposure, and whose intercept is the veiling glare that the surroundings add. That of the
    chart itself is in both.
    """
    pixels = {roi.name: RegionPixels.from_map(luminance, roi) for roi in rois}
    other = None
    if dark_surroundings is not None:
        if dark_surroundings.shape != luminance.shape:
            raise InputError(
                f"the picture with dark surroundings has {dark_surroundings.shape[1]} x {dark_surroundings.shape[0]} "
                f"pixels, and the chart's {luminance.shape[1]} x {luminance.shape[0]}: take both with one camera from "
                "one place"
            )
        other = {roi.name: RegionPixels.from_map(dark_surroundings, roi) for roi in rois}
    return measure_patches(pixels, unit, chart, contrasts, epsilon, cdp_limit, other)


def measure_patches(
    pixels: Mapping[str, RegionPixels],
    unit: str,
    chart: Chart,
    contrasts: Sequence[float] | Mapping[str, float] | None,
    epsilon: Epsilon,
    cdp_limit: float,
    in_the_dark: Mapping[str, RegionPixels] | None = None,
) -> MeasuredChart:
    """Measure a chart as `measure_chart`, of the pixels of its patches, or of some of them.

    In place of contrasts, values of the patches may be given, whose contrasts are to be detected. `in_the_dark` are the
    same patches with dark surroundings.
    """
    regions = tuple(measure_region(region) for region in pixels.values())
    saturated = np.array([bool(region.bound) for region in regions])
    stated = chart.luminances()
    by_chart = chart.is_stated
    targets: MatrixContrasts = contrasts
    if contrasts is None and by_chart:
        # A black patch without a value has no contrast that could be asked for.
        targets = {name: quantity.value for name, quantity in stated.items()}
    means = np.array([region.mean for region in regions])
    axis = np.array([stated[r.roi.name].value if by_chart and r.roi.name in stated else r.mean for r in regions])
    clipped = _clipped(regions, means) & ~saturated
    saturated |= clipped
    matrix = _without_saturated(region_matrix(pixels, targets, epsilon), saturated)
    black = np.array([_is_black(chart, region.roi.name) for region in regions])
    findings: list[Finding] = []
    glares = {"chart-glare": _glare(regions, black, saturated)}
    if in_the_dark is not None:
        glares["chart-glare-of-surroundings"] = _glare_of_surroundings(pixels, in_the_dark, saturated)
    scale = _scale(means, axis, ~black & ~saturated) if by_chart else 1.0
    # Black patches show that of the chart itself, too.
    glare_measured = next((quantity for quantity in glares.values() if quantity is not None), None)
    glare = None if glare_measured is None else Quantity(glare_measured.value / scale, glare_measured.u / scale)
    for code, quantity in glares.items():
        if quantity is not None:
            about = {"glare": quantity.value / scale, "U": quantity.U / scale}
            findings.append(info(code, **about, unit=chart.unit if by_chart else unit))
    if not by_chart:
        findings.append(warning("chart-not-stated"))
    if by_chart and (wrong := _wrong_order(regions, axis, black | saturated)) is not None:
        brighter, darker = wrong
        findings.append(warning("chart-order", brighter=brighter, darker=darker))
    if clipped.any():
        names = [region.roi.name for region, is_clipped in zip(regions, clipped, strict=True) if is_clipped]
        findings.append(warning("chart-clipped", patches=names))
    order = [at for at in np.argsort(-axis, kind="stable").tolist() if not black[at] and axis[at] > 0]
    u_rel, u_scale_rel = _axis_uncertainty(chart, regions, by_chart)
    ranges = _ranges(regions, axis, u_rel, u_scale_rel, matrix, order, saturated, glare_measured, cdp_limit)
    return MeasuredChart(
        chart, regions, np.where(black, nan, axis), chart.unit if by_chart else unit, saturated, matrix, ranges, glare,
        contrasts is None and by_chart, tuple(findings),
    )  # fmt: skip


def _is_black(chart: Chart, name: str) -> bool:
    return any(patch.black for patch in chart.patches if patch.roi.name == name)


def _wrong_order(regions: Sequence[RegionLight], axis: _Array, left_out: NDArray[np.bool_]) -> tuple[str, str] | None:
    """Return two patches whose means are in another order than their stated values by far, the brighter one first.

    None if there are none: then the corners of the chart are in their order, and it is the right chart.
    """
    at = np.flatnonzero(~left_out).tolist()
    means, stds = (np.array([getattr(regions[i], name) for i in at]) for name in ("mean", "std"))
    excess = (means - means[:, None]) / np.maximum(np.hypot(stds, stds[:, None]), 1e-300)
    # Stated as at least a fifth brighter, measured as darker by more than the noise of a pixel.
    wrong = np.where(axis[at][:, None] > _ORDER_RATIO * axis[at], excess, -np.inf)
    if not wrong.size or wrong.max() <= 1:
        return None
    brighter, darker = divmod(int(np.argmax(wrong)), len(at))
    return regions[at[brighter]].roi.name, regions[at[darker]].roi.name


def _clipped(regions: Sequence[RegionLight], means: _Array) -> NDArray[np.bool_]:
    """Which patches are as bright as the brightest one, which has no noise at all: a full well, or a converter, clips.

    Noise is never 0 in light, and a file need not state from which DN on its pixels are saturated.
    """
    brightest = int(np.argmax(means))
    if regions[brightest].std > 0:
        return np.zeros(means.shape, dtype=np.bool_)
    clipped: NDArray[np.bool_] = means >= means[brightest] * (1 - 1e-9)
    return clipped


def _without_saturated(matrix: Dataset, saturated: NDArray[np.bool_]) -> Dataset:
    """Leave out pairs of a saturated patch: what clipping takes from the noise is no contrast."""
    from xarray import DataArray

    apart = ~(saturated[:, None] | saturated)
    known = DataArray(apart, dims=("bright", "dark"))
    return matrix.assign(
        {
            name: variable if variable.dtype == bool else variable.where(known)
            for name, variable in matrix.data_vars.items()
        }
    )


def _glare(regions: Sequence[RegionLight], black: NDArray[np.bool_], saturated: NDArray[np.bool_]) -> Quantity | None:
    """Mean of the black patches that are not saturated, in the unit of the picture; None if there is none."""
    seen = [region for region, is_black, full in zip(regions, black, saturated, strict=True) if is_black and not full]
    if not seen:
        return None
    means = np.array([region.mean for region in seen])
    scatter = float(means.std(ddof=1)) if len(seen) > 1 else 0.0
    u = float(np.hypot(scatter, np.nan_to_num([region.u for region in seen]).max())) / np.sqrt(len(seen))
    return Quantity(max(float(means.mean()), 0.0), u)


def _glare_of_surroundings(
    pixels: Mapping[str, RegionPixels], in_the_dark: Mapping[str, RegionPixels], saturated: NDArray[np.bool_]
) -> Quantity:
    """Veiling glare that bright surroundings add, in the unit of the picture: the intercept of a straight line.

    It goes through the means of the patches over those with dark surroundings, by least squares weighted by the noise
    of both, with the uncertainty of the fit (W. H. Press et al., Numerical Recipes, 2007, 15.2), raised where the
    patches scatter by more than their noise.

    Raises
    ------
    InputError
        If fewer than three patches are saturated in neither picture.
    """
    usable = [
        (pixels[name], in_the_dark[name])
        for name, full in zip(pixels, saturated, strict=True)
        if not full and not is_saturated(in_the_dark[name].invalid_shares)
    ]
    if len(usable) < 3:
        raise InputError(
            f"{len(usable)} patches are saturated in neither of the pictures with bright and dark surroundings: give "
            "pictures with three or more, for the veiling glare"
        )
    y, x = (np.array([region.mean for region in side]) for side in zip(*usable, strict=True))
    u_y, u_x = (
        np.array([np.hypot(region.random, region.rounding) for region in side]) for side in zip(*usable, strict=True)
    )
    slope, design = 1.0, np.column_stack([x, np.ones(x.size)])
    for _ in range(3):
        weights = 1 / np.maximum(np.square(u_y) + np.square(slope * u_x), 1e-300)
        covariance = np.linalg.pinv((design * weights[:, None]).T @ design)
        slope, intercept = (covariance @ (design * weights[:, None]).T @ y).tolist()
    chi_square = float(np.sum(weights * np.square(y - slope * x - intercept)) / (x.size - 2))
    return Quantity(max(intercept, 0.0), float(np.sqrt(covariance[1, 1] * max(chi_square, 1.0))))


def _axis_uncertainty(chart: Chart, regions: Sequence[RegionLight], by_chart: bool) -> tuple[_Array, float]:
    """Relative u of the luminance of each patch by itself, and that which all have in common; 0 where unknown."""
    if by_chart:
        stated, common = chart.luminances(), chart.u_white_rel
        whole = np.array([stated[r.roi.name].u_rel if r.roi.name in stated else 0.0 for r in regions])
    else:
        whole = np.array([r.u / r.mean if r.mean > 0 else 0.0 for r in regions])
        # What the most certain patch has, the calibration has for all.
        common = min((u for u in np.nan_to_num(whole).tolist() if u > 0), default=0.0)
    whole = np.nan_to_num(whole)
    return np.sqrt(np.maximum(np.square(whole) - common**2, 0.0)), common


def _scale(means: _Array, axis: _Array, usable: NDArray[np.bool_]) -> float:
    """Measured over stated luminance of the brightest patches, which glare changes least."""
    bright = np.flatnonzero(usable)[np.argsort(-axis[usable])[:3]]
    return float(np.median(means[bright] / axis[bright])) if bright.size else 1.0


def _ranges(
    regions: Sequence[RegionLight],
    axis: _Array,
    u_rel: _Array,
    u_scale_rel: float,
    matrix: Dataset,
    order: list[int],
    saturated: NDArray[np.bool_],
    glare: Quantity | None,
    cdp_limit: float,
) -> tuple[ChartRange, ...]:
    """Return the ranges by all figures, of patches in their order from the brightest one on."""
    if len(order) < 2:
        return ()
    levels, full = axis[order], saturated[order]
    means = np.array([regions[at].mean for at in order])
    end = _saturation(levels, means - (0.0 if glare is None else glare.value), full)
    snr = np.array([regions[at].snr.value for at in order])
    u_snr = np.array([regions[at].snr.u for at in order])
    signals = [(False, snr, u_snr)]
    if glare is not None:
        part = np.maximum(1 - glare.value / means, 0.0)
        signals.append((True, snr * part, np.hypot(u_snr * part, snr / means * glare.u)))
    ranges = [
        ChartRange(
            "SNR",
            without,
            dynamic_range(
                levels,
                values,
                k,
                u,
                saturated=full,
                saturation=end,
                u_luminance_rel=u_rel[order],
                u_scale_rel=u_scale_rel,
            ),
        )
        for without, values, u in signals
        for k in SNR_LIMITS
    ]
    if len(order) < 3:
        return tuple(ranges)
    bright, dark = order[:-1], order[1:]
    first = matrix.isel(contrast=0) if "contrast" in matrix["cdp"].dims else matrix
    figures = {name: first[name].values[bright, dark] for name in ("cnr", "u_cnr", "cdp", "u_cdp")}
    # At the luminance of the darker patch, of a pair whose brighter one is clipped nothing is known.
    full = saturated[bright] | saturated[dark]
    find_range = partial(dynamic_range, saturated=full, u_luminance_rel=u_rel[dark], u_scale_rel=u_scale_rel)
    cnr = find_range(axis[dark], figures["cnr"], CNR_LIMIT, figures["u_cnr"])
    cdp = find_range(axis[dark], figures["cdp"], cdp_limit, figures["u_cdp"], logarithmic=False)
    return (*ranges, ChartRange("CNR", False, cnr), ChartRange("CDP", False, cdp))


def _saturation(levels: _Array, light: _Array, full: NDArray[np.bool_]) -> float | None:
    """Luminance at which the mean of a patch would be that of the saturated ones; None if none is saturated.

    Beyond the brightest patch that is not saturated, light and mean rise in proportion.
    """
    lit = np.flatnonzero(~full & (light > 0))
    if not full.any() or not lit.size:
        return None
    last = lit[0]
    beyond = levels[full & (levels > levels[last])]
    if not beyond.size:
        return None
    # A patch that is saturated in part has a mean below the level at which all of it would be.
    return float(np.clip(levels[last] * light[full].max() / light[last], levels[last], beyond.min()))
