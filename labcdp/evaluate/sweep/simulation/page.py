"""The files of a simulated or predicted image: page, spreadsheet, numbers, chain file and pictures."""

from __future__ import annotations

from collections.abc import Sequence

from ....chain import Chain
from ....core.result import Result
from ....core.table import Table
from ....metrics.contrast import TargetContrasts
from ....report.files import result_files
from ....report.layout import Block, Card, Page, Section, Verbatim, facts_table
from ....report.plots import contrast_figures
from ....report.text import cell_interval, cell_text, cell_value, percent
from .figures import along_figures, contrast_panels, file_name, picture, shown_picture, stage_figures
from .result import answer
from .rows import SimulationEvaluation

#: Most rows of a table beside the picture, and most cards of several contrasts.
_MOST_ROWS, _MOST_CARDS = 12, 6
_RATIOS = (
    "CSNR is the mean over the standard deviation of the contrast, CNR the difference of the mean luminances over the "
    "noise of the dark region, d' over that of both regions. SNR is spatial, mean over standard deviation of the "
    "pixels of one frame. The SNR of the values benefits from the black level, which carries no information; the "
    "SNR of the luminance does not."
)


def simulation_files(result: Result, evaluation: SimulationEvaluation) -> dict[str, bytes]:
    """Return the files of a simulated image, with the pictures of its run, by their names.

    Returns
    -------
    dict of str to bytes
        results.json, report.html, results.xlsx, chain.toml, figures/*.png and images/*.png.
    """
    run, chain = evaluation.run, evaluation.run.chain
    along, stages = along_figures(evaluation), stage_figures(evaluation)
    contrasts = contrast_figures(contrast_panels(evaluation), "chain")
    pictures = {name: shown_picture(name, signal.values) for name, signal in run.items()}
    details: list[Block] = [*along, *contrasts]
    signal, final = result.table("signal"), chain.final_stages
    short = signal
    if len(result.tables) > 1:
        detection = result.table("detection")
        details += [detection, _RATIOS, signal]
        pair = () if len({*zip(detection["bright"], detection["dark"], strict=True)}) == 1 else ("bright", "dark")
        target_column = ("contrast",) if isinstance(evaluation.contrast, tuple) else ()
        short = detection.showing("stage", *pair, *target_column, "measured_contrast", "cdp", "cdp_neighbours")
        if len(short) > _MOST_ROWS:
            short = short.select([n for n, stage in enumerate(short["stage"]) if stage in final])
    sections = [
        *([Section("Signal and noise", details)] if details else []),
        Section("Distributions after each stage", stages, collapsed=True),
        Section(
            "Pictures after each stage",
            ("Each from its lowest value (black) to its highest (white).", *pictures.values()),
            collapsed=True,
        ),
    ]
    page = _page("simulated imaging chain", result, chain, final, (pictures[final[-1]], short), sections)
    images = {f"images/{file_name(name)}.png": picture(signal.values) for name, signal in run.items()}
    files = result_files(result, page, [*along, *contrasts, *stages])
    return {**files, "chain.toml": chain.to_toml().encode(), **images}


def prediction_files(result: Result, chain: Chain) -> dict[str, bytes]:
    """Return results.json, report.html, results.xlsx and chain.toml by their names."""
    detection = result.table("detection")
    page = _page("predicted imaging chain", result, chain, detection["stage"][-1:], (detection,), [])
    return {"chain.toml": chain.to_toml().encode(), **result_files(result, page)}


def _page(
    kind: str, result: Result, chain: Chain, final: Sequence[str], lead: Sequence[Block], sections: Sequence[Section]
) -> Page:
    """Return the page: answer and cards behind the last stages, what leads, sections, and the chain."""
    detection = next((table for table in result.tables if table.name == "detection"), None)
    target = result.configuration["contrast"]
    seed = [] if result.seed is None else [("Random seed", str(result.seed))]
    facts = facts_table([("Chain", f"{chain.name}: {chain.description}"), *seed])
    return Page.of(
        result,
        kind,
        summary=(answer(detection, final, chain, target) if detection is not None else "") or chain.description,
        cards=[] if detection is None else _cards(detection, final, target),
        lead=lead,
        sections=[*sections, Section("Chain and provenance", (facts, Verbatim(chain.to_toml())), collapsed=True)],
    )


def _cards(detection: Table, final: Sequence[str], contrast: TargetContrasts) -> list[Card]:
    """Return a card for each pair and contrast behind the last stage of each sensor."""
    neighbours = "cdp_neighbours" in detection.data
    cdp, cards = detection.column("cdp_neighbours" if neighbours else "cdp"), []
    several = isinstance(contrast, tuple)
    for row in detection.rows():
        if row["stage"] not in final:
            continue
        value, interval = cell_value(cdp, row), cell_interval(cdp, row)
        kind = "CDP, nearest-neighbour" if neighbours else "CDP"
        target = row.get("contrast", contrast)
        at = "" if target is None else percent(target, 4)
        lines = [f"target contrast {at}"] if at and not several else []
        if "measured_contrast" in row:
            lines.append(f"measured {cell_text(detection.column('measured_contrast'), row)} %")
        pair = f"{row['bright']} / {row['dark']}" if "bright" in row else ""
        of = " at ".join(words for words in (pair, at if several else "") if words)
        detail = f"{kind}; 95 % interval {interval}" if interval else kind
        lines = lines or ([] if several else ["contrast of the scene"])
        name = f"{of}, after {row['stage']}" if of else f"After {row['stage']}"
        cards.append(Card(name, value, detail, tuple(lines)))
    return [] if several and len(cards) > _MOST_CARDS else cards
