"""A video's results as a page."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ....core.result import Result
from ....core.table import Table
from ....report.cells import cell_text
from ....report.digits import fixed, percent, printable, significant
from ....report.figure import ReportFigure
from ....report.layout import Block, Card, Facts, Page, Section, Verbatim, input_facts
from ..result import DETECTED_CDP, contrast_name, is_neighbours
from .figure import drawn_contrasts, frames_of_a_point, video_figure

if TYPE_CHECKING:
    from xarray import Dataset

#: Contrasts that get a card, beside the measured one.
_MOST_CARDS = 3
#: How regions are followed, by the method's name.
METHODS = {"follow": "tracked", "homography": "tracked by the homography of a plane target", "fixed": "at rest"}


def video_page(dataset: Dataset, result: Result, figure: ReportFigure) -> Page:
    """Return the page: how often contrasts were detected, curves over time, then regions, notes and provenance."""
    tables = {table.name: table for table in result.tables}
    sections = []
    if "regions" in tables:
        text = "A region that cannot be found again is lost: its frames have no CDP."
        blocks: list[Block] = [tables["regions"], *([tables["lost"]] if "lost" in tables else []), text]
        sections.append(Section("Regions", blocks))
    if "notes" in tables:
        sections.append(Section("Notes on frames", [tables["notes"]], collapsed=True))
    sections.append(Section("Provenance and settings", _provenance(dataset, result), collapsed=True))
    return Page(
        "CDP of a video",
        result.title,
        summary=_summary(dataset, result),
        cards=[*_measured(dataset), *(_card(row, tables["contrasts"]) for row in _chosen(tables["contrasts"]))],
        lead=(figure, tables["contrasts"]),
        findings=result.findings,
        sections=sections,
    )


def over_time(dataset: Dataset, result: Result) -> ReportFigure:
    """Draw the figure, with its caption."""
    parts = [f"CDP with its 95 % interval; the dotted line is {DETECTED_CDP:g}."]
    if len(drawn_contrasts(dataset)) + 1 < dataset.sizes["contrast"]:
        parts.append(f"Of the {dataset.sizes['contrast']} contrasts some are drawn.")
    if "measured_contrast" in dataset:
        parts.append("Below: Weber contrast of the regions' means with its 95 % interval.")
    if "quality" in dataset:
        parts.append("At the bottom: tracking quality of each region, from 0 to 1.")
    if any(row["n_evaluated"] < dataset.sizes["frame"] for row in result.table("contrasts").rows()):
        parts.append("Shaded: frames without a result.")
    if (number := frames_of_a_point(dataset)) > 1:
        parts.append(
            f"Each drawn point stands for {number} frames: the line is their mean, the band reaches from the lowest "
            "to the highest end of their intervals."
        )
    alternative = "Curves of CDP, measured contrast and quality over time."
    return ReportFigure("over-time.png", video_figure(dataset, result), " ".join(parts), alternative)


def _chosen(contrasts: Table) -> list[dict[str, Any]]:
    """Return the reference and some of the contrasts, spread over their range."""
    rows = list(contrasts.rows())
    if len(rows) <= _MOST_CARDS:
        return rows
    places = [round(n * (len(rows) - 1) / (_MOST_CARDS - 1)) for n in range(_MOST_CARDS)]
    return [rows[place] for place in places]


def _measured(dataset: Dataset) -> Iterator[Card]:
    """Yield the card of the measured contrast: what contrasts asked for are to be compared with."""
    if "measured_contrast" not in dataset:
        return
    found = dataset["measured_contrast"].to_numpy()
    found = found[np.isfinite(found)]
    if found.size:
        low, middle, high = (f"{significant(100 * one)} %" for one in np.quantile(found, (0, 0.5, 1)))
        yield Card("Measured contrast", middle, "median of the frames", (f"{low} to {high}",))


def _card(row: Mapping[str, Any], contrasts: Table) -> Card:
    name = contrast_name(row)
    title = name[0].upper() + name[1:]
    if not row["n_evaluated"]:
        return Card(title, "no result", "No frame has a CDP of this contrast.")
    return Card(
        title,
        f"{cell_text(contrasts.column('detected_share'), row)} %",
        f"of the frames have CDP ≥ {DETECTED_CDP:g}",
        (
            f"mean CDP {fixed(row['mean_cdp'], 3)}",
            f"lowest CDP {fixed(row['lowest_cdp'], 3)}, in frame {row['lowest_frame']}",
        ),
    )


def _summary(dataset: Dataset, result: Result) -> str:
    values = {row["quantity"]: row["value"] for row in result.table("summary").rows()}
    frames = f"{values['evaluated frames']} frames, number {values['first frame']} to {values['last frame']}"
    tolerance = dataset.attrs.get("epsilon", "")
    within = f" Detected: within {percent(tolerance)} of the contrast." if isinstance(tolerance, float) else ""
    if is_neighbours(dataset):
        return f"CDP between each pixel and its right and lower neighbour: {frames}.{within}"
    names = " and ".join(f"“{name}”" for name in map(str, dataset["region"].values))
    method = str(dataset.attrs.get("method", ""))
    method = METHODS.get(method, f"tracked ({method})")
    return printable(f"CDP between the regions {names}, {method}: {frames}.{within}")


def _provenance(dataset: Dataset, result: Result) -> list[Block]:
    versions = ("evaluated with", str(dataset.attrs.get("versions", "")))
    settings = "\n".join(
        f"{name}: {value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)}"
        for name, value in result.configuration.items()
        if value is not None
    )
    return [Facts([*input_facts(result), versions]), Verbatim(settings)]
