"""The pages of pictures: one for each, and one over all of several."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ...core.clock import exposure_text
from ...core.result import Result
from ...core.table import Table
from ...report.html import render_page
from ...report.layout import Block, Card, Facts, Links, Page, ReportFigure, Section, input_facts
from ...report.text import MISSING, UNKNOWN, cell_text, cell_texts
from ..requirement import requirement_cards
from ..verdict import STATES
from .summary import summary_cards, trend_figure
from .tables import ReportedPicture

#: Cards of a page; the table has all.
_MOST_CARDS = 8
#: Rows of a table that is shown at once; a longer one is collapsed, or has the largest CDP of each pair.
MOST_ROWS = 12
#: Pictures with the lowest CDP whose pages are named before those of all.
_MOST_WORST = 10
#: Columns next to the picture.
_SHORT = ("picture", "pair", "measured_contrast", "contrast", "contrast_origin", "cdp", "verdict")


def picture_page(result: Result, figures: Sequence[ReportFigure], conversion: str, surface: bool) -> str:
    """Return the page of one picture.

    Parameters
    ----------
    result : Result
        Of this picture alone.
    figures : sequence of ReportFigure
        Its figures.
    conversion : str
        How its values became luminance.
    surface : bool
        Whether there is also a page with its surface.
    """
    (table,) = _tables(result, "cdp") or (None,)
    named = {figure.file_name: figure for figure in figures}
    lead: list[Block] = [named.pop("picture.png")]
    values = named.pop("values.png")
    details: list[Block] = [*named.values()]
    if table is not None:
        lead.append(_short(table))
        details.append(table)
    sections = [
        *(Section("Requirement", [table]) for table in _tables(result, "requirement")),
        Section("Contrasts", details),
        Section("Regions and values", [*_tables(result, "regions"), values]),
        *([Section("Surface", [Links([("The luminance as a surface that can be turned", "surface.html")])])]
          if surface else []),
        Section("Provenance", [_provenance(result, conversion)], collapsed=True),
    ]  # fmt: skip
    return render_page(
        Page.of(
            result,
            "Contrast detection probability (CDP) of a picture",
            cards=[*requirement_cards(result), *([] if table is None else _cards(table))],
            lead=lead,
            sections=sections,
        )
    )


def overview_page(result: Result, pictures: Sequence[ReportedPicture], conversion: str) -> str:
    """Return the page over several pictures: mean, spread, worst and trend, then all rows and the page of each.

    Parameters
    ----------
    result : Result
        Of all pictures.
    pictures : sequence of ReportedPicture
        In the order they were given.
    conversion : str
        How their values became luminance.
    """
    failed = sum(one.evaluation is None for one in pictures)
    pages = {one.number: (one.file, f"{one.folder}/report.html") for one in pictures if one.evaluation and one.folder}
    of_all = f"{len(pictures) - failed} of {len(pictures)} pictures were evaluated." if failed else ""
    cards: list[Card] = []
    lead: list[Block] = []
    sections = [Section("Requirement", [table]) for table in _tables(result, "requirement")]
    # Neighbours without light have no contrast at all.
    for cdp in _tables(result, "cdp"):
        summary, limit = result.table("over_pictures"), cdp["cdp_limit"][0]
        cards, lead = [*summary_cards(summary, limit)], [trend_figure(cdp, summary, limit)]
        sections += [
            Section("", [summary]),
            *(
                [Section("Pictures with the lowest CDP", [Links(_worst(cdp, pages))])]
                if len(pages) > _MOST_WORST
                else []
            ),
            Section("All pictures", [cdp], len(cdp) > MOST_ROWS),
        ]
    sections += [
        *([Section("Pages of the pictures", [Links([*pages.values()])], len(pages) > _MOST_WORST)] if pages else []),
        Section("Details", _tables(result, "regions", "pictures"), True),
        Section("Provenance", [Facts([("conversion", conversion)])], collapsed=True),
    ]
    return render_page(
        Page.of(
            result,
            "Contrast detection probability (CDP) of pictures",
            of_all,
            cards=[*requirement_cards(result), *cards],
            lead=lead,
            sections=sections,
        )
    )


def _worst(cdp: Table, pages: Mapping[int, tuple[str, str]]) -> list[tuple[str, str]]:
    """Return the pages of the pictures with the lowest CDP, each with what it is of."""
    found: dict[int, tuple[str, str]] = {}
    for row in cdp.sorted_by("cdp").rows():
        if row["cdp"] is not None and row["number"] in pages and len(found) < _MOST_WORST:
            file, page = pages[row["number"]]
            text = f"{file}: CDP {cell_text(cdp.column('cdp'), row)} of {row['pair']}"
            found.setdefault(row["number"], (text, page))
    return [*found.values()]


def _tables(result: Result, *names: str) -> list[Table]:
    """Return the tables of these names, of those that the result has."""
    return [table for table in result.tables if table.name in names]


def _best(table: Table) -> Table:
    """Return of each pair the row of the contrast with the largest CDP."""
    best: dict[str, tuple[float, int]] = {}
    for at, row in enumerate(table.rows()):
        cdp = -1.0 if row["cdp"] is None else row["cdp"]
        if cdp > best.get(row["pair"], (-2.0, 0))[0]:
            best[row["pair"]] = cdp, at
    return table.select([at for _, at in best.values()])


def _short(table: Table) -> Table:
    """Return the table next to the picture: few columns, and of many contrasts the largest CDP of each pair."""
    short = (table if len(table) <= MOST_ROWS else _best(table)).showing(*_SHORT)
    text = "The contrast with the largest CDP of each pair; all are below." if len(table) > MOST_ROWS else ""
    return replace(short, note=text)


def _cards(table: Table) -> list[Card]:
    """Make a card for each pair, of the contrast with the largest CDP."""
    cards = []
    n_contrasts = len(set(table["contrast"]))
    for row in list(_best(table).rows())[:_MOST_CARDS]:
        texts = {column.name: cell_text(column, row) for column in table.columns}
        value, _, interval = cell_texts(table.column("cdp"), row)
        asked = f"target contrast {texts['contrast']} %"
        if row["contrast_origin"] == "measured":
            asked += " (as measured)"
        elif n_contrasts > 1:
            asked += f" (largest CDP of {n_contrasts})"
        unit = "" if texts["measured_contrast"] in (MISSING, UNKNOWN, "∞") else " %"
        measured = f"contrast measured {texts['measured_contrast']}{unit}"
        detail = f"CDP, 95 %: {interval}" if interval else "CDP"
        lines = (asked, measured, f"detected if CDP ≥ {row['cdp_limit']:g}")
        verdict = row["verdict"]
        cards.append(Card(row["pair"], value, detail, lines, verdict or "", STATES[verdict] if verdict else "plain"))
    return cards


def _provenance(result: Result, conversion: str) -> Facts:
    (row,) = result.table("pictures").rows()
    return Facts(
        [
            *input_facts(result),
            ("size", f"{row['width_px']} x {row['height_px']} pixels"),
            ("exposure", "not known" if row["exposure_s"] is None else exposure_text(row["exposure_s"])),
            ("encoding", row["encoding"]),
            *([("camera", row["camera"])] if row["camera"] else []),
            ("unit", row["unit"]),
            ("conversion", conversion),
        ]
    )
