"""A comparison as labelled tables, and its answer."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from math import isfinite
from operator import attrgetter

import numpy as np

from ...core.result import Finding, Result, info, warning
from ...core.table import Column, Table
from ...files.doubts import BLACK_LEVEL, ENCODING, MOSAIC
from ...metrics.contrast import each_contrast
from ...report.text import cell_text
from ..sweep.maps.axes import TO_DETECT, MapAxis
from ..sweep.maps.labels import at_text, axis_name, axis_unit, ends_text, plain
from ..sweep.maps.map import MapAnalysis
from ..sweep.maps.ranges import End
from ..sweep.maps.result import dips_table, ranges_table
from .compare import Compared, ComparisonEvaluation
from .grid import Grid
from .requirement import requirement_table
from .subject import Subject

#: Share of values without a difference that differ significantly by chance.
_BY_CHANCE = 0.05
#: Cells beyond which tables leave them out, and settings up to which they are printed.
_MOST_CELLS, _PRINTED = 200_000, 30
#: Things up to which the answer names each difference.
_FEW = 3
#: Settings without which CDPs of maps answer different questions.
_QUESTION = ("contrast", "epsilon", "scene.contrast")
#: Digits of ends of usable ranges that are refined, and of those interpolated between grid points.
_REFINED, _INTERPOLATED = 3, 2
#: Relative distance of the points around an end beyond which the one that is high enough is a bound only.
_KNOWN = 0.01
#: Difference of the halves of a symmetric interval by rounding, relative to its width.
_ASYMMETRY = 1e-6


def compare_result(comparison: ComparisonEvaluation) -> Result:
    """Return all numbers of a comparison; its first findings are the answer."""
    names = [subject.name for subject in comparison.subjects]
    required = None if comparison.question is None else comparison.question.requirement
    verdicts = [] if required is None else [requirement_table(comparison.judged, required)]
    tables = [
        *verdicts,
        *_of_maps(comparison),
        *_differences(comparison),
        *_cells(comparison.grid, names),
        *_settings(comparison),
    ]
    question = {} if comparison.question is None else comparison.question.configuration
    return Result(
        "compare",
        " and ".join(names) if len(names) <= 2 else f"{names[0]} and {len(names) - 1} others",
        tuple(tables),
        (*answer(comparison), *_assumptions(comparison)),
        tuple(file for subject in comparison.subjects for file in subject.inputs),
        {"kind": comparison.kind, "names": names, **question},
        simulated=any(subject.simulated for subject in comparison.subjects),
    )


def answer(comparison: ComparisonEvaluation) -> tuple[Finding, ...]:
    """Return what a comparison says in a sentence or two."""
    differences = [row.difference for row in comparison.rows] + list(
        comparison.grid.differences if comparison.grid else ()
    )
    if len(comparison.subjects) > 1 and all(np.all(difference.value == 0) for difference in differences):
        return (info("compare-equal"),)
    if comparison.analyses:
        return tuple(_map_findings(comparison))
    if comparison.grid is not None:
        return tuple(_responsivity_findings(comparison, comparison.grid))
    significant = [row for row in comparison.rows if row.difference.significant]
    if not significant:
        return (info("compare-agree", n=len(comparison.rows)),)
    row = max(significant, key=lambda row: abs(float(row.difference.z)))
    values = {
        "n": len(comparison.rows),
        "n_different": len(significant),
        "by_chance": _BY_CHANCE * len(comparison.rows),
    }
    of = {"quantity": row.first.quantity, "difference": difference_text(row), "first": comparison.subjects[0].name}
    return (info("compare-differ", row.name, **values, **of, z=float(row.difference.z)),)


def _responsivity_findings(comparison: ComparisonEvaluation, grid: Grid) -> Iterator[Finding]:
    for subject, difference in zip(comparison.subjects[1:], grid.differences, strict=True):
        share = float(np.mean(difference.significant))
        code = "compare-responsivity-differs" if share else "compare-responsivity-agrees"
        ends = [float(difference.value.min()), float(difference.value.max())]
        yield info(code, subject.name, first=comparison.subjects[0].name, share=share, ends=ends)


def _map_findings(comparison: ComparisonEvaluation) -> Iterator[Finding]:
    grid = comparison.grid
    assert grid is not None
    axis, analyses = grid.axes[-1], comparison.analyses
    if any(analysis.widest for analysis in analyses):
        others = {axis.name for axis in grid.axes[:-1]}
        dark = axis.is_luminance and others <= {TO_DETECT}
        refined = comparison.question is not None and dark
        values = {"level": analyses[0].level, "how": "" if refined else " (interpolated)"}
        if dark and len(analyses[0].usable_ranges) <= _FEW:
            named = {axis.name: axis for axis in grid.axes}
            for range_index, usable in enumerate(analyses[0].usable_ranges):
                texts = list(_lows(comparison, axis, range_index, _REFINED if refined else _INTERPOLATED))
                yield info("compare-darkest", at_text(usable.at, named), lows=texts, **values)
        else:
            yield info("compare-ranges", axis=axis_name(axis), ranges=list(_spans(comparison, axis)), **values)
    if len(comparison.subjects) > _FEW:
        return
    for subject, difference in zip(comparison.subjects[1:], grid.differences, strict=True):
        below, above = (max(0.0, float(np.nanmax(sign * difference.value))) for sign in (-1, 1))
        yield info("compare-maps-differ", subject.name, first=comparison.subjects[0].name, below=below, above=above)
        if np.isfinite(difference.z).any() and np.any(difference.low < difference.high):
            share = float(np.mean(difference.significant))
            yield info("compare-maps-significant", subject.name, first=comparison.subjects[0].name, share=share)


def _lows(comparison: ComparisonEvaluation, axis: MapAxis, range_index: int, n_digits: int) -> Iterator[str]:
    """Yield the lowest usable luminance of each, the darkest first; for two also the ratio if both are known."""
    all_intervals = [
        (subject.name, analysis.usable_ranges[range_index].intervals) for subject, analysis in _pairs(comparison)
    ]
    usable = sorted(
        ((name, intervals) for name, intervals in all_intervals if intervals), key=lambda pair: pair[1][0].low
    )
    unit, ends = f" {axis_unit(axis)}", [intervals[0].ends[0] for _, intervals in usable]
    for number, (name, intervals) in enumerate(usable):
        gaps = [f"{plain(a.high, n_digits)} to {plain(b.low, n_digits)}" for a, b in pairwise(intervals)]
        ratio = plain(ends[number].place / ends[0].place, n_digits) if number and len(usable) == 2 else "1"
        yield "".join((
            "down to " if number else "",
            f"≤ {plain(ends[number].place)}" if _bound(ends[number]) else plain(ends[number].place, n_digits),
            f"{unit} for {name}",
            f" (except {', '.join(gaps)})" if gaps else "",
            f", which needs {ratio} times the light" if ratio != "1" and not any(map(_bound, ends)) else "",
        ))  # fmt: skip
    yield from (f"nowhere for {name}" for name, intervals in all_intervals if not intervals)


def _spans(comparison: ComparisonEvaluation, axis: MapAxis) -> Iterator[str]:
    """Yield the widest range of each, the widest first."""
    widest = [(subject.name, analysis.widest and analysis.widest.widest) for subject, analysis in _pairs(comparison)]
    usable = sorted(((name, width) for name, width in widest if width), key=lambda pair: pair[1].width, reverse=True)
    for name, interval in usable:
        yield f"{ends_text(axis, interval, _INTERPOLATED)} {axis_unit(axis)}".rstrip() + f" for {name}"
    yield from (f"none for {name}" for name, width in widest if not width)


def _pairs(comparison: ComparisonEvaluation) -> Iterator[tuple[Subject, MapAnalysis]]:
    return zip(comparison.subjects, comparison.analyses, strict=True)


def _bound(end: End) -> bool:
    """Whether a lower end may lie well below the stated value: the map ends there, or its steps are too wide."""
    below, above = end.bracket
    return end.is_open or not (end.resolved or above - below < _KNOWN * above)


def _assumptions(comparison: ComparisonEvaluation) -> Iterator[Finding]:
    if comparison.analyses and comparison.grid is not None:
        differing = [name for name in comparison.settings if name in _QUESTION]
        if differing:
            yield warning("compare-question-differs", names=differing)
        if not any(np.any(value.below) for value in comparison.grid.values):
            yield info("compare-exact")
        if comparison.question is not None:
            yield info("compare-on-axis")
            yield from _scene_of_another_contrast(comparison)
    else:
        shared = [row.first.common.keys() & row.other.common.keys() for row in comparison.rows]
        common = sorted({f"the same {kind}" for sources in shared for kind, _ in sources})
        if common:
            yield info("compare-common", sources=common)
        yield info("compare-independent")
    for subject in comparison.subjects:
        if subject.kind == "picture":
            yield from _doubts(subject)
    if comparison.unmatched:
        yield info("compare-unmatched", quantities=list(comparison.unmatched))


def _doubts(picture: Subject) -> Iterator[Finding]:
    """Name encodings and black levels of pictures that were assumed and matter for contrasts."""
    for finding in picture.content["findings"]:
        # Of results of several pictures, each says which ones it is about.
        files = finding["values"].get("files", [picture.name])
        if finding["code"].startswith((ENCODING, BLACK_LEVEL, MOSAIC)) and any(
            str(file).endswith(picture.name) for file in files
        ):
            values = {**finding["values"], "files": [picture.name]}
            yield Finding(finding["code"], finding["severity"], finding["subject"], values)


def _scene_of_another_contrast(comparison: ComparisonEvaluation) -> Iterator[Finding]:
    """Name scenes without the contrast to detect: CDP is high where a camera measures their contrast wrongly."""
    question = comparison.question
    if question is None or any(a.parameter == "scene.contrast" for a in question.axes):
        return
    for subject in comparison.subjects:
        scene_contrast = subject.settings["scene"].get("contrast")
        targets = [contrast for contrast in each_contrast(question.contrast) if contrast and scene_contrast is not None]
        others = [target for target in targets if abs(scene_contrast / target - 1) > question.epsilon]
        if others:
            yield warning(
                "compare-scene-contrast", subject.name, own=scene_contrast, asked=others if targets[1:] else others[0]
            )


def _interval(name: str, label: str, meaning: str, of: str) -> tuple[Column, ...]:
    """Return columns that show ``value ± U``, or ``value (low to high)`` where the interval is not symmetric."""
    taken = attrgetter(f"{of}.ends")

    def ends(row: Compared) -> tuple[float | None, float | None, float | None]:
        value, low, high = map(float, taken(row))
        if not (isfinite(high - low) and high > low):
            return None, None, None
        symmetric = abs((high - value) - (value - low)) <= _ASYMMETRY * (high - low)
        return (high - low) / 2 if symmetric else None, low, high

    names = (f"expanded_{name}", f"{name}_low", f"{name}_high")
    shown = Column(name, label, "", meaning, expanded=names[0], low=names[1], high=names[2], unit_of="unit")
    return (
        replace(shown, value=lambda row: float(taken(row)[0])),
        Column(names[0], f"{label}, U (95 %) if symmetric", shown=False, value=lambda row: ends(row)[0]),
        Column(names[1], f"{label}, lower end of 95 %", shown=False, value=lambda row: ends(row)[1]),
        Column(names[2], f"{label}, upper end of 95 %", shown=False, value=lambda row: ends(row)[2]),
    )


def difference_text(row: Compared) -> str:
    """Return a difference with its interval and unit."""
    columns = (*_interval("difference", "", "", "difference"), Column("unit", "unit", value="first.unit"))
    table = Table.of_items("", "", columns, [row])
    return f"{cell_text(table.columns[0], next(table.rows()))} {row.first.unit}".strip()


def _differs(row: Compared) -> str:
    return "unknown" if np.isnan(row.difference.z) else "yes" if row.difference.significant else "no"


def _differences(comparison: ComparisonEvaluation) -> Iterator[Table]:
    if not comparison.rows:
        return
    first, *others = (subject.name for subject in comparison.subjects)
    several = len(others) > 1
    columns = (
        Column("quantity", "quantity", value="first.quantity"),
        Column("name", "of", meaning="Which one is compared with the first.", shown=several),
        *_interval("first", first, "Value of the first.", "first"),
        *_interval("value", "value" if several else others[0], "Value of the other.", "other"),
        *_interval("difference", "difference", "Value of the other minus that of the first.", "difference"),
        Column("unit", "unit", "", "Unit of values and difference.", value="first.unit"),
        Column("z", "z", "", "Difference divided by its standard uncertainty on the side of 0.", decimals=1,
               value=lambda row: float(row.difference.z)),
        Column("differs", "differs", "", "Whether 0 lies outside the 95 % interval of the difference.", value=_differs),
    )  # fmt: skip
    yield Table.of_items("differences", f"Values and their difference from {first}", columns, comparison.rows)


def _of_maps(comparison: ComparisonEvaluation) -> Iterator[Table]:
    """Yield the usable ranges of all maps in one table, and their dips in another."""
    if comparison.grid is None:
        return
    axes = {axis.name: axis for axis in comparison.grid.axes}
    for make, of in ((ranges_table, "usable_ranges"), (dips_table, "dips")):
        if not any(getattr(analysis, of) for analysis in comparison.analyses):
            continue
        tables = [make(analysis, axes) for analysis in comparison.analyses]
        rows = [
            {"name": subject.name, **row}
            for subject, table in zip(comparison.subjects, tables, strict=True)
            for row in table.rows()
        ]
        yield Table.of_items(tables[0].name, tables[0].title, (Column("name", "of"), *tables[0].columns), rows)


def _cells(grid: Grid | None, names: list[str]) -> Iterator[Table]:
    """Yield all values of a grid in a long table."""
    if grid is None or np.size(grid.values[0].value) > _MOST_CELLS:
        return
    places = np.meshgrid(*(axis.values for axis in grid.axes), indexing="ij")
    columns = [
        (Column(axis.name, axis_name(axis), axis_unit(axis)), at) for axis, at in zip(grid.axes, places, strict=True)
    ]
    for number, (name, value) in enumerate(zip(names, grid.values, strict=True), start=1):
        columns.append((Column(f"value_{number}", f"{grid.quantity} of {name}"), np.asarray(value.value)))
    unit, note = "%" if grid.relative else "", f"From {names[0]}; low and high are the ends of the 95 % interval."
    for number, (name, of) in enumerate(zip(names[1:], grid.differences, strict=True), start=2):
        for end, values in zip(("", "_low", "_high"), of.ends, strict=True):
            columns.append((Column(f"difference_{number}{end}", f"difference{end} of {name}", unit, note), values))
    data = {column.name: values.ravel() for column, values in columns}
    yield Table("curves", f"{grid.quantity} at all places", tuple(column for column, _ in columns), data, detail=True)


def _settings(comparison: ComparisonEvaluation) -> Iterator[Table]:
    rows = [(name, *texts) for name, texts in comparison.settings.items()]
    if rows:
        subjects = [
            Column(f"value_{number}", subject.name, value=f"{number}")
            for number, subject in enumerate(comparison.subjects, start=1)
        ]
        columns = (Column("setting", "setting", value="0"), *subjects)
        long = len(rows) * len(subjects) > _PRINTED
        yield Table.of_items("settings", "Settings that differ", columns, rows, detail=long)
