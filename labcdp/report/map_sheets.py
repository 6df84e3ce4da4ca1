"""A map of CDP as a spreadsheet."""

from __future__ import annotations

from datetime import datetime
from itertools import product
from typing import TYPE_CHECKING

from ..errors import InputError
from ..evaluate.map_axes import At, MapAxis, map_layout, sections
from .digits import decimals
from .map_parts import axes_of, panels_of
from .map_wording import at_text, axis_name, provenance, title, unit_text, variable_name
from .workbook import Cell, Number, Sheet, workbook

if TYPE_CHECKING:
    from xarray import Dataset

    from ..evaluate.maps import MapAnalysis

#: Rows and columns of a sheet, one less for the head (ECMA-376 leaves it open; Excel and LibreOffice have these).
_MOST_ROWS, _MOST_COLUMNS = 2**20 - 1, 2**14 - 1

#: Digits of a cell that are shown; it holds all of them.
_SHOWN_DIGITS, _MOST_DECIMALS = 4, 6

#: Decimals of a contrast in percent.
_PERCENT_DECIMALS = 2


def map_spreadsheet(dataset: Dataset, analysis: MapAnalysis, time: datetime) -> bytes:
    """Write a map as an Office Open XML workbook; equal arguments give equal bytes.

    Parameters
    ----------
    dataset : xarray.Dataset
        The map.
    analysis : MapAnalysis
        Of the same map.
    time : datetime
        Time of the content, with time zone, for the file's properties.

    Returns
    -------
    bytes
        Content of an .xlsx file: a row for each cell of the map, CDP as a matrix for each pair of axes of numbers,
        usable ranges, dips, and provenance.

    Raises
    ------
    InputError
        If the map is too large for a sheet, or more than 12 matrices would be needed.
    """
    axes = axes_of(dataset)
    layout = map_layout(dataset)
    matrices = [] if layout.y is None else _matrices(dataset, axes)
    sheets = [
        _cells(dataset, axes),
        *matrices,
        _ranges(analysis, axes),
        _dips(analysis, axes),
        _provenance(dataset),
    ]
    return workbook(sheets, title(dataset), time)


def _head(axis: MapAxis) -> str:
    """Head of a column of coordinates; the cells of contrasts have their percent sign themselves."""
    unit = "" if axis.is_contrast else unit_text(axis.unit)
    return f"{axis_name(axis)} in {unit}" if unit else axis_name(axis)


def _number(value: float) -> Number:
    return Number(value, min(max(decimals(value, _SHOWN_DIGITS), 0), _MOST_DECIMALS))


def _coordinate(axis: MapAxis, value: float | str) -> str | Number:
    if isinstance(value, str):
        return value
    return Number(value, _PERCENT_DECIMALS, percent=True) if axis.is_contrast else _number(value)


def _cells(dataset: Dataset, axes: dict[str, MapAxis]) -> Sheet:
    """One row for each cell of the map, the last axis fastest."""
    names = list(dataset.data_vars)
    (_, ordered), *_ = sections(dataset, list(axes))
    n_rows = int(ordered["cdp"].size)
    if n_rows > _MOST_ROWS:
        raise InputError(f"the map has {n_rows} cells, a sheet {_MOST_ROWS} rows: take fewer values of a parameter")
    header = [*map(_head, axes.values()), *(variable_name(dataset, str(name)) for name in names)]
    columns = [ordered[name].values.ravel().tolist() for name in names]
    coordinates = product(*(axis.values.tolist() for axis in axes.values()))
    rows = [
        (*map(_coordinate, axes.values(), place), *map(_number, values))
        for place, values in zip(coordinates, zip(*columns, strict=True), strict=True)
    ]
    return Sheet("Map", header, rows)


def _matrices(dataset: Dataset, axes: dict[str, MapAxis]) -> list[Sheet]:
    """CDP over the two axes of the picture, a sheet for each value of the others."""
    layout = map_layout(dataset)
    x, y = layout.x, layout.y
    assert y is not None
    if x.values.size > _MOST_COLUMNS:
        raise InputError(f"the map has {x.values.size} values of {x.name}, a sheet {_MOST_COLUMNS} columns: take fewer")
    panels = panels_of(dataset, layout)
    sheets = []
    for number, (at, section) in enumerate(panels, start=1):
        where = at_text(at, axes)
        corner = f"CDP{where and f' at {where}'}; down: {_head(y)}; across: {_head(x)}"
        rows = [
            (_coordinate(y, value), *(Number(cdp, 4) for cdp in cells))
            for value, cells in zip(y.values.tolist(), section["cdp"].values.tolist(), strict=True)
        ]
        name = "CDP" if len(panels) == 1 else f"CDP {number}"
        heads = [_coordinate(x, value) for value in x.values.tolist()]
        sheets.append(Sheet(name, [corner, *heads], rows, matrix=True))
    return sheets


def _others(at: At, axes: dict[str, MapAxis], along: str) -> tuple[Cell, ...]:
    return tuple(_coordinate(axes[name], at[name]) for name in axes if name != along)


def _ranges(analysis: MapAnalysis, axes: dict[str, MapAxis]) -> Sheet:
    x = axes[analysis.x]
    along = _head(x)
    header = (
        *(_head(axis) for name, axis in axes.items() if name != analysis.x),
        "CDP at least",
        f"{along}, from",
        f"{along}, to",
        "lower end",
        "upper end",
        "decades",
        "range in dB (20 log10)",
        *(f"{along}, grid point {side} {end} end" for end in ("lower", "upper") for side in ("below", "above")),
    )
    rows: list[tuple[Cell, ...]] = []
    for one in analysis.usable_ranges:
        fixed = (*_others(one.at, axes, analysis.x), Number(one.level, 2))
        rows += [
            (
                *fixed,
                _coordinate(x, interval.low),
                _coordinate(x, interval.high),
                _end(interval.low_open, interval.low_resolved),
                _end(interval.high_open, interval.high_resolved),
                Number(interval.decades, 3),
                Number(interval.range_db, 2),
                *(_coordinate(x, place) for place in (*interval.low_bracket, *interval.high_bracket)),
            )
            for interval in one.intervals
        ] or [(*fixed, None, None, "nowhere as high", *(None,) * 7)]
    return Sheet("Usable ranges", header, rows)


def _end(is_open: bool, resolved: bool) -> str:
    if is_open:
        return "end of the map"
    return "CDP crosses" if resolved else "last grid point; CDP changes too much to the next"


def _dips(analysis: MapAnalysis, axes: dict[str, MapAxis]) -> Sheet:
    x = axes[analysis.x]
    along = _head(x)
    header = (
        *(_head(axis) for name, axis in axes.items() if name != analysis.x),
        "variable",
        f"{along}, start",
        f"{along}, lowest",
        f"{along}, recovered",
        "value before",
        "depth as ratio",
        "depth in dB (20 log10)",
        "lowest CDP",
        f"{along}, lowest CDP",
        f"{along}, change of exposure",
    )
    rows = [
        (
            *_others(dip.at, axes, analysis.x),
            dip.variable,
            *(_coordinate(x, place) for place in (dip.start, dip.position, dip.recovery)),
            _number(dip.highest),
            _number(dip.depth_ratio),
            Number(dip.depth_db, 2),
            Number(dip.lowest_cdp, 4),
            _coordinate(x, dip.lowest_cdp_at),
            _coordinate(x, dip.expected),
        )
        for dip in analysis.dips
    ]
    return Sheet("Dips", header, rows)


def _provenance(dataset: Dataset) -> Sheet:
    chain = str(dataset.attrs.get("chain", "")).splitlines()
    rows = [("title", title(dataset)), *provenance(dataset), *(("chain", line) for line in chain if line)]
    return Sheet("Provenance", ("What", "Value"), rows)
