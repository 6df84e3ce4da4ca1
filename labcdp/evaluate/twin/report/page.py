"""The files of a twin: page, spreadsheet, numbers, figure and chain file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ....core.result import Result
from ....output import Destination, write_files
from ....report.digits import Z_95
from ....report.figure import ReportFigure
from ....report.figures.drawing import BLUE, VERMILLION, finish, new_figure, png
from ....report.files import result_files
from ....report.layout import SIMULATED, Card, Facts, Page, Section, State, Verbatim
from ..chain import twin_chain_text
from ..evaluate import TwinEvaluation
from .result import pair_name
from .verdict import signal_findings, verdict

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


#: Value and colour of the first card, by the code of the verdict.
_VERDICTS: dict[str, tuple[str, State]] = {
    "twin-describes-camera": ("agree", "good"),
    "twin-differs": ("differ", "bad"),
    "twin-signals-differ": ("differ", "bad"),
    "twin-undecided": ("undecided", "open"),
}
_METHOD = (
    "The twin is given the luminances by the meter, not by the camera. Its CDP is computed without random numbers "
    "from the DN distributions that it predicts for these regions and exposures. U includes the number of pixels with "
    "the fixed pattern of one camera, all parameters and readings, and the dark signal; the scale error of the meter "
    "cancels. A pair is undecided if 80 % or more of all possible CDPs would agree."
)
_SIGNALS = (
    "Mean values show responsivity, stray light, black level and single readings; temporal noise over the signal shows "
    "read noise and K, the fixed pattern DSNU and PRNU."
)


def write_twin(evaluation: TwinEvaluation, result: Result, folder: Destination) -> list[Path]:
    """Write a twin and its comparison with the camera to a folder, see `write_files`.

    All content is computed before the first file is written; raises InputError if one cannot be written.

    Returns
    -------
    list of Path
        chain.toml, results.json, report.html, results.xlsx and figures/twin.png.
    """
    chain, figure = twin_chain_text(evaluation), twin_figure(evaluation)
    page = _page(evaluation, result, figure, chain)
    return write_files(folder, "twin", {"chain.toml": chain.encode(), **result_files(result, page, [figure])})


def _page(evaluation: TwinEvaluation, result: Result, figure: ReportFigure, chain: str) -> Page:
    configuration, camera = evaluation.observed.configuration, evaluation.calibration.state.camera
    n = len(evaluation.regions)
    return Page(
        "A camera and its simulated twin",
        result.title,
        f"{camera.model}, {n} patches of {configuration.target.name}, {configuration.operator}.",
        SIMULATED if result.simulated else "",
        tuple(_cards(evaluation)),
        (figure,),
        result.findings,
        tuple(_sections(result, chain)),
    )


def _cards(evaluation: TwinEvaluation) -> Iterator[Card]:
    value, state = _VERDICTS[verdict(evaluation).code]
    differing = [f"{one.subject}" for one in signal_findings(evaluation)]
    signals = f"signals of the patches differ: {', '.join(differing)}" if differing else "signals of the patches agree"
    yield Card("Camera and twin", value, signals, state=state)
    lines = (f"{evaluation.count('differ')} differ, {evaluation.count('undecided')} undecided",)
    of = f"{evaluation.count('agree')} of {len(evaluation.pairs)}"
    yield Card("Pairs that agree", of, "within the joint 95 % interval", lines, state=state)
    worst = max(evaluation.pairs, key=lambda pair: abs(pair.z))
    yield Card("Largest deviation", f"z = {worst.z:.1f}", f"measured minus predicted CDP of {pair_name(worst)}")


def _sections(result: Result, chain: str) -> Iterator[Section]:
    yield Section("Pairs", (result.table("pairs"),))
    yield Section("Signals of the patches", (_SIGNALS, result.table("signals")))
    yield Section("Parameters of the twin", (result.table("parameters"), Verbatim(chain)), collapsed=True)
    yield Section("Method and provenance", (_METHOD, Facts.of(result.table("provenance"))), collapsed=True)
