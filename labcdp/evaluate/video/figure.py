"""A video over time: CDP, measured contrast, and how well the regions were followed."""

from __future__ import annotations

from math import ceil
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.result import Result
from ...core.table import Z_95
from ...report.drawing import (
    BLUE,
    GREEN,
    LABEL_SIZE,
    ORANGE,
    SMALL_SIZE,
    TITLE_SIZE,
    VERMILLION,
    new_figure,
    png,
    taken_literally,
)
from ...report.text import shortened
from .findings import period_s, runs, times_s
from .result import DETECTED_CDP, contrast_name

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from xarray import Dataset


#: Points of a curve; of more the noise hides the course.
_MOST_POINTS = 500

#: Contrasts drawn in addition to the reference.
_MOST_CONTRASTS = 4

_COLOURS = (BLUE, ORANGE, GREEN, "#CC79A7", "#000000")
_REGION_COLOURS = (ORANGE, BLUE)
_LOST, _MISSING = VERMILLION, "0.55"


#: Places and values of a curve, with the ends of their interval of 95 %; nan where no frame of a point has a value.
_Curve: TypeAlias = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


def video_figure(dataset: Dataset, result: Result) -> bytes:
    """Draw a video's results over time, as PNG.

    Of a long video each drawn point stands for several frames: the line is their mean, the band reaches from the
    lowest to the highest end of their intervals.

    Parameters
    ----------
    dataset : xarray.Dataset
        Results of a video.
    result : Result
        Its tables.
    """
    heights = [3.2]
    with_contrast, with_quality = "measured_contrast" in dataset, "quality" in dataset
    heights += [2.0] * with_contrast + [1.6] * with_quality
    figure = new_figure(7.0, 1.0 + sum(heights))
    axes = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0].tolist()
    x, x_label = _x(dataset)
    figure.suptitle(shortened(result.title, 80), fontsize=TITLE_SIZE, parse_math=False)
    _cdp(axes[0], dataset, x, list(result.table("contrasts").rows()))
    below = iter(axes[1:])
    if with_contrast:
        _contrast(next(below), dataset, x)
    if with_quality:
        _quality(next(below), dataset, x)
    for number, panel in enumerate(axes):
        _shade(panel, dataset, x, in_legend=number == 0)
        _legend(panel)
    axes[-1].set_xlabel(x_label, fontsize=LABEL_SIZE)
    axes[-1].set_xlim(*_span(x))
    return png(figure)


def drawn_contrasts(dataset: Dataset) -> list[int]:
    """Places of the contrasts drawn in addition to the reference: all, or a selection over the range."""
    reference = dataset["reference_contrast"].values if "reference_contrast" in dataset else np.array([np.nan])
    places = [
        place
        for place, contrast in enumerate(dataset["contrast"].values)
        if not np.isclose(reference, contrast, rtol=1e-9).all()
    ]
    chosen = np.linspace(0, len(places) - 1, min(len(places), _MOST_CONTRASTS)).round().astype(int)
    return [places[number] for number in chosen]


def frames_of_a_point(dataset: Dataset) -> int:
    """Frames that one drawn point stands for."""
    return ceil(dataset.sizes["frame"] / _MOST_POINTS)


def _x(dataset: Dataset) -> tuple[NDArray[np.float64], str]:
    times = times_s(dataset)
    if np.isfinite(times).all():
        return times, "time in s"
    return dataset["frame"].values.astype(np.float64), "frame number"


def _span(x: NDArray[np.float64]) -> tuple[float, float]:
    if x.size == 1:
        return float(x[0]) - 0.5, float(x[0]) + 0.5
    return float(x[0]), float(x[-1])


def _curve(
    x: NDArray[np.float64], y: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64]
) -> _Curve:
    size = ceil(x.size / _MOST_POINTS)
    if size == 1:
        return x, y, low, high
    starts = np.arange(0, x.size, size)
    known = np.isfinite(y)
    counts = np.add.reduceat(known, starts, dtype=np.int64)
    means = np.divide(
        np.add.reduceat(np.where(known, y, 0.0), starts), counts, out=np.full(starts.size, np.nan), where=counts > 0
    )
    # fmin and fmax pass over nan.
    return x[starts], means, np.fmin.reduceat(low, starts), np.fmax.reduceat(high, starts)


def _draw(axes: Axes, curve: _Curve, colour: str, label: str) -> None:
    x, y, low, high = curve
    axes.fill_between(x, low, high, color=colour, alpha=0.25, linewidth=0)
    axes.plot(x, y, color=colour, linewidth=1.2, label=label)
    # A single frame between two lost ones would be a line of no length.
    known = np.isfinite(y)
    alone = np.zeros(known.size, bool)
    for first, last in runs(known):
        alone[first] = first == last
    axes.plot(x[alone], y[alone], color=colour, linestyle="none", marker=".", markersize=4.0)


def _cdp(axes: Axes, dataset: Dataset, x: NDArray[np.float64], rows: list[dict[str, Any]]) -> None:
    axes.axhline(DETECTED_CDP, color="0.6", linewidth=0.8, linestyle=":")
    colours = iter(_COLOURS)
    if rows[0]["kind"] == "reference":
        values = (dataset[name].values for name in ("reference_cdp", "reference_cdp_low", "reference_cdp_high"))
        _draw(axes, _curve(x, *values), next(colours), contrast_name(rows.pop(0)))
    for place in drawn_contrasts(dataset):
        one = dataset.isel(contrast=place)
        values = (one[name].values for name in ("cdp", "cdp_low", "cdp_high"))
        _draw(axes, _curve(x, *values), next(colours), contrast_name(rows[place]))
    _finish(axes, "CDP", (-0.03, 1.03))


def _contrast(axes: Axes, dataset: Dataset, x: NDArray[np.float64]) -> None:
    y = 100 * dataset["measured_contrast"].values
    half_width = 100 * Z_95 * dataset["measured_contrast_standard_uncertainty"].values
    _draw(axes, _curve(x, y, y - half_width, y + half_width), "black", "measured")
    if "reference_contrast" in dataset and np.isfinite(dataset["reference_contrast"].values).any():
        reference = _curve(x, *[100 * dataset["reference_contrast"].values] * 3)
        axes.plot(*reference[:2], color=BLUE, linewidth=1.2, linestyle="--", label="reference")
    _finish(axes, "contrast in %", None)


def _quality(axes: Axes, dataset: Dataset, x: NDArray[np.float64]) -> None:
    for place, colour in zip(range(dataset.sizes["region"]), _REGION_COLOURS, strict=False):
        one = dataset.isel(region=place)
        values = one["quality"].values
        _draw(axes, _curve(x, values, values, values), colour, shortened(str(one["region"].values), 28))
    _finish(axes, "tracking\nquality", (-0.05, 1.05))


def _finish(axes: Axes, label: str, limits: tuple[float, float] | None) -> None:
    axes.set_ylabel(label, fontsize=LABEL_SIZE)
    axes.tick_params(labelsize=SMALL_SIZE)
    axes.grid(color="0.92")
    axes.set_axisbelow(True)
    if limits is not None:
        axes.set_ylim(*limits)


def _shade(axes: Axes, dataset: Dataset, x: NDArray[np.float64], in_legend: bool) -> None:
    """Shade where a region was lost, and where there is no result for another reason."""
    lost: NDArray[np.bool_] = np.zeros(x.size, bool)
    if "lost" in dataset:
        lost = np.any(dataset["lost"].values, axis=1)
    missing = ~lost
    for place in range(dataset.sizes["contrast"]):
        missing &= ~np.isfinite(dataset["cdp"].isel(contrast=place).values)
    step = period_s(x) if x.size > 1 else 1.0
    for mask, colour, label in ((lost, _LOST, "region lost"), (missing, _MISSING, "not evaluable")):
        for number, (first, last) in enumerate(runs(mask)):
            named = label if in_legend and number == 0 else None
            axes.axvspan(
                x[first] - step / 2, x[last] + step / 2, color=colour, alpha=0.16, linewidth=0, label=named, zorder=0
            )


def _legend(axes: Axes) -> None:
    handles, _ = axes.get_legend_handles_labels()
    if handles:
        legend = axes.legend(
            loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, frameon=False, fontsize=SMALL_SIZE, borderaxespad=0.2
        )
        taken_literally(legend)
