"""The files of a simulated image: page, spreadsheet, numbers, chain file and pictures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ....chain import ChainRun
from ....core.result import Result
from ....core.table import Table
from ....output import Destination, write_files
from ....report.files import result_files
from ....report.layout import SIMULATED, Block, Card, Facts, Page, ReportFigure, Section, Verbatim
from ....report.plots import contrast_figures
from ....report.text import cell_text, percent
from .evaluation import SimulationEvaluation, final_stages
from .figures import along_figures, contrast_panels, file_name, picture, shown_picture, stage_figures
from .result import answer


def write_simulation(
    result: Result, evaluation: SimulationEvaluation, run: ChainRun, folder: Destination
) -> list[Path]:
    """Write a simulated image, with the pictures of its run, into a folder as `write_files` takes it.

    Everything is made before the first file is written; InputError is raised if one cannot be written.

    Returns
    -------
    list of Path
        results.json, report.html, results.xlsx, chain.toml, figures/*.png and images/*.png.
    """
    figures = {
        "along": along_figures(evaluation),
        "contrasts": contrast_figures(contrast_panels(evaluation), "chain"),
        "stages": stage_figures(evaluation),
    }
    pictures = {name: shown_picture(name, signal.values) for name, signal in run.items()}
    page = _page(result, evaluation, figures, pictures)
    files = {
        **result_files(result, page, [figure for group in figures.values() for figure in group]),
        "chain.toml": evaluation.chain.to_toml().encode(),
        **{f"images/{file_name(name)}.png": picture(signal.values) for name, signal in run.items()},
    }
    return write_files(folder, "simulate", files)


def _page(
    result: Result,
    evaluation: SimulationEvaluation,
    figures: Mapping[str, list[ReportFigure]],
    pictures: Mapping[str, ReportFigure],
) -> Page:
    chain, signal = evaluation.chain, result.table("signal")
    detection = next((table for table in result.tables if table.name == "detection"), None)
    final = final_stages(chain)
    facts = Facts((("Chain", f"{chain.name}: {chain.description}"), ("Random seed", str(evaluation.seed))))
    details: list[Block] = [*figures["along"], *figures["contrasts"]]
    if detection is not None:
        details += [
            detection,
            "CSNR is the mean over the standard deviation of the contrast, CNR the difference of the mean luminances "
            "over the noise of the dark region, d' over that of both regions. SNR is spatial, mean over standard "
            "deviation of the pixels of one frame. That of the values gains from the black level, which carries no "
            "information; that of the luminance does not.",
            signal,
        ]
    return Page(
        "simulated imaging chain",
        result.title,
        summary=(answer(detection, final) if detection is not None else "") or chain.description,
        banner=SIMULATED,
        cards=[] if detection is None else _cards(detection, final),
        lead=(pictures[final[-1]], signal if detection is None else _short(detection)),
        findings=result.findings,
        sections=[
            *([Section("Signal and noise", details)] if details else []),
            Section("Distributions behind each stage", figures["stages"], collapsed=True),
            Section(
                "Pictures behind each stage",
                ("Each from its lowest value (black) to its highest (white).", *pictures.values()),
                collapsed=True,
            ),
            Section("Chain and provenance", (facts, Verbatim(chain.to_toml())), collapsed=True),
        ],
    )


def _short(detection: Table) -> Table:
    pair = () if len({*zip(detection["bright"], detection["dark"], strict=True)}) == 1 else ("bright", "dark")
    return detection.showing("stage", *pair, "measured_contrast", "cdp", "cdp_neighbours")


def _cards(detection: Table, final: tuple[str, ...]) -> list[Card]:
    """Return a card for each pair behind the last stage of each sensor."""
    neighbours = "cdp_neighbours" in detection.data
    cdp = detection.column("cdp_neighbours" if neighbours else "cdp")
    cards = []
    for row in detection.rows():
        if row["stage"] not in final:
            continue
        value, _, interval = cell_text(cdp, row).partition(" (")
        asked = row["contrast"]
        lines = [] if asked is None else [f"contrast to detect {percent(asked, 4)}"]
        lines.append(f"measured {cell_text(detection.column('measured_contrast'), row)} %")
        kind = "CDP, nearest-neighbour" if neighbours else "CDP"
        cards.append(
            Card(
                f"{row['bright']} / {row['dark']}, behind {row['stage']}",
                value,
                f"{kind}; 95 % interval {interval[:-1]}" if interval else kind,
                tuple(lines),
            )
        )
    return cards
