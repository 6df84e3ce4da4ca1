"""Cells of a `Table` as text, rounded by their uncertainty."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from decimal import Decimal
from math import isfinite, isinf
from typing import Any

from ..core.table import Column, Table
from .digits import decimals, exposure, fixed, printable

#: Text for an unknown value.
MISSING = "-"

#: Most decimals, however small the uncertainty; fewer for an interval, which is one of a probability.
_MOST_DECIMALS, _MOST_OF_INTERVAL = 6, 5


def text_table(table: Table) -> tuple[list[str], list[list[str]]]:
    """Return heads and rows of the visible columns as text."""
    shown = [column for column in table.columns if column.shown]
    return [_head(column) for column in shown], [[cell_text(column, row) for column in shown] for row in table.rows()]


def is_number(values: Iterable[Any]) -> bool:
    """Whether a column holds numbers and is right-aligned."""
    return not isinstance(next((value for value in values if value is not None), ""), str | bool)


def cell_text(column: Column, row: Mapping[str, Any]) -> str:
    """Return one cell: text, ``value``, ``value ± U`` or ``value (low to high)``."""
    value = row[column.name]
    if value is None or isinstance(value, str):
        return printable(value) if value else MISSING
    if isinstance(value, bool):
        return "yes" if value else "no"
    if not isfinite(value):
        return "∞" if isinf(value) and value > 0 else MISSING
    if column.time:
        return exposure(value)
    factor = 100 if column.unit_in(row) == "%" else 1
    n = cell_decimals(column, row)
    text = fixed(factor * value, n)
    uncertainty = row.get(column.expanded)
    if uncertainty is not None and isfinite(uncertainty):
        return f"{text} ± {fixed(factor * uncertainty, n)}"
    low, high = row.get(column.low), row.get(column.high)
    if low is not None and high is not None and isfinite(low) and isfinite(high):
        return f"{text} ({fixed(factor * low, n)} to {fixed(factor * high, n)})"
    return text


def cell_decimals(column: Column, row: Mapping[str, Any]) -> int:
    """Return how many decimals of a number are shown: two digits of its uncertainty (GUM 7.2.6), else its own.

    A negative number rounds to tens and so on. For values in percent the decimals of the percentage are counted.
    """
    factor = 100 if column.unit_in(row) == "%" else 1
    if column.decimals is not None:
        return column.decimals
    uncertainty = row.get(column.expanded)
    if uncertainty is None:
        low, high = row.get(column.low), row.get(column.high)
        uncertainty = (high - low) / 2 if low is not None and high is not None else None
    if uncertainty is not None and isfinite(uncertainty) and uncertainty > 0:
        return min(decimals(factor * uncertainty, 2), _MOST_OF_INTERVAL if column.low else _MOST_DECIMALS)
    value = row[column.name]
    if column.digits == 0:
        return max(-int(Decimal(f"{factor * value:.6g}").as_tuple().exponent), 0)
    return 0 if isinstance(value, int) else decimals(factor * value, column.digits)


def _head(column: Column) -> str:
    extra = " ± U" if column.expanded else ", 95 % interval" if column.low else ""
    if column.time:
        return column.label
    return f"{column.label}{extra} ({column.unit})" if column.unit else f"{column.label}{extra}"
