"""The pages of pictures: one for each, and one over all of several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from math import isfinite
from typing import TYPE_CHECKING

from .digits import cdp_decimals, cdp_interval, exposure, fixed, percent, printable
from .document import Document, Section
from .facts import Fact
from .figures import ReportFigure
from .image_tables import (
    joined,
    measured_contrast,
    neighbour_table,
    overview_table,
    pair_table,
    region_table,
    unit_text,
    where,
)
from .page import document_page, page_environment

if TYPE_CHECKING:
    from ..contrast import DetectionResult
    from ..evaluate.image import ImageEvaluation

#: A longer table is left to the spreadsheet.
_MOST_ROWS = 2000
_KIND = "labcdp report: contrast detection probability (CDP) of pictures"


@dataclass(frozen=True)
class ReportedPicture:
    """A picture in the overview of several.

    Parameters
    ----------
    number : int
        Its number, in the order they were given.
    file : str
        Its file, as it was given.
    folder : str
        Folder of its page beside the overview.
    evaluation : ImageEvaluation or None
        What it says; None if it failed.
    failure : str
        Why it failed.
    """

    number: int
    file: str
    folder: str
    evaluation: ImageEvaluation | None
    failure: str = ""


def picture_page(
    evaluation: ImageEvaluation, figures: Sequence[ReportFigure], conversion: str, surface: bool, epsilon: float
) -> str:
    """Write the page of one picture.

    Parameters
    ----------
    evaluation : ImageEvaluation
        What it says.
    figures : sequence of ReportFigure
        Its figures.
    conversion : str
        How its values became luminance.
    surface : bool
        Whether a page with its surface stands beside this one.
    epsilon : float
        Tolerance of the contrasts.
    """
    by_kind = {
        kind: [figure for figure in figures if figure.file_name.startswith(kind)]
        for kind in ("picture", "contrasts", "cdp", "values")
    }
    tables = [("Contrasts of the regions", pair_table(evaluation))] if evaluation.pairs else []
    if evaluation.neighbours is not None:
        tables.append(("From pixel to pixel", neighbour_table(evaluation)))
    beside = ("The luminance as a surface that can be turned is in surface.html, beside this page.",) if surface else ()
    sections = [
        Section("", (*_results(evaluation), *beside)),
        Section("Picture", figures=by_kind["picture"]),
        Section(
            "Contrast detection probability",
            (
                "CDP is the share of all pairs of a bright and a dark pixel whose Weber contrast lies within the "
                f"tolerance of {percent(epsilon)} around the contrast asked for; below and above are the shares to "
                "either side. The measured contrast is that of the means. CSNR is mean over standard deviation of the "
                "contrasts of all pairs. What follows ± is the half width of a 95 % interval, which holds scatter of "
                "the pixels, also where neighbours are alike, and calibration.",
            ),
            tables,
            [*by_kind["contrasts"], *by_kind["cdp"]],
        ),
        Section("Values", (), [("Regions", region_table(evaluation))] if evaluation.regions else [], by_kind["values"]),
        Section("Provenance", facts=_facts(evaluation, conversion)),
    ]
    return document_page(
        Document(_KIND, evaluation.path.name, "", [printable(text) for text in evaluation.warnings], sections)
    )


def overview_page(pictures: Sequence[ReportedPicture], conversion: str, epsilon: float) -> str:
    """Write the page over several pictures, with their failures, and links to the page of each.

    Parameters
    ----------
    pictures : sequence of ReportedPicture
        In the order they were given.
    conversion : str
        How their values became luminance.
    epsilon : float
        Tolerance of the contrasts.
    """
    good = [picture.evaluation for picture in pictures if picture.evaluation is not None]
    failed = [picture for picture in pictures if picture.evaluation is None]
    table = overview_table(good)
    return (
        page_environment()
        .get_template("images.html")
        .render(
            kind=_KIND,
            title=f"{len(pictures)} pictures",
            banner=f"{len(failed)} of {len(pictures)} pictures failed." if failed else "",
            failures=[(printable(picture.file), printable(picture.failure)) for picture in failed],
            warnings=shared_warnings(good),
            table=table if len(table.rows) <= _MOST_ROWS else None,
            epsilon=percent(epsilon),
            pages=[
                (picture.folder, printable(picture.file), picture.number)
                for picture in pictures
                if picture.evaluation is not None
            ],
            facts=[Fact("Conversion", printable(conversion)), _made_by()],
        )
    )


def _results(evaluation: ImageEvaluation) -> list[str]:
    """Tell CDP and contrast of each pair in a sentence."""
    lines = []
    for pair in evaluation.pairs:
        best = max((joined(one) for one in pair.result.results), key=lambda one: one.cdp)
        measured = measured_contrast(pair)
        lines.append(
            f"{printable(pair.name)}: the measured contrast is {measured}{' %' if measured[-1].isdigit() else ''}; "
            f"{_probability(best, len(pair.result.results))}."
        )
    if evaluation.neighbours is not None:
        found = [joined(one) for one in evaluation.neighbours.results]
        near = _probability(max(found, key=lambda one: one.cdp), len(found))
        lines.append(f"From pixel to pixel, {where(evaluation.neighbours.rectangle)}: {near}.")
    return lines


def _probability(result: DetectionResult, n_contrasts: int) -> str:
    """Tell the CDP of a contrast, which is the most probable of several."""
    interval = f" (95 %: {cdp_interval(result)})" if isfinite(result.confidence_interval[0]) else ""
    cdp = fixed(result.cdp, cdp_decimals(result))
    which = "" if n_contrasts == 1 else f"of {n_contrasts} contrasts, "
    most = "" if n_contrasts == 1 else " most probably,"
    return f"{which}{percent(result.contrast)} is detected{most} with a probability of {cdp}{interval}"


def _facts(evaluation: ImageEvaluation, conversion: str) -> list[Fact]:
    height, width = evaluation.shape
    facts = [
        Fact("File", str(evaluation.path)),
        Fact("SHA-256", evaluation.sha256),
        Fact("Size", f"{width} x {height} pixels"),
        Fact("Exposure", "not known" if evaluation.exposure_s is None else exposure(evaluation.exposure_s)),
        *([] if evaluation.camera is None else [Fact("Camera", evaluation.camera)]),
        *(Fact("Values of the file", note) for note in evaluation.notes),
        Fact("Conversion", conversion),
        Fact("Unit", unit_text(evaluation.unit)),
        _made_by(),
    ]
    return [Fact(fact.name, printable(fact.value)) for fact in facts]


def _made_by() -> Fact:
    return Fact("Made by", f"labcdp {version('labcdp')}")


def shared_warnings(evaluations: Sequence[ImageEvaluation]) -> list[str]:
    """Return each warning once and, of several pictures, which one or how many have it."""
    found: dict[str, list[str]] = {}
    for evaluation in evaluations:
        for warning in evaluation.warnings:
            found.setdefault(warning, []).append(evaluation.path.name)
    if len(evaluations) == 1:
        return [printable(warning) for warning in found]
    return [
        printable(f"{warning} ({names[0] if len(names) == 1 else f'{len(names)} pictures'})")
        for warning, names in found.items()
    ]
