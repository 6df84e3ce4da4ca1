"""The files of a comparison: page, spreadsheet, numbers and figure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.result import Result
from ...report.drawing import SMALL_SIZE, finish, label, new_figure, reported
from ...report.files import result_files
from ...report.layout import Block, Card, Page, ReportFigure, Section, State, facts_table, input_facts
from ...report.text import capitalised, finding_text, printable
from ..judgement import STATES
from ..sweep.maps.axes import MapAxis
from ..sweep.maps.labels import at_text, axis_label, axis_unit, ends_text, shown
from ..sweep.maps.map import MapAnalysis
from ..sweep.maps.view import COLOURS, SCALE, heat_map, set_scale
from .compare import ComparisonEvaluation
from .grid import Grid
from .result import answer

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Place of a legend beside a panel.
_OUTSIDE: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.02), "frameon": False}
#: Most rows of values, and columns of maps, in a figure.
_MOST_ROWS, _MOST_COLUMNS = 30, 3


#: Most rows of a table beside the figure, and most cards.
_BRIEF, _MOST_CARDS = 10, 4
_METHOD = (
    "Each is compared with the first. The 95 % interval of a difference ends √(a² + b² - 2 r a b) from it, where a "
    "and b are the distances to the ends of the two intervals and r is the correlation due to their common errors "
    "(JCGM 100:2008, "
    "5.2.2; for probabilities Newcombe 1998, method 10). A difference is significant if the interval does not contain "
    "0, which happens by chance in 1 of 20."
)


def _figures(comparison: ComparisonEvaluation) -> list[ReportFigure]:
    """Draw a comparison, unless its axis has no numbers."""
    grid, names = comparison.grid, [printable(subject.name) for subject in comparison.subjects]
    if grid is not None and not grid.axes[-1].numeric:
        return []
    simulated = "data" if any(subject.simulated for subject in comparison.subjects) else ""
    if grid is None:
        figure = _values(comparison, names, simulated)
    else:
        figure = _maps(grid, names, simulated) if grid.spanned == 2 else _curves(grid, names, comparison, simulated)
    first = comparison.subjects[0].name
    alone = len(names) == 1
    caption = (
        f"CDP{'' if alone else f', and its difference from {first}'}. Dotted: the limit."
        if comparison.analyses
        else "Bars and bands are 95 % intervals."
    )
    return [
        reported(
            "comparison", figure, caption, f"CDP of {names[0]}." if alone else f"Comparison of {', '.join(names)}."
        )
    ]


def _values(comparison: ComparisonEvaluation, names: Sequence[str], simulated: str) -> Figure:
    """Draw CDPs with their intervals, or z of all differences where there is no CDP."""
    quantities = list(dict.fromkeys(row.first.quantity for row in comparison.rows))[:_MOST_ROWS]
    probabilities = {row.first.quantity for row in comparison.rows if row.first.probability}
    cdps = [name for name in quantities if name in probabilities]
    drawn = cdps or quantities
    figure = new_figure(7.5, 1.0 + (0.34 if len(drawn) < 12 else 0.2) * len(drawn), simulated)
    axes = figure.add_subplot()
    step = 0.5 / len(names)
    for number, (name, subject) in enumerate(zip(names, comparison.subjects, strict=True)):
        rows = [
            row for row in comparison.rows if row.first.quantity in drawn and (number == 0 or row.name == subject.name)
        ]
        if not rows or (number == 0 and not cdps):
            continue
        places = [drawn.index(row.first.quantity) + step * (number - (len(names) - 1) / 2) for row in rows]
        values_shown = [row.other if number else row.first for row in rows]
        style: dict[str, Any] = {"fmt": "o", "markersize": 4, "capsize": 3, "color": COLOURS[number % len(COLOURS)]}
        if cdps:
            style["xerr"] = np.nan_to_num(
                [[uncertain.below for uncertain in values_shown], [uncertain.above for uncertain in values_shown]]
            )
        values = [uncertain.value for uncertain in values_shown] if cdps else [row.difference.z for row in rows]
        axes.errorbar(np.array(values, dtype=float), places, label=name, **style)
    axes.set_yticks(range(len(drawn)), [printable(name) for name in drawn], parse_math=False)
    axes.set_ylim(len(drawn) - 0.5, -0.5)
    # Values close to 1 have many digits.
    axes.locator_params(axis="x", nbins=4)
    if not cdps:
        axes.axvspan(-1.96, 1.96, color="0.88", linewidth=0, zorder=0, label="not significant")
    text = "CDP with 95 % interval" if cdps else f"z: difference from {names[0]} divided by its standard uncertainty"
    finish(axes, text, "", "", **_OUTSIDE)
    return figure


def _curves(grid: Grid, names: Sequence[str], comparison: ComparisonEvaluation, simulated: str) -> Figure:
    """Draw overlaid curves, and below them the differences from the first with their intervals."""
    axis, sections = grid.axes[-1], _sections(grid)
    several = len(sections) > 1
    alone = len(names) == 1
    figure = new_figure(7.5, 3.4 if grid.relative or alone else 5.0, simulated)
    panels = figure.subplots(1 if grid.relative or alone else 2, 1, sharex=True, squeeze=False)[:, 0]
    for number, name in enumerate(names):
        for number_of_section, (at, index) in enumerate(sections):
            colour = COLOURS[(number_of_section if several else number) % len(COLOURS)]
            style: dict[str, Any] = {"color": colour, "linestyle": ("-", "--", ":", "-.")[number % 4 if several else 0]}
            text = f"{name}, {at}" if several else name
            if not grid.relative:
                _draw(panels[0], axis, [end[index] for end in grid.values[number].ends], text, style)
            if number:
                factor = 100 if grid.relative else 1
                _draw(panels[-1], axis, [factor * end[index] for end in grid.differences[number - 1].ends], text, style)
    if not alone:
        panels[-1].axhline(0.0, color="0.4", linewidth=1)
    set_scale(axis, panels[-1].xaxis)
    if grid.relative:
        finish(panels[0], axis_label(axis), f"{grid.quantity} from that\nof {names[0]} in %", "", **_OUTSIDE)
    else:
        panels[0].axhline(comparison.analyses[0].level, color="0.4", linewidth=1, linestyle=":")
        panels[0].set_ylim(-0.03, 1.05)
        finish(panels[0], axis_label(axis) if alone else "", grid.quantity, "", **_OUTSIDE)
    if not (grid.relative or alone):
        label(panels[1], axis_label(axis), f"difference of {grid.quantity}\nfrom {names[0]}", "")
        panels[1].grid(color="0.9")
    figure.align_ylabels()
    return figure


def _draw(panel: Axes, axis: MapAxis, ends: Sequence[NDArray[Any]], text: str, style: dict[str, Any]) -> None:
    places, (value, low, high) = shown(axis, axis.values), ends
    panel.plot(places, value, label=text, **style)
    if np.any(low < high):
        panel.fill_between(places, low, high, color=style["color"], alpha=0.2, linewidth=0)


def _sections(grid: Grid) -> list[tuple[str, tuple[int, ...]]]:
    """Name and place of the curves of each subject, at the values of the other axes; as many as there are colours."""
    axes = {axis.name: axis for axis in grid.axes}
    sections = [
        (at_text({a.name: a.values[i].item() for a, i in zip(grid.axes[:-1], index, strict=True)}, axes), index)
        for index in np.ndindex(*(axis.values.size for axis in grid.axes[:-1]))
    ]
    return sections[: len(COLOURS)]


def _maps(grid: Grid, names: Sequence[str], simulated: str) -> Figure:
    """Draw the map of each subject, then the differences from the first; of further axes at their first values."""
    *_, y, x = grid.axes
    index = tuple(0 for _ in grid.axes[:-2])
    at = at_text({axis.name: axis.values[0].item() for axis in grid.axes[:-2]}, {axis.name: axis for axis in grid.axes})
    limit = (
        max(float(np.nanmax(np.abs(difference.value[index]), initial=0.0)) for difference in grid.differences) or 1.0
    )
    maps: list[tuple[str, Any, dict[str, Any]]] = [
        (name, np.asarray(value.value)[index], {"cmap": SCALE, "vmin": 0, "vmax": 1})
        for name, value in zip(names, grid.values, strict=True)
    ]
    maps += [
        (f"{name} minus {names[0]}", difference.value[index], {"cmap": "RdBu", "vmin": -limit, "vmax": limit})
        for name, difference in zip(names[1:], grid.differences, strict=True)
    ]
    columns = min(len(maps), _MOST_COLUMNS)
    rows = ceil(len(maps) / columns)
    figure = new_figure(1.0 + 3.7 * columns, 0.5 + 3.0 * rows, simulated)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for number, (panel, (name, values, how)) in enumerate(zip(panels, maps, strict=False)):
        mesh = heat_map(panel, x, y, values, **how)
        label(panel, axis_label(x), "" if number % columns else axis_label(y), f"{name}\n{at}".rstrip())
        figure.colorbar(mesh, ax=panel).ax.tick_params(labelsize=SMALL_SIZE)
    for empty in panels[len(maps) :]:
        empty.set_visible(False)
    return figure


def comparison_files(comparison: ComparisonEvaluation, result: Result) -> dict[str, bytes]:
    """Return the files of a comparison as `result_files` does."""
    answers, tables = answer(comparison), {table.name: table for table in result.tables}
    axes = [axis.name for axis in comparison.grid.axes] if comparison.grid else []
    kept = ("quantity", "name", "difference", "unit", "z", "differs", "low", "low_end", "high", "high_end", *axes)
    brief = [tables[name].showing(*kept) for name in ("usable_ranges", "differences") if name in tables]
    # Beside a table, several maps would be too small to read.
    wide = comparison.grid is not None and comparison.grid.spanned == 2
    beside = [table for table in brief if len(table) <= _BRIEF and not wide]
    lead: list[Block] = [*_figures(comparison), *beside]
    titles = {} if beside else {"usable_ranges": "Usable ranges"}
    titles |= {
        "requirement": "Requirement",
        "dips": "Dips",
        "differences": "Values",
        "settings": "Settings that differ",
        "curves": "All places",
    }
    sections = [
        Section(title, (tables[name],), name == "curves" or (name == "differences" and len(tables[name]) <= _BRIEF))
        for name, title in titles.items()
        if name in tables
    ]
    method = (_METHOD,) if len(comparison.subjects) > 1 else ()
    sections.append(Section("Method and inputs", (*method, facts_table(input_facts(result))), collapsed=True))
    summary = " ".join(f"{capitalised(finding_text(finding))}." for finding in answers)
    alone = len(comparison.subjects) == 1
    kind = f"{capitalised(comparison.kind)} and a requirement" if alone else f"Comparison of {comparison.kind}s"
    page = Page.of(result, kind, summary, _cards(comparison), lead, sections)
    page = replace(page, findings=[finding for finding in result.findings if finding not in answers])
    return result_files(result, page)


def _cards(comparison: ComparisonEvaluation) -> Iterator[Card]:
    """Yield the verdict on or usable range of each map, or how many values differ and which one most."""
    if comparison.judged:
        for judgement in comparison.judged[:_MOST_CARDS]:
            detail = f"CDP {judgement.cdp:.3f} ± {judgement.expanded_cdp:.3f} at {judgement.luminance_cd_m2:.3g} cd/m²"
            detail += f", limited by {judgement.limit}"
            yield Card(judgement.name, judgement.verdict, detail, state=STATES[judgement.verdict])
        return
    if comparison.grid is not None and comparison.analyses:
        if len(comparison.subjects) > _MOST_CARDS:
            return
        axis = comparison.grid.axes[-1]
        for subject, analysis in zip(comparison.subjects, comparison.analyses, strict=True):
            widest = analysis.widest
            if widest is None or widest.widest is None:
                yield Card(subject.name, "none", f"CDP nowhere ≥ {analysis.level:g}", state="bad")
                continue
            detail = f"{axis_unit(axis)}, {{}}range with CDP ≥ {analysis.level:g}"
            if len(analysis.usable_ranges) > 1:
                yield Card(
                    subject.name,
                    ends_text(axis, widest.widest),
                    detail.format("widest "),
                    _range_texts(comparison.grid, analysis),
                )
                continue
            lowest, highest = widest.intervals[0], widest.intervals[-1]
            gap = "" if lowest is highest else ", with gaps" if len(widest.intervals) > 2 else ", with a gap"
            whole = replace(lowest, ends=(lowest.ends[0], highest.ends[1]))
            yield Card(subject.name, ends_text(axis, whole), detail.format("") + gap)
        return
    for subject in comparison.subjects[1 : _MOST_CARDS + 1]:
        rows = [row for row in comparison.rows if row.name == subject.name]
        n = sum(bool(row.difference.significant) for row in rows)
        state: State = "bad" if n else "good"
        verdict, detail = "differs" if n else "", f"values differ significantly from {comparison.subjects[0].name}"
        yield Card(subject.name, f"{n} of {len(rows)}", detail, verdict=verdict, state=state)
    known = [row for row in comparison.rows if np.isfinite(row.difference.z)]
    most = max(known, key=lambda row: abs(float(row.difference.z)), default=None)
    if most is not None and most.difference.z:
        yield Card("Most significant", f"z = {float(most.difference.z):.1f}", most.first.quantity, (most.name,))


def _range_texts(grid: Grid, analysis: MapAnalysis) -> tuple[str, ...]:
    """Return the usable range at each of a few values of the other parameters, as text."""
    ranges, axes = analysis.usable_ranges, {axis.name: axis for axis in grid.axes}
    texts = (ends_text(grid.axes[-1], usable.widest) if usable.widest else "none" for usable in ranges)
    return tuple(
        f"{at_text(usable.at, axes)}: {text}"
        for usable, text in zip(ranges, texts, strict=True)
        if len(ranges) <= _MOST_CARDS
    )
