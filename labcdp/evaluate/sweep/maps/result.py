"""A map of CDP as a result: its cells, usable ranges, dips and isolines."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ....core.result import Finding, InputFile, Result, info
from ....core.table import Column, Table
from .axes import VARIABLES, At, CdpMap, MapAxis
from .labels import at_text, axis_name, axis_unit, plain, shown, title, variable_column
from .map import MapAnalysis
from .ranges import UsableInterval, UsableRange

if TYPE_CHECKING:
    from xarray import Dataset


#: Cells of a map beyond which tables would take minutes and gigabytes; NetCDF has them.
_MOST_CELLS = 200_000

#: Cells up to which a map is printed, too.
_PRINTED_CELLS = 30

#: Panels whose matrix has a sheet, and columns of a sheet.
_MOST_MATRICES, _MOST_COLUMNS = 12, 2**14 - 1

_END = (
    "Where CDP crosses the level; the last grid point before CDP changes by more than 0.2; or the end of the map, "
    "beyond which "
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
    cdp_map = CdpMap.of(dataset)
    small = dataset["cdp"].size <= _MOST_CELLS
    tables = [
        *([ranges_table(analysis, cdp_map.axes), dips_table(analysis, cdp_map.axes)] if analysis.usable_ranges else []),
        *([_cells(cdp_map), *_matrices(cdp_map)] if small else []),
        *([_isolines(cdp_map, analysis)] if analysis.isolines else []),
    ]
    attributes = {name: value for name, value in dataset.attrs.items() if name not in _KNOWN}
    values = {name: axis.values.tolist() for name, axis in cdp_map.axes.items()}
    chain = str(dataset.attrs.get("chain", ""))
    seed = dataset.attrs.get("seed")
    return Result(
        "sweep",
        title(dataset),
        tuple(tables),
        (*findings, *_findings(dataset, analysis)),
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


def _section_columns(axes: Mapping[str, MapAxis], along: str, at: Callable[[Any], At]) -> tuple[Column, ...]:
    """Return the columns of where items are on all axes but that they go along."""

    def value(name: str) -> Callable[[Any], float | str]:
        return lambda item: at(item)[name]

    columns = _axis_columns(axes, *(name for name in axes if name != along))
    return tuple(replace(column, value=value(column.name)) for column in columns)


def ranges_table(analysis: MapAnalysis, axes: Mapping[str, MapAxis]) -> Table:
    """Return the usable ranges of a map, each with the kind of its ends."""
    x, unit = axis_name(axes[analysis.x]), axis_unit(axes[analysis.x])
    enough = f"a CDP of at least {analysis.level:g}"
    columns = (
        *_section_columns(axes, analysis.x, lambda item: item[0].at),
        Column("low", f"{x} from", unit, f"Lower end of the range with {enough}.", value="1.low"),
        Column("high", "to", unit, "Upper end of the range.", value="1.high"),
        Column("low_end", "lower end", meaning=_END, value=lambda item: _end_text(item[1], 0)),
        Column("high_end", "upper end", meaning=_END, value=lambda item: _end_text(item[1], 1)),
        Column("decades", "decades", meaning="log10 of the ratio of the ends.", decimals=2, value="1.decades"),
        Column("range_db", "range", "dB", "20 log10 of the ratio of the ends.", decimals=1, value="1.range_db"),
        *(
            Column(f"{end}_{side}", f"{end} end, point {side}", unit, f"Grid point {side} the {name} end.",
                   shown=False, value=f"1.ends.{number}.bracket.{point}")
            for number, (end, name) in enumerate((("low", "lower"), ("high", "upper")))
            for point, side in enumerate(("below", "above"))
        ),
        Column("widest", "widest", meaning="Whether it is the widest range of the map.", shown=False,
               value=lambda item: item[1] is item[0].widest and item[0] is analysis.widest),
    )  # fmt: skip
    items: list[tuple[UsableRange, UsableInterval | None]] = [
        (usable, interval) for usable in analysis.usable_ranges for interval in usable.intervals or (None,)
    ]
    return Table.of_items("usable_ranges", f"Usable range: CDP of at least {analysis.level:g}", columns, items)


def _end_text(interval: UsableInterval | None, number: int) -> str:
    if interval is None:
        return "nowhere"
    end = interval.ends[number]
    return "end of the map" if end.is_open else "CDP crosses" if end.resolved else "last grid point"


def dips_table(analysis: MapAnalysis, axes: Mapping[str, MapAxis]) -> Table:
    """Return the dips of a map along its luminance."""
    unit = axis_unit(axes[analysis.x])
    columns = (
        *_section_columns(axes, analysis.x, lambda dip: dip.at),
        Column("variable", "dip of", meaning="Quantity that falls although the luminance rises, then rises again.",
               value=lambda dip: VARIABLES[dip.variable].label),
        Column("start", "from", unit, "Where it is highest before the fall."),
        Column("position", "lowest at", unit, "Where it is lowest."),
        Column("recovery", "recovered at", unit, "Where it is again as high as before the fall."),
        Column("highest", "value before", meaning="Value before the fall."),
        Column("depth_ratio", "ratio", meaning="Highest over lowest value.", shown=False),
        Column("depth_db", "depth", "dB", "20 log10 of the ratio of highest and lowest value.", decimals=1),
        Column("lowest_cdp", "lowest CDP", meaning="Lowest CDP until it recovers.", decimals=4),
        Column("lowest_cdp_at", "lowest CDP at", unit, "Where the CDP is lowest.", shown=False),
        Column("expected", "hand-over", unit, "Luminance of the hand-over of captures that explains the dip."),
    )  # fmt: skip
    # Of many sections only the deepest ones matter at a glance, which the page shows.
    several = len(analysis.usable_ranges) > 1
    name = f"Dips along the {axis_name(axes[analysis.x])}"
    return Table.of_items("dips", name, columns, analysis.dips, detail=several)


def _cells(cdp_map: CdpMap) -> Table:
    """Make the long table of all cells, the last axis fastest."""
    dataset, axes = cdp_map.dataset, cdp_map.axes
    grids = np.meshgrid(*(axis.values for axis in axes.values()), indexing="ij")
    data: dict[str, Any] = {name: grid.ravel() for name, grid in zip(axes, grids, strict=True)}
    data |= {str(name): variable.transpose(*axes).values.ravel() for name, variable in dataset.data_vars.items()}
    columns = [variable_column(dataset, str(name)) for name in dataset.data_vars]
    long = dataset["cdp"].size > _PRINTED_CELLS
    return Table("map", "Cells of the map", (*_axis_columns(axes, *axes), *columns), data, detail=long)


def _matrices(cdp_map: CdpMap) -> Iterator[Table]:
    """Yield CDP over the two axes of the picture, for each value of the others."""
    x, y = cdp_map.x, cdp_map.y
    if y is None or x.values.size > _MOST_COLUMNS:
        return
    heads = [plain(float(value), 6) for value in shown(x, x.values)]
    # The unit that follows is that of the first column.
    first = Column(y.name, f"across: {axis_name(x)} in {axis_unit(x) or '1'}; down: {axis_name(y)}", axis_unit(y))
    columns = [Column(f"cdp_{number}", head, decimals=4) for number, head in enumerate(heads)]
    parts = list(zip(range(1, _MOST_MATRICES + 1), cdp_map.sections(*cdp_map.spanned), strict=False))
    for number, (at, section) in parts:
        cdp = zip(columns, section["cdp"].values.T, strict=True)
        data: dict[str, Any] = {y.name: y.values, **{column.name: values for column, values in cdp}}
        text = at_text(at, cdp_map.axes)
        yield Table(
            "cdp" if len(parts) == 1 else f"cdp_{number}",
            f"CDP{text and f' at {text}'}",
            (first, *columns),
            data,
            matrix=True,
            detail=True,
        )


def _isolines(cdp_map: CdpMap, analysis: MapAnalysis) -> Table:
    others = [name for name in cdp_map.axes if name not in cdp_map.spanned]
    columns = (
        *_axis_columns(cdp_map.axes, *others),
        Column("level", "CDP", meaning="CDP along the line."),
        Column("line", "line", meaning="Number of the line."),
        Column("closed", "closed", meaning="Whether the line ends where it begins."),
        *_axis_columns(cdp_map.axes, analysis.x, analysis.y),
    )
    rows = (
        {**line.at, "level": line.level, "line": number, "closed": line.closed} | {analysis.x: x, analysis.y: y}
        for number, line in enumerate(analysis.isolines, start=1)
        for x, y in zip(line.x, line.y, strict=True)
    )
    return Table.of_items("isolines", "Isolines of CDP", columns, rows, detail=True)
