"""The results of a simulated chain as files: page, spreadsheet, numbers and pictures."""

from __future__ import annotations

from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import version
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..chain import ChainRun
from ..json_text import results_json
from ..toml_text import toml_text
from .digits import printable
from .document import Document, Section
from .facts import Fact
from .figures import ReportFigure
from .folder import write_files
from .page import document_page
from .simulation_figures import file_name, picture, shown_picture, simulation_figures
from .simulation_sheets import simulation_sheets
from .simulation_tables import detection_table, signal_table
from .workbook import workbook

if TYPE_CHECKING:
    from ..evaluate import PairRow, SimulationEvaluation


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
    figures = simulation_figures(evaluation)
    pictures = [shown_picture(name, signal.values) for name, signal in run.items()]
    images = {f"images/{file_name(name)}.png": picture(signal.values) for name, signal in run.items()}
    files = {
        "results.json": results_json(simulation_values(evaluation)).encode(),
        "report.html": document_page(_document(evaluation, figures, pictures)).encode(),
        "results.xlsx": workbook(simulation_sheets(evaluation), evaluation.chain.name, datetime.now(UTC)),
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
        "mean_contrast": pair.mean_contrast,
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
