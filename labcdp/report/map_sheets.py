"""A map of CDP as a spreadsheet."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from io import BytesIO
from itertools import product
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..evaluate.map_axes import At, MapAxis, map_layout, sections
from .digits import decimals
from .map_parts import axes_of, panels_of
from .map_wording import at_text, axis_name, provenance, title, unit_text, variable_name
from .workbook import Cell, Number, Sheet, _without_times, workbook

if TYPE_CHECKING:
    from xarray import Dataset

    from ..evaluate.maps import MapAnalysis

#: Rows and columns of a sheet, one less for the head (ECMA-376 leaves it open; Excel and LibreOffice have these).
_MOST_ROWS, _MOST_COLUMNS = 2**20 - 1, 2**14 - 1

#: Digits of a cell that are shown; it holds all of them.
_SHOWN_DIGITS, _MOST_DECIMALS = 4, 6

#: Colours of CDP 0, 0.5 and 1, light enough for black numbers, and told apart by colour-blind readers.
_SCALE = ("F5B895", "FFFFFF", "8FC3E8")

_PERCENT = "0.00%"


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
    data = workbook(sheets, title(dataset), time)
    return _finished(data, axes, [sheet.title for sheet in matrices], layout.x, layout.y)


def _head(axis: MapAxis) -> str:
    """Head of a column of coordinates; the cells of contrasts have their percent sign themselves."""
    unit = "" if axis.is_contrast else unit_text(axis.unit)
    return f"{axis_name(axis)} in {unit}" if unit else axis_name(axis)


def _number(value: float) -> Number:
    return Number(value, min(max(decimals(value, _SHOWN_DIGITS), 0), _MOST_DECIMALS))


def _coordinate(value: float | str) -> Cell:
    return value if isinstance(value, str) else _number(value)


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
        (*map(_coordinate, place), *map(_number, values))
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
            (_number(value), *(Number(cdp, 4) for cdp in cells))
            for value, cells in zip(y.values.tolist(), section["cdp"].values.tolist(), strict=True)
        ]
        name = "CDP" if len(panels) == 1 else f"CDP {number}"
        sheets.append(Sheet(name, [corner, *(f"{value:.4g}" for value in x.values)], rows))
    return sheets


def _others(at: At, axes: dict[str, MapAxis], along: str) -> tuple[Cell, ...]:
    return tuple(_coordinate(at[name]) for name in axes if name != along)


def _ranges(analysis: MapAnalysis, axes: dict[str, MapAxis]) -> Sheet:
    along = _head(axes[analysis.x])
    header = (
        *(_head(axis) for name, axis in axes.items() if name != analysis.x),
        "CDP at least",
        f"{along}, from",
        f"{along}, to",
        "lower end",
        "upper end",
        "decades",
        "range in dB (20 log10)",
    )
    rows: list[tuple[Cell, ...]] = []
    for one in analysis.usable_ranges:
        fixed = (*_others(one.at, axes, analysis.x), Number(one.level, 2))
        rows += [
            (
                *fixed,
                _number(interval.low),
                _number(interval.high),
                _end(interval.low_open),
                _end(interval.high_open),
                Number(interval.decades, 3),
                Number(interval.range_db, 2),
            )
            for interval in one.intervals
        ] or [(*fixed, None, None, "nowhere as high", None, None, None)]
    return Sheet("Usable ranges", header, rows)


def _end(is_open: bool) -> str:
    return "end of the map" if is_open else "CDP crosses"


def _dips(analysis: MapAnalysis, axes: dict[str, MapAxis]) -> Sheet:
    along = _head(axes[analysis.x])
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
            _number(dip.start),
            _number(dip.position),
            _number(dip.recovery),
            _number(dip.highest),
            _number(dip.depth_ratio),
            Number(dip.depth_db, 2),
            Number(dip.lowest_cdp, 4),
            _number(dip.lowest_cdp_at),
            _number(dip.expected),
        )
        for dip in analysis.dips
    ]
    return Sheet("Dips", header, rows)


def _provenance(dataset: Dataset) -> Sheet:
    chain = str(dataset.attrs.get("chain", "")).splitlines()
    rows = [("title", title(dataset)), *provenance(dataset), *(("chain", line) for line in chain if line)]
    return Sheet("Provenance", ("What", "Value"), rows)


def _finished(data: bytes, axes: dict[str, MapAxis], matrices: Sequence[str], x: MapAxis, y: MapAxis | None) -> bytes:
    """Add what a sheet of text and numbers does not have: percent signs, heads that are numbers, colours."""
    from openpyxl import load_workbook

    book = load_workbook(BytesIO(data))
    heads = [_head(axis) for axis in axes.values() if axis.is_contrast]
    for page in book:
        for column in page.iter_cols():
            if any(str(column[0].value).startswith(head) for head in heads):
                _set_format(column[1:], _PERCENT)
    for name in matrices:
        _finish_matrix(book[name], x, y)
    properties = book.properties
    created = properties.created
    file = BytesIO()
    book.save(file)
    properties.created = properties.modified = created
    return _without_times(file.getvalue(), properties)


def _finish_matrix(page: Any, x: MapAxis, y: MapAxis | None) -> None:
    from openpyxl.formatting.rule import ColorScaleRule
    from openpyxl.utils import get_column_letter

    head, *rest = page[1]
    for cell, value in zip(rest, x.values.tolist(), strict=True):
        cell.value = value
        cell.quotePrefix = False
        n = _number(value).n_decimals
        cell.number_format = _PERCENT if x.is_contrast else f"0.{'0' * n}" if n else "0"
    if y is not None and y.is_contrast:
        _set_format([row[0] for row in page.iter_rows(min_row=2)], _PERCENT)
    last = f"{get_column_letter(page.max_column)}{page.max_row}"
    stops: dict[str, Any] = {}
    for stop, value, colour in zip(("start", "mid", "end"), (0, 0.5, 1), _SCALE, strict=True):
        stops |= {f"{stop}_type": "num", f"{stop}_value": value, f"{stop}_color": colour}
    page.conditional_formatting.add(f"B2:{last}", ColorScaleRule(**stops))
    page.freeze_panes = "B2"
    page.column_dimensions["A"].width = 30
    page.row_dimensions[head.row].height = 60


def _set_format(cells: Sequence[Any], number_format: str) -> None:
    for cell in cells:
        if isinstance(cell.value, int | float):
            cell.number_format = number_format
