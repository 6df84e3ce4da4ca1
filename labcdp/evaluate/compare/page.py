"""The files of a comparison: page, spreadsheet, numbers and figure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...core.result import Result
from ...output import Destination, write_files
from ...report.figure import ReportFigure
from ...report.files import result_files
from ...report.findings import finding_text
from ...report.layout import SIMULATED, Block, Card, Facts, Page, Section, State, input_facts
from ..sweep.report.labels import axis_unit, ends_text
from .compare import Comparison
from .figures import comparison_figure
from .result import answer

#: Most rows of a table beside the figure, and most cards.
_BRIEF, _MOST_CARDS = 10, 4
_METHOD = (
    "Each is compared with the first. The 95 % interval of a difference ends √(a² + b² - 2 r a b) from it, with the "
    "distances a and b of the ends of the two intervals and the correlation r by their common errors (JCGM 100:2008, "
    "5.2.2; for probabilities Newcombe 1998, method 10). A difference is significant if the interval does not contain "
    "0, which happens by chance in 1 of 20."
)


def write_comparison(found: Comparison, result: Result, folder: Destination) -> list[Path]:
    """Write a comparison into a folder as `write_files` takes it.

    Everything is made before the first file is written; InputError is raised if one cannot be written.

    Returns
    -------
    list of Path
        results.json, report.html, results.xlsx and figures/comparison.png.
    """
    png = comparison_figure(found)
    names = ", ".join(subject.name for subject in found.subjects)
    figures = [] if png is None else [ReportFigure("comparison.png", png, _caption(found), f"Comparison of {names}.")]
    return write_files(folder, "compare", result_files(result, _page(found, result, figures), figures))


def _page(found: Comparison, result: Result, figures: list[ReportFigure]) -> Page:
    said = answer(found)
    sentences = [finding_text(one) for one in said]
    tables = {table.name: table for table in result.tables}
    first = [tables[name] for name in ("usable_ranges", "differences") if name in tables]
    axes = [axis.name for axis in found.grid.axes] if found.grid else []
    kept = ("quantity", "name", "difference", "z", "differs", "low", "high", "decades", *axes)
    brief = [table.showing(*kept) for table in first]
    lead: tuple[Block, ...] = (*figures, *(table for table in brief if len(table) <= _BRIEF))
    sections = [
        *(Section("Values", (table,), len(table) <= _BRIEF) for table in first if table.name == "differences"),
        *(Section("Settings that differ", (tables[name],)) for name in ("settings",) if name in tables),
        *(Section("All places", (tables[name],), collapsed=True) for name in ("curves",) if name in tables),
        Section("Method and inputs", (_METHOD, Facts(input_facts(result))), collapsed=True),
    ]
    return Page(
        f"Comparison of {found.kind}s",
        result.title,
        " ".join(f"{text[:1].upper()}{text[1:]}." for text in sentences),
        SIMULATED if result.simulated else "",
        tuple(_cards(found)),
        lead,
        [one for one in result.findings if one not in said],
        sections,
    )


def _cards(found: Comparison) -> Iterator[Card]:
    """Yield the usable range of each map, or how many values differ and which one most."""
    if found.grid is not None and found.analyses:
        if len(found.subjects) > _MOST_CARDS:
            return
        axis = found.grid.axes[-1]
        for subject, analysis in zip(found.subjects, found.analyses, strict=True):
            one = analysis.widest
            if one is None or one.widest is None:
                yield Card(subject.name, "none", f"CDP nowhere ≥ {analysis.level:g}", state="bad")
                continue
            detail = f"{axis_unit(axis)}, {{}}range with CDP ≥ {analysis.level:g}"
            if len(analysis.usable_ranges) > 1:
                yield Card(subject.name, ends_text(axis, one.widest), detail.format("widest "))
                continue
            lowest, highest = one.intervals[0], one.intervals[-1]
            gap = "" if lowest is highest else ", with gaps" if len(one.intervals) > 2 else ", with a gap"
            whole = replace(lowest, ends=(lowest.ends[0], highest.ends[1]))
            yield Card(subject.name, ends_text(axis, whole), detail.format("") + gap)
        return
    for subject in found.subjects[1 : _MOST_CARDS + 1]:
        own = [row for row in found.rows if row.name == subject.name]
        n = sum(bool(row.difference.significant) for row in own)
        state: State = "bad" if n else "good"
        verdict, detail = "differs" if n else "", f"values differ significantly from {found.subjects[0].name}"
        yield Card(subject.name, f"{n} of {len(own)}", detail, verdict=verdict, state=state)
    known = [row for row in found.rows if np.isfinite(row.difference.z)]
    most = max(known, key=lambda row: abs(float(row.difference.z)), default=None)
    if most is not None and most.difference.z:
        yield Card("Most significant", f"z = {float(most.difference.z):.1f}", most.first.quantity, (most.name,))


def _caption(found: Comparison) -> str:
    first = found.subjects[0].name
    return f"CDP, and its difference from {first}." if found.analyses else "Bars and bands are 95 % intervals."
