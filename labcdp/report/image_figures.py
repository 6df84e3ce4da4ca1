"""The figures of a picture: its regions, its contrasts and its values."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite, log
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .digits import fixed, percent, printable, share_percent, shortened
from .drawing import BLUE, GREEN, LABEL_SIZE, SMALL_SIZE, block_mean, label, new_figure, plain_numbers, png, reduction
from .figures import ReportFigure
from .image_tables import joined, measured_contrast, unit_text, where
from .pictures import name_regions
from .plots import contrasts_figure
from .stage_plots import stage_figure

if TYPE_CHECKING:
    from ..contrast import ContrastDistribution, DetectionResult, Distribution
    from ..evaluate.image import ImageEvaluation
    from ..luminance import LuminanceMap
    from ..roi import Roi
    from ..sources.picture import Picture

_WIDTH_IN = 8.0
#: Up to so many contrasts of a pair get a figure each; of more, only the one closest to the measured contrast.
_MOST_CONTRASTS = 3
#: Regions whose values are drawn.
_MOST_REGIONS = 8
#: Share of the pixels that may be brighter than the white of a drawn picture, and how it is brightened.
_WHITE_SHARE, _GAMMA = 0.001, 0.45
#: Distinct values that a plot can show.
_MOST_VALUES = 2**14


def image_figures(evaluation: ImageEvaluation, picture: Picture, luminance: LuminanceMap) -> list[ReportFigure]:
    """Draw a picture with its regions, the contrasts of its pairs, and the values of picture and regions."""
    figures = [_picture(evaluation, luminance)]
    for number, pair in enumerate(evaluation.pairs, start=1):
        measured = pair.result.contrast.value
        reference = (measured, f"measured: {measured_contrast(pair)} %") if isfinite(measured) else None
        found = [joined(one) for one in pair.result.results]
        figures += _contrasts(found, pair.distribution, pair.name, f"pair-{number}", reference)
    if evaluation.neighbours is not None:
        near = evaluation.neighbours
        found = [joined(one) for one in near.results]
        figures += _contrasts(found, near.distribution, f"pixel to pixel, {where(near.rectangle)}", "neighbours")
    return figures + _values(evaluation, picture, luminance)


def _picture(evaluation: ImageEvaluation, luminance: LuminanceMap) -> ReportFigure:
    from matplotlib.colors import PowerNorm

    height, width = (length * luminance.step for length in luminance.shape)
    side = reduction(luminance.shape)
    drawn = block_mean(np.asarray(luminance.luminance_cd_m2), side)
    finite = drawn[np.isfinite(drawn)]
    white = float(np.quantile(finite, 1 - _WHITE_SHARE)) if finite.size else 1.0
    white = white if white > 0 else 1.0
    regions = [region.roi for region in evaluation.regions]
    figure = new_figure(_WIDTH_IN, 1.1 + (_WIDTH_IN - 1.6) * min(max(height / width, 0.3), 1.5), simulated=False)
    axes = figure.add_subplot()
    label(axes, "x in pixels", "y in pixels", shortened(evaluation.path.name, 60))
    shown = axes.imshow(
        np.clip(drawn, 0, white), cmap="gray", norm=PowerNorm(_GAMMA, 0, white), extent=(0.0, width, height, 0.0)
    )
    bar = figure.colorbar(shown, ax=axes, extend="max")
    bar.set_label(_luminance_label(evaluation.unit), fontsize=LABEL_SIZE)
    bar.ax.tick_params(labelsize=SMALL_SIZE)
    plain_numbers(bar.ax.yaxis)
    if evaluation.neighbours is not None and evaluation.neighbours.rectangle is not None:
        regions.append(_rectangle(evaluation.neighbours.rectangle))
    if regions:
        name_regions(figure, axes, regions)
    side *= luminance.step
    scale = f" Each drawn pixel is the mean of {side} x {side} of the picture's." if side > 1 else ""
    return ReportFigure(
        "picture.png",
        png(figure),
        f"The picture as {_luminance_label(evaluation.unit)}, dark parts brightened, with its regions.{scale}",
        f"Grey picture with {len(regions)} regions: {', '.join(printable(roi.name) for roi in regions) or 'none'}.",
    )


def _rectangle(corners: tuple[int, int, int, int]) -> Roi:
    from ..roi import Roi

    x0, y0, x1, y1 = corners
    return Roi.rectangle("pixel to pixel", x0, y0, x1 + 1 - x0, y1 + 1 - y0)


def _luminance_label(unit: str) -> str:
    return "luminance in cd/m²" if unit == "cd/m^2" else "relative luminance"


def _contrasts(
    found: Sequence[DetectionResult],
    distribution: ContrastDistribution | None,
    name: str,
    key: str,
    reference: tuple[float, str] | None = None,
) -> list[ReportFigure]:
    """Draw the contrasts with what counts as detected and, of several contrasts, the CDP over them."""
    figures = []
    if distribution is not None:
        for number, result in enumerate(_drawn(found, reference), start=1):
            beyond = distribution.unbounded
            figures.append(
                ReportFigure(
                    f"contrasts-{key}-{number}.png",
                    contrasts_figure(distribution, result, shortened(name, 60), reference=reference),
                    f"{printable(name)}: measured contrasts of all pairs of pixels. Blue: share of the pairs with at "
                    "most this contrast; grey: density, scaled to a largest bar of 1; shaded: what counts as detected."
                    + (f" {share_percent(beyond)} of the pairs have no finite contrast." if beyond else ""),
                    f"Distribution of the contrasts, {printable(name)}; CDP of {percent(result.contrast)} is "
                    f"{fixed(result.cdp, 4)}.",
                )
            )
    if len(found) > 1:
        figures.append(_curve(found, name, key, reference))
    return figures


def _drawn(found: Sequence[DetectionResult], reference: tuple[float, str] | None) -> Sequence[DetectionResult]:
    if len(found) <= _MOST_CONTRASTS:
        return found
    if reference is None or reference[0] <= 0:
        return [max(found, key=lambda one: one.cdp)]
    measured = reference[0]
    return [min(found, key=lambda one: abs(log(one.contrast / measured)))]


def _curve(
    found: Sequence[DetectionResult],
    name: str,
    key: str,
    reference: tuple[float, str] | None,
) -> ReportFigure:
    figure = new_figure(_WIDTH_IN, 4.4, simulated=False)
    axes = figure.add_subplot()
    percents = np.array([100 * result.contrast for result in found])
    ends = np.array([result.confidence_interval for result in found])
    sure = np.isfinite(ends).all(axis=1)
    axes.plot(percents, [result.cdp for result in found], "o-", color=BLUE, linewidth=1.6, markersize=4, label="CDP")
    axes.fill_between(percents[sure], *ends[sure].T, color=BLUE, alpha=0.2, linewidth=0, label="95 % interval")
    if reference is not None:
        axes.axvline(100 * reference[0], color=GREEN, linestyle="-.", label=reference[1])
    axes.set_ylim(-0.02, 1.05)
    axes.grid(color="0.9")
    axes.set_axisbelow(True)
    label(axes, "Weber contrast asked for in %", "CDP", shortened(name, 60))
    figure.legend(loc="outside lower center", ncols=3, fontsize=SMALL_SIZE)
    best = max(found, key=lambda one: one.cdp)
    return ReportFigure(
        f"cdp-{key}.png",
        png(figure),
        f"{printable(name)}: CDP of each contrast that was asked for, with its 95 % interval.",
        f"CDP over {len(found)} contrasts, {printable(name)}; the largest is {fixed(best.cdp, 4)} at "
        f"{percent(best.contrast)}.",
    )


def _values(evaluation: ImageEvaluation, picture: Picture, luminance: LuminanceMap) -> list[ReportFigure]:
    """Draw the distribution of the values of the picture, and of its regions, as they are and in cd/m^2."""
    in_pairs = {region.roi.name for pair in evaluation.pairs for region in (pair.result.a, pair.result.b)}
    rois = [region.roi for region in evaluation.regions if region.roi.name in in_pairs]
    figures = []
    for number, roi in enumerate([None, *rois[:_MOST_REGIONS]]):
        name = evaluation.path.name if roi is None else roi.name
        native = picture.light if picture.frame is None else picture.frame.dn
        assert native is not None
        values = native if roi is None else roi.select(native)
        light = luminance.luminance_cd_m2 if roi is None else luminance.select(roi)
        what, unit = ("DN", "DN") if picture.frame is not None else ("value in the file", "values")
        figures.append(
            ReportFigure(
                f"values-{number}.png",
                stage_figure(
                    name,
                    _distribution(values),
                    what,
                    _distribution(light),
                    simulated=False,
                    luminance_label=_luminance_label(evaluation.unit),
                ),
                f"{printable(name)}: cumulative probability (blue) and density (grey, scaled to 1) of its {unit}, and "
                f"in {unit_text(evaluation.unit) if evaluation.unit == 'cd/m^2' else 'relative luminance'}.",
                f"Distribution of the values of {printable(name)}.",
            )
        )
    return figures


def _distribution(values: NDArray[Any]) -> Distribution:
    """Count the finite values; so many different ones that no plot can tell them apart are joined to their mean."""
    from ..contrast import Distribution

    flat = values[np.isfinite(values)] if values.dtype.kind == "f" else values.ravel()
    if values.dtype.kind != "f" or flat.size <= _MOST_VALUES:
        return Distribution.from_array(flat)
    low, high = float(flat.min()), float(flat.max())
    if not high > low:
        return Distribution.from_array(flat)
    wide = flat.astype(np.float64)
    bins = np.minimum(((wide - low) * (_MOST_VALUES / (high - low))).astype(np.intp), _MOST_VALUES - 1)
    counts = np.bincount(bins, minlength=_MOST_VALUES)
    sums = np.bincount(bins, weights=wide, minlength=_MOST_VALUES)
    return Distribution(sums[counts > 0] / counts[counts > 0], counts[counts > 0])
