"""A video over time: CDP, measured contrast, and how well the regions were followed."""

from __future__ import annotations

from math import ceil
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.quantity import Z_95
from ...core.result import Result
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
from ..verdict import changes_of
from .findings import period_s, runs, times_s
from .result import answer_of, contrast_name, limit_of

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


class _Curve(NamedTuple):
    """A curve with the ends of its 95 % interval, all of shape (frames,); nan where a frame has no value."""

    label: str
    colour: str
    y: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    style: str = "-"


class _Panel(NamedTuple):
    """Curves that share an axis."""

    height_in: float
    label: str
    limits: tuple[float, float] | None
    curves: list[_Curve]


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
    panels = [_cdp(dataset, result)]
    panels += [_contrast(dataset)] if "measured_contrast" in dataset else []
    panels += [_quality(dataset)] if "quality" in dataset else []
    heights = [panel.height_in for panel in panels]
    figure = new_figure(6.0, 0.8 + sum(heights))
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0].tolist()
    figure.suptitle(shortened(result.title, 80), fontsize=TITLE_SIZE, parse_math=False)
    x, x_label = times_s(dataset), "time in s"
    if not np.isfinite(x).all():
        x, x_label = dataset["frame"].values.astype(np.float64), "frame number"
    axes[0].axhline(limit_of(dataset), color="0.6", linewidth=0.8, linestyle=":")
    for number, (panel, on) in enumerate(zip(panels, axes, strict=True)):
        for curve in panel.curves:
            _draw(on, x, curve)
        on.set_ylabel(panel.label, fontsize=LABEL_SIZE)
        on.tick_params(labelsize=SMALL_SIZE)
        on.grid(color="0.92")
        on.set_axisbelow(True)
        if panel.limits is not None:
            on.set_ylim(*panel.limits)
        _shade(on, dataset, x, in_legend=number == 0)
        if on.get_legend_handles_labels()[0]:
            how = {"bbox_to_anchor": (0.0, 1.0), "ncols": 3, "frameon": False, "borderaxespad": 0.2}
            taken_literally(on.legend(loc="lower left", fontsize=SMALL_SIZE, **how))
    axes[-1].set_xlabel(x_label, fontsize=LABEL_SIZE)
    axes[-1].set_xlim(*((x[0], x[-1]) if x.size > 1 else (x[0] - 0.5, x[0] + 0.5)))
    return png(figure)


def drawn_contrasts(dataset: Dataset, result: Result) -> list[int]:
    """Places of the contrasts drawn in addition to the reference: all, or those where the answer changes, as cards."""
    reference = dataset["reference_contrast"].values if "reference_contrast" in dataset else np.array([np.nan])
    places = [
        index
        for index, contrast in enumerate(dataset["contrast"].values)
        if not np.isclose(reference, contrast, rtol=1e-9).all()
    ]
    rows = [row for row in result.table("contrasts").rows() if row["kind"] != "reference"]
    answers = [answer_of(rows[index]) for index in places]
    return [places[number] for number in changes_of(answers, _MOST_CONTRASTS)]


def frames_of_a_point(dataset: Dataset) -> int:
    """Frames that one drawn point stands for."""
    return ceil(dataset.sizes["frame"] / _MOST_POINTS)


def _cdp(dataset: Dataset, result: Result) -> _Panel:
    rows = list(result.table("contrasts").rows())
    curves, colours = [], iter(_COLOURS)
    if rows[0]["kind"] == "reference":
        y, low, high = (dataset[name].values for name in ("reference_cdp", "reference_cdp_low", "reference_cdp_high"))
        curves.append(_Curve(contrast_name(rows.pop(0)), next(colours), y, low, high))
    for index in drawn_contrasts(dataset, result):
        y, low, high = (dataset[name].isel(contrast=index).values for name in ("cdp", "cdp_low", "cdp_high"))
        curves.append(_Curve(contrast_name(rows[index]), next(colours), y, low, high))
    return _Panel(2.4, "CDP", (-0.03, 1.03), curves)


def _contrast(dataset: Dataset) -> _Panel:
    y = 100 * dataset["measured_contrast"].values
    half_width = 100 * Z_95 * dataset["u_measured_contrast"].values
    curves = [_Curve("measured", "black", y, y - half_width, y + half_width)]
    if "reference_contrast" in dataset and np.isfinite(dataset["reference_contrast"].values).any():
        y = 100 * dataset["reference_contrast"].values
        curves.append(_Curve("reference", BLUE, y, y, y, "--"))
    return _Panel(1.4, "contrast in %", None, curves)


def _quality(dataset: Dataset) -> _Panel:
    named = zip(dataset["region"].values, _REGION_COLOURS, dataset["quality"].values.T, strict=False)
    curves = [_Curve(shortened(str(name), 28), colour, y, y, y) for name, colour, y in named]
    return _Panel(1.2, "tracking\nquality", (-0.05, 1.05), curves)


def _draw(axes: Axes, x: NDArray[np.float64], curve: _Curve) -> None:
    y, low, high = curve.y, curve.low, curve.high
    size = ceil(x.size / _MOST_POINTS)
    if size > 1:
        starts = np.arange(0, x.size, size)
        known = np.isfinite(y)
        counts = np.add.reduceat(known, starts, dtype=np.int64)
        sums = np.add.reduceat(np.where(known, y, 0.0), starts)
        y = np.divide(sums, counts, out=np.full(starts.size, np.nan), where=counts > 0)
        # fmin and fmax pass over nan.
        x, low, high = x[starts], np.fmin.reduceat(low, starts), np.fmax.reduceat(high, starts)
    axes.fill_between(x, low, high, color=curve.colour, alpha=0.25, linewidth=0)
    axes.plot(x, y, color=curve.colour, linewidth=1.2, linestyle=curve.style, label=curve.label)
    # A single frame between two lost ones would be a line of no length.
    alone = [first for first, last in runs(np.isfinite(y)) if first == last]
    axes.plot(x[alone], y[alone], color=curve.colour, linestyle="none", marker=".", markersize=4.0)


def _shade(axes: Axes, dataset: Dataset, x: NDArray[np.float64], in_legend: bool) -> None:
    """Shade where a region was lost, and where there is no result for another reason."""
    lost: NDArray[np.bool_] = np.zeros(x.size, bool)
    if "lost" in dataset:
        lost = np.any(dataset["lost"].values, axis=1)
    missing = ~lost
    for index in range(dataset.sizes["contrast"]):
        missing &= ~np.isfinite(dataset["cdp"].isel(contrast=index).values)
    step = period_s(x) if x.size > 1 else 1.0
    for mask, colour, label in ((lost, _LOST, "region lost"), (missing, _MISSING, "not evaluable")):
        for number, (first, last) in enumerate(runs(mask)):
            named = label if in_legend and number == 0 else None
            axes.axvspan(
                x[first] - step / 2, x[last] + step / 2, color=colour, alpha=0.16, linewidth=0, label=named, zorder=0
            )
