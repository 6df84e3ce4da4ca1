"""The files of a map: page, picture, spreadsheet, numbers and NetCDF."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ....core.result import Result, info
from ....report.drawing import png
from ....report.files import dataset_bytes, result_files
from ....report.layout import SIMULATED, Card, Page, Section, Verbatim, facts_table
from ....report.text import significant
from .axes import TO_DETECT, VARIABLES
from .dips import SnrDip
from .labels import at_text, axis_name, axis_unit, conditions, ends_text, title, value_text, width_text
from .ranges import UsableRange
from .view import MapView

if TYPE_CHECKING:
    from xarray import Dataset

    from .map import MapAnalysis

#: Most cards of contrasts to be detected.
_MOST_CARDS = 4


def map_files(result: Result, dataset: Dataset, analysis: MapAnalysis) -> dict[str, bytes]:
    """Return the files of a map with all that it shows by their names.

    Returns
    -------
    dict of str to bytes
        map.nc, map.png, results.json, report.html and results.xlsx.
    """
    from .static import draw_map

    view = MapView.of(dataset, analysis)
    files = {"map.nc": dataset_bytes(dataset, "map"), "map.png": png(draw_map(view))}
    return {**files, **result_files(result, _page(result, view))}


def _page(result: Result, view: MapView) -> Page:
    from .interactive import map_script

    dataset, n_parts = view.map.dataset, len(view.parts)
    left_out = [info("map-sections-not-drawn", n_drawn=n_parts, n_sections=n_parts + view.left_out)]
    facts = [
        (str(name).replace("_", " "), str(value))
        for name, value in dataset.attrs.items()
        if name not in ("title", "chain_name", "chain") and value == value
    ]
    chain = str(dataset.attrs.get("chain", ""))
    tables = [table for table in result.tables if len(table) and (table.name == "dips" or not table.detail)]
    return Page(
        "map of contrast detection probability",
        title(dataset),
        summary=f"{_answer(view)} ({conditions(dataset)}).",
        banner=SIMULATED,
        cards=_cards(view),
        lead=(map_script(view),),
        findings=(*result.findings, *(left_out if view.left_out else ())),
        sections=[
            *([Section("Numbers", tables)] if tables else []),
            Section(
                "Chain and provenance", (facts_table(facts), *([Verbatim(chain)] if chain else [])), collapsed=True
            ),
        ],
    )


def _answer(view: MapView) -> str:
    """Return where CDP is high enough, without full stop."""
    widest, level = view.analysis.widest, view.analysis.level
    if widest is not None and widest.widest is not None:
        x, at = view.map.axes[widest.axis], at_text(widest.at, view.map.axes)
        where = f"{axis_name(x)} {ends_text(x, widest.widest)} {axis_unit(x)}".rstrip()
        return f"CDP is at least {level:g} for {where}{at and f', widest at {at}'}"
    highest = significant(float(view.map.dataset["cdp"].max()), 3)
    return f"CDP is at most {highest}" + (f", nowhere {level:g}" if view.analysis.usable_ranges else "")


def _cards(view: MapView) -> list[Card]:
    """Return the widest usable range, the deepest dip of each variable, and how well CDP is known."""
    analysis, ranges, cards = view.analysis, view.analysis.usable_ranges, []
    varied = {name for usable in ranges for name in usable.at if view.map.axes[name].values.size > 1}
    for_each_contrast = varied == {TO_DETECT} and len(ranges) <= _MOST_CARDS
    for shown_range in ranges if for_each_contrast else [analysis.widest or ranges[0]] if ranges else []:
        cards.append(_range(view, shown_range, not for_each_contrast and len(ranges) > 1))
    for variable in analysis.dip_variables:
        dips = [dip for dip in analysis.dips if dip.variable == variable]
        if dips:
            cards.append(_dip(view, max(dips, key=lambda dip: dip.depth_db)))
    if "standard_error" in view.map.dataset:
        u = float(view.map.dataset["standard_error"].max())
        cards += [Card("Largest standard uncertainty of CDP", significant(u, 2))] if u == u else []
    return cards


def _range(view: MapView, usable: UsableRange, widest: bool) -> Card:
    """Return the card of a usable range, which may be the widest of all; without any, of the whole map."""
    at, x, level = at_text(usable.at, view.map.axes), view.map.axes[usable.axis], f"CDP ≥ {usable.level:g}"
    if usable.widest is None:
        cdp = view.map.dataset["cdp"] if widest else view.map.dataset["cdp"].sel(usable.at)
        lines = (f"at {at}",) if at and not widest else ()
        highest = f"highest CDP {significant(float(cdp.max()), 3)}"
        return Card(f"Usable range, {level}", "none", highest, lines, state="bad")
    name = f"{'Widest usable' if widest or len(usable.intervals) > 1 else 'Usable'} range, {level}"
    detail = ", ".join(part for part in (axis_unit(x), width_text(usable.widest)) if part)
    return Card(name, ends_text(x, usable.widest), detail, (f"at {at}",) if at else ())


def _dip(view: MapView, dip: SnrDip) -> Card:
    axis = view.map.axes[view.analysis.x]
    value = f"to {dip.highest / dip.depth_ratio:.3g}" if dip.variable == "cdp" else f"{dip.depth_db:.1f} dB"
    at = at_text(dip.at, view.map.axes)
    lines = [f"at {at}"] if at else []
    if dip.expected == dip.expected:
        lines.append(f"hand-over at {value_text(axis, dip.expected)}")
    if dip.variable != "cdp" and dip.lowest_cdp == dip.lowest_cdp:
        lines.append(f"lowest CDP {dip.lowest_cdp:.3g}")
    name = f"Deepest dip of {VARIABLES[dip.variable].label}"
    return Card(name, value, f"at {value_text(axis, dip.position)}", tuple(lines))
