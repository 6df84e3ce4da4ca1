"""The page of one picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...core.clock import exposure_text
from ...core.result import Result
from ...core.table import Table
from ...metrics.pair import Pair
from ...report.html import render_page
from ...report.layout import Block, Card, Links, Page, ReportFigure, Section, facts_table, input_facts
from ...report.text import (
    MISSING,
    UNKNOWN,
    cdp_decimals,
    cdp_interval,
    fixed,
    measured_contrast_text,
    percent,
    significant,
)
from ..judgement import requirement_cards
from ..verdict import STATES, Verdict, cdp_verdict
from .image import AnyContrast, MeasuredPicture

#: Cards of a page; the table has all.
_MOST_CARDS = 8
#: Rows of a table that is shown whole; a longer one has the largest CDP of each pair.
_MOST_ROWS = 12
#: Columns next to the picture.
_SHORT = ("picture", "pair", "measured_contrast", "contrast", "contrast_origin", "cdp", "verdict")


def picture_page(
    picture: MeasuredPicture, result: Result, figures: Sequence[ReportFigure], limit: float, surface: bool
) -> str:
    """Return the page of one picture.

    Parameters
    ----------
    picture : MeasuredPicture
        The measured picture.
    result : Result
        Of this picture alone.
    figures : sequence of ReportFigure
        Its figures.
    limit : float
        CDP from which a contrast counts as detected.
    surface : bool
        Whether there is also a page with its surface.
    """
    named = {figure.file_name: figure for figure in figures}
    lead: list[Block] = [named.pop("picture.png")]
    values = named.pop("values.png")
    clouds = named.pop("colours.png", "")
    details: list[Block] = [*named.values()]
    for table in result.tables_named("cdp"):
        if picture.chart is None:
            lead.append(_short(table))
        details.append(table)
    cards = [*requirement_cards(result), *_cards(picture, limit)]
    of_chart: list[Section] = []
    if picture.chart is not None:
        from ..chart.figures import chart_section, range_cards

        cards = [*requirement_cards(result), *range_cards(picture.chart)]
        lead += result.tables_named("dynamic_range")
        of_chart = [chart_section(picture.file, picture.chart, result)]
    of_colours: list[Section] = []
    if picture.colours:
        from ..colour.figures import colour_cards

        cards += colour_cards(picture.colours)
        of_colours = [Section("Colours", [clouds, *result.tables_named("colour_separation")])]
    links = [Links([("The luminance as a surface that can be turned", "surface.html")])] if surface else []
    sections = [
        *(Section("Requirement", [table]) for table in result.tables_named("requirement")),
        *of_chart,
        *of_colours,
        Section("Contrasts", details),
        Section("Regions and values", [*result.tables_named("regions"), values]),
        *(Section("Surface", [link]) for link in links),
        Section("Provenance", [_provenance(picture, result)], collapsed=True),
    ]
    return render_page(
        Page.of(
            result,
            "Contrast detection probability (CDP) of a picture",
            cards=cards,
            lead=lead,
            sections=sections,
        )
    )


def _short(table: Table) -> Table:
    """Return the table next to the picture: few columns, and of many contrasts the largest CDP of each pair."""
    if len(table) <= _MOST_ROWS:
        return replace(table.showing(*_SHORT), note="")
    best: dict[str, tuple[float, int]] = {}
    for row, (pair, cdp) in enumerate(zip(table["pair"], table["cdp"], strict=True)):
        if (-1.0 if cdp is None else cdp) > best.get(pair, (-2.0, 0))[0]:
            best[pair] = -1.0 if cdp is None else cdp, row
    short = table.select([row for _, row in best.values()]).showing(*_SHORT)
    return replace(short, note="The contrast with the largest CDP of each pair; all are below.")


def _cards(picture: MeasuredPicture, limit: float) -> list[Card]:
    """Make a card for each pair, of the contrast with the largest CDP."""
    targets = {target for contrast in picture.contrasts for target in contrast.cdp.contrast.tolist()}
    shown = [contrast for contrast in picture.contrasts if len(contrast.cdp) or isinstance(contrast, Pair)]
    return [_card(contrast, len(targets), limit) for contrast in shown[:_MOST_CARDS]]


def _card(contrast: AnyContrast, n_targets: int, limit: float) -> Card:
    value, interval, target = MISSING, "", MISSING
    verdict: Verdict | None = None
    bound = contrast.bound if isinstance(contrast, Pair) else ""
    if bound:
        verdict = "saturated"
        targets = contrast.cdp.contrast.tolist()
        target = MISSING if not targets else f"{percent(targets[0])}{f' and {n_targets - 1} others' * (n_targets > 1)}"
    elif len(contrast.cdp):
        cdp = max(contrast.cdp, key=lambda cdp: cdp.cdp)
        value, interval, target = fixed(cdp.cdp, cdp_decimals(cdp)), cdp_interval(cdp), percent(cdp.contrast)
        verdict = cdp_verdict(cdp.cdp, cdp.interval, limit)
        if contrast.targets_measured_contrast:
            target = f"{significant(100 * cdp.contrast)} % (as measured)"
        elif n_targets > 1:
            target += f" (largest CDP of {n_targets})"
    detail = f"CDP, 95 %: {interval}" if interval not in ("", UNKNOWN) else "CDP"
    lines = (
        f"target contrast {target}",
        f"contrast measured {measured_contrast_text(contrast.contrast, bound)}",
        f"detected if CDP ≥ {limit:g}",
    )
    return Card(contrast.name, value, detail, lines, verdict or "", STATES[verdict] if verdict else "plain")


def _provenance(picture: MeasuredPicture, result: Result) -> Table:
    source = picture.source
    assert source is not None
    height_px, width_px = source.shape
    return facts_table(
        [
            *input_facts(result),
            ("size", f"{width_px} x {height_px} pixels"),
            ("exposure", "not known" if source.exposure_s is None else exposure_text(source.exposure_s)),
            ("encoding", source.encoding),
            ("camera", source.camera or ""),
            ("unit", source.unit),
            ("conversion", source.conversion),
        ]
    )
