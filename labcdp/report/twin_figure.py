"""Figure of a twin: predicted against measured CDP, and their difference in joint standard uncertainties."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .digits import Z_95
from .drawing import BLUE, SMALL_SIZE, VERMILLION, label, new_figure, png
from .figures import ReportFigure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..evaluate.twin import TwinResult
    from ..evaluate.twin_pair import TwinPair


def twin_figure(result: TwinResult) -> ReportFigure:
    """Draw all pairs: measured over predicted CDP with 95 % bars, and the standardised differences."""
    figure = new_figure(11.0, 5.2, result.calibration.state.camera.simulated)
    left, right = figure.subplots(1, 2)
    groups = [(BLUE, "o", "agree"), (VERMILLION, "s", "differ"), ("0.5", "^", "undecided")]
    for colour, marker, name in groups:
        chosen = [pair for pair in result.pairs if pair.judgement == name]
        if chosen:
            _draw_pairs(left, chosen, colour, marker, name)
            predicted = [pair.predicted for pair in chosen]
            standardised = [pair.difference / pair.joint_standard_uncertainty for pair in chosen]
            right.plot(predicted, standardised, marker, color=colour, markersize=5, markerfacecolor="none", label=name)
    left.plot([0, 1], [0, 1], color="0.5", linewidth=1, zorder=0)
    left.set_xlim(-0.03, 1.03)
    left.set_ylim(-0.03, 1.03)
    left.set_aspect("equal")
    left.legend(fontsize=SMALL_SIZE, loc="upper left")
    label(left, "CDP predicted by the twin", "CDP measured", "Pairs of patches, with 95 % bars")
    right.axhspan(-Z_95, Z_95, color="0.93", zorder=0)
    right.axhline(0, color="0.5", linewidth=1, zorder=0)
    right.set_xlim(-0.03, 1.03)
    largest = max(abs(pair.difference / pair.joint_standard_uncertainty) for pair in result.pairs)
    right.set_ylim(-1.1 * max(largest, 3), 1.1 * max(largest, 3))
    label(right, "CDP predicted by the twin", "(measured - predicted) / its standard uncertainty", "Grey: 95 %")
    for axes in (left, right):
        axes.grid(color="0.9")
        axes.set_axisbelow(True)
    return ReportFigure(
        "twin.png",
        png(figure),
        "Left: measured over predicted CDP of each pair of patches. Bars are 95 % intervals, of the measurement by "
        "its finite number of pixels, of the prediction by its parameters and the meter's readings. Right: their "
        "difference in joint standard uncertainties.",
        f"CDP measured against predicted: of {len(result.pairs)} pairs {result.agreeing} agree, {result.differing} "
        "differ.",
    )


def _draw_pairs(axes: Axes, pairs: list[TwinPair], colour: str, marker: str, name: str) -> None:
    measured = np.array([[pair.measured.cdp, *pair.measured.confidence_interval] for pair in pairs]).T
    predicted = np.array([[pair.predicted, *pair.predicted_interval] for pair in pairs]).T
    axes.errorbar(
        predicted[0],
        measured[0],
        xerr=np.maximum([predicted[0] - predicted[1], predicted[2] - predicted[0]], 0),
        yerr=np.maximum([measured[0] - measured[1], measured[2] - measured[0]], 0),
        fmt=marker,
        markersize=5,
        color=colour,
        markerfacecolor="none",
        elinewidth=0.8,
        label=name,
    )
