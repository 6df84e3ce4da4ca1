"""Columns that belong together: a value with its expanded uncertainty, a probability with its interval."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from operator import attrgetter
from typing import Any

from ..core.table import Column, Taken


def with_expanded(column: Column, expanded: Taken, name: str = "", label: str = "") -> tuple[Column, Column]:
    """Return a column that shows ``value ± U``, with its column of U.

    The latter has the name of the column after ``expanded_`` and its label after "U of" unless others are given.
    """
    name, label = name or f"expanded_{column.name}", label or f"U of {column.label}"
    of_u = Column(name, label, column.unit, "U (95 %).", digits=2, shown=False, value=expanded)
    return replace(column, expanded=name), of_u


def with_interval(column: Column, interval: str) -> tuple[Column, Column, Column]:
    """Return a column that shows ``value (low to high)``, with the ends of its 95 % interval.

    Parameters
    ----------
    column : Column
        That of the value.
    interval : str
        Attribute of an item that is the pair of ends.
    """
    ends = attrgetter(interval)
    low, high = (
        Column(
            f"{column.name}_{name}",
            f"{column.label}, {end} end",
            meaning=f"{end.capitalize()} end of the 95 % interval.",
            decimals=5,
            shown=False,
            value=partial(_end, ends, number),
        )
        for number, (name, end) in enumerate((("low", "lower"), ("high", "upper")))
    )
    return replace(column, low=low.name, high=high.name), low, high


def _end(interval: Callable[[Any], Any], number: int, item: Any) -> Any:
    return interval(item)[number]
