"""The results of a simulated chain as files: page, spreadsheet, numbers and pictures."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import version
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..chain import ChainRun
from ..json_text import results_json
from ..toml_text import toml_text
from .digits import printable
from .document import Document, Section
from .drawing import block_mean, reduction
from .facts import Fact
from .figures import ReportFigure
from .folder import write_files
from .page import document_page
from .plots import contrasts_figure
from .simulation_tables import detection_table, signal_table
from .stage_plots import chain_figure, stage_figure
from .workbook import Cell, Number, Sheet, workbook

if TYPE_CHECKING:
    from ..contrast import DetectionResult
    from ..evaluate import PairRow, SimulationEvaluation, StageRow

#: A picture of a stage is enlarged, by repeating pixels, to at least this many pixels.
_PICTURE_SIDE = 600


def write_simulation(evaluation: SimulationEvaluation, run: ChainRun, folder: str | PathLike[str]) -> list[Path]:
    """Write the results of a simulated chain: for machines, for people, for spreadsheets, and as pictures.

    Parameters
    ----------
    evaluation : SimulationEvaluation
        The evaluation.
    run : ChainRun
        The run it is of, for the pictures.
    folder : path
        Made if it does not exist; files of an earlier run are replaced.

    Returns
    -------
    list of Path
        results.json, report.html, results.xlsx, chain.toml, figures/*.png and images/*.png.

    Raises
    ------
    InputError
        If a file cannot be written.
    """
    figures = _figures(evaluation)
    pictures = [_shown_picture(name, signal.values) for name, signal in run.items()]
    images = {f"images/{_file_name(name)}.png": _picture(signal.values) for name, signal in run.items()}
    files = {
        "results.json": results_json(simulation_values(evaluation)).encode(),
        "report.html": document_page(_document(evaluation, figures, pictures)).encode(),
        "results.xlsx": workbook(_sheets(evaluation), evaluation.chain.name, datetime.now(UTC)),
        "chain.toml": toml_text(evaluation.chain.document).encode(),
        **{f"figures/{figure.file_name}": figure.png for figure in figures},
        **images,
    }
    return write_files(Path(folder), files, r".*\.png")


def simulation_values(evaluation: SimulationEvaluation) -> dict[str, Any]:
    """Return all numbers of an evaluation, for JSON."""
    return {
        "chain": evaluation.chain.name,
        "seed": evaluation.seed,
        "epsilon": evaluation.epsilon,
        "stages": [
            {
                "name": stage.name,
                "quantity": stage.quantity,
                "unit": stage.unit,
                "regions": [asdict(row) for row in stage.regions],
                "pairs": [_pair_values(pair) for pair in stage.pairs],
            }
            for stage in evaluation.stages
        ],
        "warnings": list(evaluation.warnings),
        "parameters": dict(evaluation.chain.document),
        "versions": {name: version(name) for name in ("labcdp", "numpy", "scipy")},
    }


def _pair_values(pair: PairRow) -> dict[str, Any]:
    return {
        "dark": pair.dark,
        "bright": pair.bright,
        "true_contrast": pair.true_contrast,
        "measured_contrast": pair.measured_contrast,
        "cdp": None if pair.cdp is None else asdict(pair.cdp),
        "cdp_neighbours": None if pair.neighbours is None else asdict(pair.neighbours),
        "csnr": asdict(pair.csnr),
        "cnr": asdict(pair.cnr),
        "d_prime": asdict(pair.d_prime),
    }


def _document(evaluation: SimulationEvaluation, figures: list[ReportFigure], pictures: list[ReportFigure]) -> Document:
    chain = evaluation.chain
    along = [figure for figure in figures if figure.file_name.startswith("chain")]
    contrasts = [figure for figure in figures if figure.file_name.startswith("contrasts")]
    stages = [figure for figure in figures if figure.file_name.startswith("stage")]
    facts = [
        Fact("Chain", f"{printable(chain.name)}: {printable(chain.description)}"),
        Fact("Seed of the noise", str(evaluation.seed)),
        Fact("Made by", f"labcdp {version('labcdp')}"),
    ]
    detection = Section(
        "Contrast detection probability",
        (
            "CDP is the share of all pairs of a bright and a dark pixel whose Weber contrast lies within the tolerance "
            "around the contrast asked for; below and above are the shares to either side. Pixel to pixel is each "
            "pixel against its right and its lower neighbour. CSNR is mean over standard deviation of the contrast, "
            "CNR the difference of the means over the noise of the dark region, d' over that of both.",
        ),
        (("Contrasts and their detection probability behind each stage", detection_table(evaluation)),),
        [*along, *contrasts],
    )
    signal = Section(
        "Signal and noise",
        (
            "Mean and standard deviation of the values each stage hands on, their ratio (SNR), and the luminance these "
            "values stand for. The SNR of the values gains from glare and black level, which carry no information; "
            "that of the luminance does not.",
        ),
        (("Regions of the scene behind each stage", signal_table(evaluation)),),
        stages,
    )
    text = "\n".join(printable(line) for line in toml_text(chain.document).splitlines())
    sections = ([detection] if any(stage.pairs for stage in evaluation.stages) else []) + [
        signal,
        Section("Pictures", ("Each from its lowest value (black) to its highest (white).",), (), pictures),
        Section("Provenance", facts=facts, text=text),
    ]
    return Document("labcdp: simulated imaging chain", chain.name or "chain", "", list(evaluation.warnings), sections)


def _figures(evaluation: SimulationEvaluation) -> list[ReportFigure]:
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
        (f"{_file_name(own)}-", (*front, *(chain.of_sensor(name, own) for name in chain.recorded_names)))
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
        f"stage-{_file_name(stage.name)}.png",
        stage_figure(stage.name, stage.native, f"{stage.quantity} in {unit}", stage.luminance),
        f"{printable(stage.name)}: cumulative probability (blue) and density (grey, scaled to 1) of the values of the "
        "whole frame, and of the luminance they stand for.",
        f"Distribution of the values behind {printable(stage.name)}.",
    )


def _sheets(evaluation: SimulationEvaluation) -> list[Sheet]:
    signal: list[tuple[Cell, ...]] = [
        (
            stage.name,
            row.region,
            stage.unit,
            Number(row.mean, 4),
            Number(row.standard_deviation, 4),
            Number(row.snr.value, 3),
            Number(row.snr.standard_error, 3),
            Number(row.snr_10log10_db.value, 3),
            Number(row.snr_20log10_db.value, 3),
            Number(row.true_cd_m2, 4),
            Number(row.luminance_cd_m2, 4),
            Number(row.luminance_standard_deviation_cd_m2, 4),
            Number(row.luminance_snr.value, 3),
            Number(100 * row.saturated_share, 3),
        )
        for stage in evaluation.stages
        for row in stage.regions
    ]
    signal_head = (
        "Stage",
        "Region",
        "Unit",
        "Mean",
        "Standard deviation",
        "SNR (mean/std)",
        "Standard error of SNR",
        "10 lg SNR in dB",
        "20 lg SNR in dB",
        "Scene in cd/m²",
        "Seen in cd/m²",
        "Standard deviation in cd/m²",
        "SNR of cd/m²",
        "Saturated in %",
    )
    return [
        Sheet("Detection", _DETECTION_HEAD, list(_detection_rows(evaluation))),
        Sheet("Signal", signal_head, signal),
        Sheet("Chain", ("Chain file",), [(line,) for line in toml_text(evaluation.chain.document).splitlines()]),
        Sheet(
            "Provenance",
            ("What", "Value"),
            [
                ("Chain", evaluation.chain.name),
                ("Seed", Number(evaluation.seed, 0)),
                ("labcdp", version("labcdp")),
                *(("Warning", warning) for warning in evaluation.warnings),
            ],
        ),
    ]


_DETECTION_HEAD = (
    "Stage",
    "Bright",
    "Dark",
    "Contrast of the scene in %",
    "Seen in %",
    "CDP",
    "Standard error",
    "95 % from",
    "95 % to",
    "Below",
    "Above",
    "CDP pixel to pixel",
    "Standard error pixel to pixel",
    "CSNR",
    "CNR",
    "d'",
)


def _detection_rows(evaluation: SimulationEvaluation) -> Iterator[tuple[Cell, ...]]:
    for stage in evaluation.stages:
        for pair in stage.pairs:
            cdp, pixel = pair.cdp, pair.neighbours
            yield (
                stage.name,
                pair.bright,
                pair.dark,
                Number(100 * pair.true_contrast, 2),
                Number(100 * pair.measured_contrast, 2),
                *(
                    (None,) * 6
                    if cdp is None
                    else (
                        Number(cdp.cdp, 5),
                        Number(cdp.standard_error, 5),
                        Number(cdp.confidence_interval[0], 5),
                        Number(cdp.confidence_interval[1], 5),
                        Number(cdp.below, 5),
                        Number(cdp.above, 5),
                    )
                ),
                *((None, None) if pixel is None else (Number(pixel.cdp, 5), Number(pixel.standard_error, 5))),
                Number(pair.csnr.value, 3),
                Number(pair.cnr.value, 3),
                Number(pair.d_prime.value, 3),
            )


def _shown_picture(name: str, values: NDArray[Any]) -> ReportFigure:
    """Return the picture of a stage for the page, a large one with fewer pixels."""
    side = reduction((values.shape[0], values.shape[1]))
    low, high = float(values.min()), float(values.max())
    reduced = f"; {side} x {side} pixels are drawn as one" if side > 1 else ""
    return ReportFigure(
        f"{_file_name(name)}.png",
        _picture(values if side == 1 else block_mean(values, side)),
        f"{printable(name)}: {low:.4g} to {high:.4g}{reduced}",
        f"Grey picture behind {printable(name)}.",
    )


def _picture(values: NDArray[Any]) -> bytes:
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


def _file_name(stage: str) -> str:
    return re.sub(r"[^A-Za-z0-9.]+", "-", stage).strip("-")
