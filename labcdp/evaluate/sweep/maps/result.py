"""A map of CDP as a result: its cells, usable ranges, dips and isolines."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ....core.result import Finding, InputFile, Result, info
from ....core.table import Column, Table
from .axes import MapAxis, map_axis, map_layout, sections
from .labels import at_text, axis_name, axis_unit, plain, shown, title, variable_name, variable_unit
from .map import MapAnalysis
from .ranges import UsableInterval

if TYPE_CHECKING:
    from xarray import Dataset


#: Cells of a map beyond which tables would take minutes and gigabytes; NetCDF has them.
_MOST_CELLS = 200_000

#: Cells up to which a map is printed, too.
_PRINTED_CELLS = 30

#: Panels whose matrix has a sheet, and columns of a sheet.
_MOST_MATRICES, _MOST_COLUMNS = 12, 2**14 - 1

_END = (
    "Where CDP crosses; the last grid point before CDP changes by more than 0.2; or the end of the map, beyond which "
    "the range may continue."
)

#: Attributes of a map that have a place of their own in a result.
_KNOWN = ("title", "seed", "labcdp_version", "chain")


def result(
    dataset: Dataset, analysis: MapAnalysis, inputs: Sequence[InputFile] = (), findings: Sequence[Finding] = ()
) -> Result:
    """Return the numbers of a map.

    Parameters
    ----------
    dataset : xarray.Dataset
        The map.
    analysis : MapAnalysis
        Of the same map.
    inputs : sequence of InputFile
        The chain file and what it names.
    findings : sequence of Finding
        Findings of the sweep.
    """
    axes = {str(name): map_axis(dataset, str(name)) for name in dataset["cdp"].dims}
    found = [*findings, *_findings(dataset, analysis)]
    small = dataset["cdp"].size <= _MOST_CELLS
    tables = [
        *([ranges_table(analysis, axes)] if analysis.usable_ranges else []),
        *([_dips(dataset, analysis, axes)] if analysis.usable_ranges else []),
        *([_cells(dataset, axes), *_matrices(dataset, axes)] if small else []),
        *([_isolines(analysis, axes)] if analysis.isolines else []),
    ]
    attributes = {name: value for name, value in dataset.attrs.items() if name not in _KNOWN}
    values = {name: axis.values.tolist() for name, axis in axes.items()}
    chain = str(dataset.attrs.get("chain", ""))
    seed = dataset.attrs.get("seed")
    return Result(
        "sweep",
        title(dataset),
        tuple(tables),
        tuple(found),
        tuple(inputs),
        {**attributes, "usable_cdp": analysis.level, "axes": values, "chain_toml": chain},
        None if seed is None else int(seed),
        simulated=True,
    )


def _findings(dataset: Dataset, analysis: MapAnalysis) -> Iterator[Finding]:
    if analysis.usable_ranges and analysis.widest is None:
        yield info("map-nowhere-usable", usable_cdp=analysis.level, highest_cdp=float(dataset["cdp"].max()))
    if dataset["cdp"].size > _MOST_CELLS:
        yield info("map-in-netcdf-only", n_cells=int(dataset["cdp"].size), most=_MOST_CELLS)


def _axis_columns(axes: Mapping[str, MapAxis], *names: str) -> tuple[Column, ...]:
    return tuple(Column(name, axis_name(axes[name]), axis_unit(axes[name]), f"Value of {name}.") for name in names)


def _along(axis: MapAxis, name: str, label: str, meaning: str, show: bool = True) -> Column:
    """Return a column of places on the axis across."""
    return Column(name, label, axis_unit(axis), meaning, shown=show)


def ranges_table(analysis: MapAnalysis, axes: Mapping[str, MapAxis]) -> Table:
    """Return the usable ranges of a map, each with the kind of its ends."""
    x = axes[analysis.x]
    others = [name for name in axes if name != analysis.x]
    columns = (
        *_axis_columns(axes, *others),
        _along(x, "low", f"{axis_name(x)} from", f"Lower end of the range with a CDP of at least {analysis.level:g}."),
        _along(x, "high", "to", "Upper end of the range."),
        Column("low_end", "lower end", meaning=_END),
        Column("high_end", "upper end", meaning=_END),
        Column("decades", "decades", meaning="log10 of the ratio of the ends.", decimals=2),
        Column("range_db", "range", "dB", "20 log10 of the ratio of the ends.", decimals=1),
        *(
            _along(x, f"{end}_{side}", f"{end} end, point {side}", f"Grid point {side} the {name} end.", show=False)
            for end, name in (("low", "lower"), ("high", "upper"))
            for side in ("below", "above")
        ),
        Column("widest", "widest", meaning="Whether it is the widest range of the map.", shown=False),
    )
    rows = []
    for one in analysis.usable_ranges:
        rows += [
            {**one.at, **_interval(interval), "widest": one is analysis.widest and interval is one.widest}
            for interval in one.intervals
        ] or [{**one.at, "low_end": "nowhere", "high_end": "nowhere", "widest": False}]
    return Table.of_rows("usable_ranges", f"Usable range: CDP of at least {analysis.level:g}", columns, rows)


def _interval(interval: UsableInterval) -> dict[str, Any]:
    values: dict[str, Any] = {"decades": interval.decades, "range_db": interval.range_db}
    for name, end in zip(("low", "high"), interval.ends, strict=True):
        values |= {name: end.place, f"{name}_below": end.bracket[0], f"{name}_above": end.bracket[1]}
        text = "end of the map" if end.is_open else "CDP crosses" if end.resolved else "last grid point"
        values[f"{name}_end"] = text
    return values


def _dips(dataset: Dataset, analysis: MapAnalysis, axes: Mapping[str, MapAxis]) -> Table:
    x = axes[analysis.x]
    others = [name for name in axes if name != analysis.x]
    columns = (
        *_axis_columns(axes, *others),
        Column("variable", "dip of", meaning="Quantity that falls although the luminance rises, and then rises again."),
        _along(x, "start", "from", "Where it is highest before the fall."),
        _along(x, "position", "lowest at", "Where it is lowest."),
        _along(x, "recovery", "recovered at", "Where it is again as high as before the fall."),
        Column("highest", "value before", meaning="Value before the fall."),
        Column("depth_ratio", "ratio", meaning="Highest over lowest value.", shown=False),
        Column("depth_db", "depth", "dB", "20 log10 of the ratio of highest and lowest value.", decimals=1),
        Column("lowest_cdp", "lowest CDP", meaning="Lowest CDP until it recovers.", decimals=4),
        _along(x, "lowest_cdp_at", "lowest CDP at", "Where the CDP is lowest.", show=False),
        _along(x, "expected", "change of exposure", "Luminance of the change of exposure that explains the dip."),
    )
    names = [column.name for column in columns[len(others) + 1 :]]
    rows = [
        {**dip.at, "variable": variable_name(dataset, dip.variable), **{name: getattr(dip, name) for name in names}}
        for dip in analysis.dips
    ]
    # Of many sections only the deepest ones matter at a glance, which the page shows.
    several = len(analysis.usable_ranges) > 1
    return Table.of_rows("dips", f"Dips along the {axis_name(x)}", columns, rows, detail=several)


def _cells(dataset: Dataset, axes: Mapping[str, MapAxis]) -> Table:
    """Make the long table of all cells, the last axis fastest."""
    (_, ordered), *_ = sections(dataset, list(axes))
    names = [str(name) for name in dataset.data_vars]
    grids = np.meshgrid(*(axis.values for axis in axes.values()), indexing="ij")
    data: dict[str, Any] = {name: grid.ravel() for name, grid in zip(axes, grids, strict=True)}
    data |= {name: ordered[name].values.ravel() for name in names}
    columns = [
        Column(
            name,
            variable_name(dataset, name),
            variable_unit(dataset, name),
            _meaning(dataset, name),
            shown=not name.endswith("standard_error"),
        )
        for name in names
    ]
    long = dataset["cdp"].size > _PRINTED_CELLS
    return Table("map", "Cells of the map", (*_axis_columns(axes, *axes), *columns), data, detail=long)


def _meaning(dataset: Dataset, name: str) -> str:
    text = str(dataset[name].attrs.get("long_name", ""))
    return f"{text[:1].upper()}{text[1:]}." if text else ""


def _matrices(dataset: Dataset, axes: Mapping[str, MapAxis]) -> Iterator[Table]:
    """Yield CDP over the two axes of the picture, for each value of the others."""
    layout = map_layout(dataset)
    x, y = layout.x, layout.y
    if y is None or x.values.size > _MOST_COLUMNS:
        return
    heads = [plain(float(value), 6) for value in shown(x, x.values)]
    first = Column(y.name, f"{axis_name(y)}; across: {axis_name(x)} in {axis_unit(x) or '1'}", axis_unit(y))
    columns = [Column(f"cdp_{number}", head, decimals=4) for number, head in enumerate(heads)]
    parts = list(zip(range(_MOST_MATRICES), sections(dataset, layout.spanned), strict=False))
    for number, (at, section) in parts:
        cdp = section["cdp"].values
        data: dict[str, Any] = {
            y.name: y.values,
            **{column.name: cdp[:, place] for place, column in enumerate(columns)},
        }
        text = at_text(at, dict(axes))
        name = "cdp" if len(parts) == 1 else f"cdp_{number + 1}"
        yield Table(name, f"CDP{text and f' at {text}'}", (first, *columns), data, matrix=True, detail=True)


def _isolines(analysis: MapAnalysis, axes: Mapping[str, MapAxis]) -> Table:
    others = [name for name in axes if name not in (analysis.x, analysis.y)]
    columns = (
        *_axis_columns(axes, *others),
        Column("level", "CDP", meaning="CDP along the line."),
        Column("line", "line", meaning="Number of the line."),
        Column("closed", "closed", meaning="Whether the line ends where it begins."),
        *_axis_columns(axes, analysis.x, analysis.y),
    )
    rows = (
        {**line.at, "level": line.level, "line": number, "closed": line.closed} | {analysis.x: x, analysis.y: y}
        for number, line in enumerate(analysis.isolines, start=1)
        for x, y in zip(line.x, line.y, strict=True)
    )
    return Table.of_rows("isolines", "Isolines of CDP", columns, rows, detail=True)
