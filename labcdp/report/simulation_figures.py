"""The figures and pictures of a simulated chain."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .digits import printable
from .drawing import block_mean, reduction
from .figures import ReportFigure
from .plots import contrasts_figure
from .stage_plots import chain_figure, stage_figure

if TYPE_CHECKING:
    from ..contrast import DetectionResult
    from ..evaluate import PairRow, SimulationEvaluation, StageRow

#: A picture of a stage is enlarged, by repeating pixels, to at least this many pixels.
_PICTURE_SIDE = 600


def simulation_figures(evaluation: SimulationEvaluation) -> list[ReportFigure]:
    """Draw CDP and SNR along the chain, the contrasts behind its end, and the distribution behind each stage."""
    figures = []
    for key, names in _branches(evaluation):
        stages = [stage for stage in evaluation.stages if stage.name in names]
        for number in range(max(len(stage.pairs) for stage in stages)):
            rows = [(stage, stage.pairs[number]) for stage in stages]
            figures.append(_along(rows, f"{key}{number + 1}"))
            figures += _contrasts(*rows[-1], f"{key}{number + 1}")
    return [*figures, *(_stage(stage) for stage in evaluation.stages)]


def _branches(evaluation: SimulationEvaluation) -> list[tuple[str, tuple[str, ...]]]:
    """Stages that follow each other, for each sensor, with a key for its files."""
    chain = evaluation.chain
    if len(chain.sensors) < 2:
        return [("", chain.stage_names)]
    front = ("scene", *(name for name, _ in chain.before))
    return [
        (f"{file_name(own)}-", (*front, *(chain.of_sensor(name, own) for name in chain.recorded_names)))
        for own, _ in chain.sensors
    ]


def _contrasts(stage: StageRow, row: PairRow, key: str) -> list[ReportFigure]:
    if row.cdp is None or row.contrasts is None:
        return []
    pair = f"{row.bright} against {row.dark}, behind {stage.name}"
    return [
        ReportFigure(
            f"contrasts-{key}.png",
            contrasts_figure(row.contrasts, row.cdp, pair, simulated="chain"),
            f"Contrasts of all pairs of pixels: {pair}. Blue: share of the pairs with at most this contrast; "
            "grey: density, scaled to a largest bar of 1; shaded: what counts as detected.",
            f"Distribution of the contrasts, {pair}; CDP {row.cdp.cdp:.4f}.",
        )
    ]


def _along(rows: list[tuple[StageRow, PairRow]], key: str) -> ReportFigure:
    results: list[DetectionResult | None] = [pair.neighbours or pair.cdp for _, pair in rows]
    bright = [next(row for row in stage.regions if row.region == pair.bright) for stage, pair in rows]
    nothing = float("nan")
    kind = "pixel to pixel" if rows[0][1].neighbours else "region to region"
    pair = f"{rows[0][1].bright} against {rows[0][1].dark}"
    return ReportFigure(
        f"chain-{key}.png",
        chain_figure(
            [stage.name for stage, _ in rows],
            [nothing if result is None else result.cdp for result in results],
            [(nothing, nothing) if result is None else result.confidence_interval for result in results],
            [row.snr.value for row in bright],
            [row.snr_10log10_db.value for row in bright],
            [row.luminance_snr.value for row in bright],
        ),
        f"CDP along the chain, {kind}, {pair}, and SNR of {rows[0][1].bright}: of the values, also as 10 lg of mean "
        "over standard deviation, and of the luminance they stand for.",
        f"CDP and SNR behind each stage, {pair}.",
    )


def _stage(stage: StageRow) -> ReportFigure:
    unit = stage.unit.replace("^2", "²")
    return ReportFigure(
        f"stage-{file_name(stage.name)}.png",
        stage_figure(stage.name, stage.native, f"{stage.quantity} in {unit}", stage.luminance),
        f"{printable(stage.name)}: cumulative probability (blue) and density (grey, scaled to 1) of the values of the "
        "whole frame, and of the luminance they stand for.",
        f"Distribution of the values behind {printable(stage.name)}.",
    )


def shown_picture(name: str, values: NDArray[Any]) -> ReportFigure:
    """Return the picture of a stage for the page, a large one with fewer pixels."""
    side = reduction((values.shape[0], values.shape[1]))
    low, high = float(values.min()), float(values.max())
    reduced = f"; {side} x {side} pixels are drawn as one" if side > 1 else ""
    return ReportFigure(
        f"{file_name(name)}.png",
        picture(values if side == 1 else block_mean(values, side)),
        f"{printable(name)}: {low:.4g} to {high:.4g}{reduced}",
        f"Grey picture behind {printable(name)}.",
    )


def picture(values: NDArray[Any]) -> bytes:
    """Draw the values of a stage as a grey PNG, from the lowest to the highest."""
    import cv2

    low, high = float(values.min()), float(values.max())
    grey = np.zeros(values.shape, np.uint8)
    if high > low:
        grey = np.rint((values - low) * (255 / (high - low))).astype(np.uint8)
    times = max(1, _PICTURE_SIDE // max(grey.shape))
    enlarged = np.repeat(np.repeat(grey, times, axis=0), times, axis=1)
    done, data = cv2.imencode(".png", enlarged)
    assert done
    return data.tobytes()


def file_name(stage: str) -> str:
    """Return the name of a stage as part of a file's name."""
    return re.sub(r"[^\w.]+", "-", stage).strip("-")
