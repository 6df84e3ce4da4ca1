"""Tables of named quantities: value with U and u, unit and meaning."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from .table import Z_95, Column, Table, uncertain

_COLUMNS = (
    Column("quantity", "quantity"),
    *uncertain(Column("value", "value", meaning="Value of the quantity.", unit_of="unit")),
    Column("unit", "unit", meaning="Unit of value, U and u."),
    Column("meaning", "meaning", meaning="What the quantity is."),
)


@dataclass(frozen=True)
class Quantity:
    """A named value.

    Parameters
    ----------
    name : str
        Its name.
    value : float, int or None
        None if it is not known; with the unit ``%`` a fraction.
    unit : str
        Unit as it is printed.
    meaning : str
        Short description.
    u : float or None
        Standard uncertainty.
    expanded : float or None
        Expanded uncertainty U (95 %); None for 1.96 u.
    key : str
        Name for programs; empty if the table has none.
    """

    name: str
    value: float | None
    unit: str = ""
    meaning: str = ""
    u: float | None = None
    expanded: float | None = None
    key: str = ""


def quantity_table(
    name: str, title: str, quantities: Iterable[Quantity], note: str = "", detail: bool = False
) -> Table:
    """Return a table of quantities, one a row."""
    quantities = list(quantities)
    keys = (Column("key", "key", meaning="Name for programs.", shown=False),)
    columns = (*_COLUMNS, *(keys if any(one.key for one in quantities) else ()))
    rows = [
        {
            "quantity": one.name,
            "value": one.value,
            "expanded_value": one.expanded if one.u is None or one.expanded is not None else Z_95 * one.u,
            "u_value": one.u,
            "unit": one.unit,
            "meaning": one.meaning,
            "key": one.key,
        }
        for one in quantities
    ]
    return Table.of_rows(name, title, columns, rows, note, detail)
