"""Figure of a twin: predicted against measured CDP, and their difference in joint standard uncertainties."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ....report.digits import Z_95
from ....report.figure import ReportFigure
from ....report.figures.drawing import BLUE, VERMILLION, finish, new_figure, png

if TYPE_CHECKING:
    from ..evaluate import TwinEvaluation


def twin_figure(evaluation: TwinEvaluation) -> ReportFigure:
    """Draw all pairs: measured over predicted CDP with 95 % bars, and the standardised differences."""
    figure = new_figure(11.0, 5.2, "bench" if evaluation.calibration.state.camera.simulated else "")
    left, right = figure.subplots(1, 2)
    for name, colour, marker in (("agree", BLUE, "o"), ("differ", VERMILLION, "s"), ("undecided", "0.5", "^")):
        pairs = [pair for pair in evaluation.pairs if pair.judgement == name]
        if not pairs:
            continue
        style = {"fmt": marker, "markersize": 5, "color": colour, "markerfacecolor": "none"}
        measured = np.array([[pair.measured.cdp, *pair.measured.confidence_interval] for pair in pairs]).T
        predicted = np.array([[pair.predicted, *pair.predicted_interval] for pair in pairs]).T
        x, y = (np.maximum([one[0] - one[1], one[2] - one[0]], 0) for one in (predicted, measured))
        left.errorbar(predicted[0], measured[0], y, x, elinewidth=0.8, label=name, **style)
        right.errorbar(predicted[0], [pair.z for pair in pairs], **style)
    left.plot([0, 1], [0, 1], color="0.5", linewidth=1, zorder=0)
    left.set(xlim=(-0.03, 1.03), ylim=(-0.03, 1.03), aspect="equal")
    finish(left, "CDP predicted by the twin", "CDP measured", "Pairs of patches, with 95 % bars")
    right.axhspan(-Z_95, Z_95, color="0.93", zorder=0)
    right.axhline(0, color="0.5", linewidth=1, zorder=0)
    largest = 1.1 * max(3.0, *(abs(pair.z) for pair in evaluation.pairs))
    right.set(xlim=(-0.03, 1.03), ylim=(-largest, largest))
    finish(right, "CDP predicted by the twin", "(measured - predicted) / its standard uncertainty", "Grey: 95 %")
    return ReportFigure(
        "twin.png",
        png(figure),
        "Left: measured over predicted CDP of each pair of patches. Bars are 95 % intervals, of the measurement by "
        "its finite number of pixels, of the prediction by its parameters and the meter's readings. Right: their "
        "difference in joint standard uncertainties.",
        f"CDP measured against predicted: of {len(evaluation.pairs)} pairs {evaluation.count('agree')} agree, "
        f"{evaluation.count('differ')} differ.",
    )
