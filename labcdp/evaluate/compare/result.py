"""A comparison as labelled tables, and its answer."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import isfinite
from typing import Any

import numpy as np

from ...core.finding import Finding, info, warning
from ...core.result import Result
from ...core.table import Column, Table
from ...report.cells import cell_text
from ..sweep.maps.ranges import UsableInterval
from ..sweep.report.labels import at_text, axis_name, axis_unit, ends_text, plain
from .compare import Comparison
from .difference import Difference, Uncertain
from .grid import Grid

#: Share of values without a difference that differ significantly by chance.
_BY_CHANCE = 0.05
#: Cells beyond which tables leave them out, and settings up to which they are printed.
_MOST_CELLS, _PRINTED = 200_000, 30
#: Things up to which the answer names each difference.
_FEW = 3
#: Settings without which CDPs of maps answer different questions.
_QUESTION = ("contrast", "epsilon", "scene.contrast")
_VERDICTS = {True: "yes", False: "no", None: "unknown"}


def compare_result(found: Comparison) -> Result:
    """Return all numbers of a comparison; its first findings are the answer."""
    names = [thing.name for thing in found.things]
    tables = [*_ranges(found), *_differences(found), *_cells(found.grid, names), *_settings(found)]
    question = {} if found.question is None else {
        "contrast": found.question.contrast,
        "epsilon": found.question.epsilon,
        "set": dict(found.question.changes or {}),
        "axes": {axis.parameter: list(axis.values) for axis in found.question.axes},
    }  # fmt: skip
    return Result(
        "compare",
        " and ".join(names) if len(names) == 2 else f"{names[0]} and {len(names) - 1} others",
        tuple(tables),
        (*answer(found), *_assumptions(found)),
        tuple(one for thing in found.things for one in thing.inputs),
        {"kind": found.kind, "names": names, **question},
        simulated=any(thing.simulated for thing in found.things),
    )


def answer(found: Comparison) -> tuple[Finding, ...]:
    """Return what a comparison says in a sentence or two."""
    differences = [row.difference for row in found.rows] + list(found.grid.differences if found.grid else ())
    if all(np.all(one.value == 0) for one in differences):
        return (info("compare-equal"),)
    if found.analyses:
        return tuple(_of_maps(found))
    if found.grid is not None:
        return tuple(_of_responsivities(found, found.grid))
    significant = [row for row in found.rows if row.difference.significant]
    if not significant:
        return (info("compare-agree", n=len(found.rows)),)
    row = max(significant, key=lambda row: abs(float(row.difference.z)))
    text = cell_text(_DIFFERENCE, _difference_cells(row.difference, row.first.unit))
    finding = info(
        "compare-differ",
        row.name,
        n=len(found.rows),
        n_different=len(significant),
        by_chance=_BY_CHANCE * len(found.rows),
        quantity=row.first.quantity,
        difference=f"{text} {row.first.unit}".strip(),
        first=found.things[0].name,
        z=float(row.difference.z),
    )
    return (finding,)


def _of_responsivities(found: Comparison, grid: Grid) -> Iterator[Finding]:
    for thing, one in zip(found.things[1:], grid.differences, strict=True):
        share = float(np.mean(one.significant))
        code = "compare-responsivity-differs" if share else "compare-responsivity-agrees"
        ends = {"lowest": float(one.value.min()), "highest": float(one.value.max())}
        yield info(code, thing.name, first=found.things[0].name, share=share, **ends)


def _of_maps(found: Comparison) -> Iterator[Finding]:
    grid = found.grid
    assert grid is not None
    axis, level = grid.axes[-1], found.analyses[0].level
    named = list(zip([thing.name for thing in found.things], map(_widest, found.analyses), strict=True))
    usable = [(name, one) for name, one in named if one is not None]
    none = [f"{name} nowhere" for name, one in named if one is None]
    unit = axis_unit(axis)
    if usable and axis.is_luminance and len(grid.axes) == 1:
        (best, first), *rest = sorted(usable, key=lambda pair: pair[1].low)
        others = [f"{name} to {plain(one.low)}" for name, one in rest]
        if len(rest) == 1:
            others = [f"{others[0]} {unit}, {plain(rest[0][1].low / first.low)} times as much"]
        yield info(
            "compare-darkest", best, level=level, low=first.low, unit=unit, bound="≤ " if first.ends[0].is_open else "",
            others=[*others, *none],
        )  # fmt: skip
    elif usable:
        (best, first), *rest = sorted(usable, key=lambda pair: pair[1].width, reverse=True)
        others = [f"{name} {ends_text(axis, one)} {unit}".rstrip() for name, one in rest]
        span = f"{ends_text(axis, first)} {unit}".rstrip()
        yield info("compare-ranges", best, axis=axis_name(axis), level=level, range=span, others=[*others, *none])
    if len(found.things) > _FEW:
        return
    for thing, one in zip(found.things[1:], grid.differences, strict=True):
        below, above = (max(float(np.nanmax(sign * one.value)), 0.0) for sign in (-1, 1))
        yield info("compare-maps-differ", thing.name, first=found.things[0].name, below=below, above=above)
        if np.isfinite(one.z).any() and np.any(one.low < one.high):
            share = float(np.mean(one.significant))
            yield info("compare-maps-significant", thing.name, first=found.things[0].name, share=share)


def _widest(analysis: Any) -> UsableInterval | None:
    return None if analysis.widest is None else analysis.widest.widest


def _assumptions(found: Comparison) -> Iterator[Finding]:
    if found.analyses and found.grid is not None:
        settings = {name: texts for name, texts in found.settings.items() if name in _QUESTION}
        if settings and found.question is not None and found.question.contrast is not None:
            settings.pop("scene.contrast", None)
        if settings:
            yield warning("compare-question-differs", files=[one.name for one in found.things], names=list(settings))
        if not any(np.any(one.below) for one in found.grid.values):
            yield info("compare-exact")
        if found.question is not None:
            yield info("compare-on-axis")
    else:
        common = sorted({f"the same {name.split()[0]}" for row in found.rows for name in row.first.value.common
                         if name in row.other.value.common})  # fmt: skip
        if common:
            yield info("compare-common", sources=common)
        yield info("compare-independent")
    if found.unmatched:
        yield info("compare-unmatched", quantities=list(found.unmatched))


_DIFFERENCE = Column(
    "difference",
    "difference",
    meaning="Value minus that of the first, with the 95 % interval.",
    expanded="expanded_difference",
    low="difference_low",
    high="difference_high",
    unit_of="unit",
)
_ROW_COLUMNS = (
    Column("quantity", "quantity"),
    Column("name", "of", meaning="What is compared with the first."),
    *(
        column
        for name, label, meaning in (
            ("first", "first", "Value of the first."),
            ("value", "value", "Its value."),
        )
        for column in (
            Column(
                name, label, "", meaning, expanded=f"expanded_{name}", low=f"{name}_low", high=f"{name}_high",
                unit_of="unit",
            ),
            Column(f"expanded_{name}", f"U of {label}", "", "U (95 %), if the interval is symmetric.", shown=False),
            Column(f"{name}_low", f"{label}, low", "", "Lower end of the 95 % interval.", shown=False),
            Column(f"{name}_high", f"{label}, high", "", "Upper end of the 95 % interval.", shown=False),
        )
    ),
    _DIFFERENCE,
    Column("expanded_difference", "U of difference", "", "U (95 %), if the interval is symmetric.", shown=False),
    Column("difference_low", "difference, low", "", "Lower end of the 95 % interval.", shown=False),
    Column("difference_high", "difference, high", "", "Upper end of the 95 % interval.", shown=False),
    Column("unit", "unit", "", "Unit of values and difference."),
    Column("z", "z", "", "Difference over its standard uncertainty on the side of 0.", decimals=1),
    Column("differs", "differs", "", "Whether 0 lies outside the 95 % interval of the difference."),
)  # fmt: skip


def _differences(found: Comparison) -> Iterator[Table]:
    if not found.rows:
        return
    rows = [
        {
            "quantity": row.first.quantity,
            "name": row.name,
            **_value_cells("first", row.first.value),
            **_value_cells("value", row.other.value),
            **_difference_cells(row.difference, row.first.unit),
            "z": float(row.difference.z),
            "differs": _VERDICTS[None if np.isnan(row.difference.z) else bool(row.difference.significant)],
        }
        for row in found.rows
    ]
    first = found.things[0].name
    labels = {"first": first, "value": found.things[1].name if len(found.things) == 2 else "value"}
    columns = [_relabelled(column, labels, len(found.things) > 2) for column in _ROW_COLUMNS]
    yield Table.of_rows("differences", f"Values and their difference from {first}", columns, rows)


def _relabelled(column: Column, labels: dict[str, str], several: bool) -> Column:
    shown = column.shown and (several or column.name != "name")
    return replace(column, label=labels.get(column.name, column.label), shown=shown)


def _value_cells(name: str, value: Uncertain) -> dict[str, Any]:
    middle, below, above = float(value.value), float(value.below), float(value.above)  # type: ignore[arg-type]
    return _cells_of(name, middle, middle - below, middle + above)


def _difference_cells(one: Difference, unit: str) -> dict[str, Any]:
    return {**_cells_of("difference", float(one.value), float(one.low), float(one.high)), "unit": unit}


def _cells_of(name: str, value: float, low: float, high: float) -> dict[str, Any]:
    symmetric = abs((high - value) - (value - low)) <= 1e-6 * (high - low)
    expanded = (high - low) / 2 if symmetric and high > low else None
    known = isfinite(low) and isfinite(high) and high > low
    ends = (low, high) if known else (None, None)
    return {name: value, f"expanded_{name}": expanded, f"{name}_low": ends[0], f"{name}_high": ends[1]}


def _ranges(found: Comparison) -> Iterator[Table]:
    """Yield the usable ranges of maps, each end with whether it is known."""
    if not found.analyses or found.grid is None or not any(one.usable_ranges for one in found.analyses):
        return
    x, level = found.grid.axes[-1], found.analyses[0].level
    axes, unit = {axis.name: axis for axis in found.grid.axes}, axis_unit(found.grid.axes[-1])
    several = any(axis.values.size > 1 for axis in found.grid.axes[:-1])
    columns = (
        Column("name", "of"),
        Column("at", "at", "", "Values of the other axes.", shown=several),
        Column("range", f"{axis_name(x)}, CDP ≥ {level:g}", unit, "Range as text; ≤ and ≥ where it may continue."),
        Column("low", "from", unit, f"Lower end of the range with a CDP of at least {level:g}.", shown=False),
        Column("high", "to", unit, "Upper end of the range.", shown=False),
        Column("decades", "decades", "", "log10 of the ratio of the ends.", decimals=2),
    )
    rows = [
        {
            "name": thing.name,
            "at": at_text(one.at, axes),
            "range": "nowhere" if interval is None else ends_text(x, interval),
            **({} if interval is None else {name: getattr(interval, name) for name in ("low", "high", "decades")}),
        }
        for thing, analysis in zip(found.things, found.analyses, strict=True)
        for one in analysis.usable_ranges
        for interval in (one.intervals or (None,))
    ]
    yield Table.of_rows("usable_ranges", f"Usable range: CDP of at least {level:g}", columns, rows)


def _cells(grid: Grid | None, names: list[str]) -> Iterator[Table]:
    """Yield all values of a grid in a long table."""
    if grid is None or np.size(grid.values[0].value) > _MOST_CELLS:
        return
    places = np.meshgrid(*(axis.values for axis in grid.axes), indexing="ij")
    columns = [Column(axis.name, axis_name(axis), axis_unit(axis)) for axis in grid.axes]
    data: dict[str, Any] = {axis.name: place.ravel() for axis, place in zip(grid.axes, places, strict=True)}
    for number, (name, one) in enumerate(zip(names, grid.values, strict=True), start=1):
        columns.append(Column(f"value_{number}", f"{grid.quantity} of {name}"))
        data[f"value_{number}"] = np.ravel(one.value)
    unit = "%" if grid.relative else ""
    for number, (name, of) in enumerate(zip(names[1:], grid.differences, strict=True), start=2):
        for key, label, values in (
            (f"difference_{number}", f"difference of {name}", of.value),
            (f"difference_{number}_low", f"difference of {name}, low", of.low),
            (f"difference_{number}_high", f"difference of {name}, high", of.high),
        ):
            columns.append(
                Column(key, label, unit, f"From {names[0]}; low and high are the ends of the 95 % interval.")
            )
            data[key] = np.ravel(values)
    yield Table("curves", f"{grid.quantity} at all places", tuple(columns), data, detail=True)


def _settings(found: Comparison) -> Iterator[Table]:
    settings = found.settings
    if not settings:
        return
    names = [thing.name for thing in found.things]
    columns = [Column("setting", "setting"), *(Column(f"value_{n}", name) for n, name in enumerate(names, start=1))]
    rows = [
        {"setting": name, **{f"value_{n}": text for n, text in enumerate(texts, start=1)}}
        for name, texts in settings.items()
    ]
    long = len(rows) * len(names) > _PRINTED
    yield Table.of_rows("settings", "Settings that differ", columns, rows, detail=long)
