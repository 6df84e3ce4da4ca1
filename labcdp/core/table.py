"""Labelled tables: every column carries name, label, unit, digits and meaning."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias

from .errors import InputError
from .quantity import Z_95

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from xarray import Dataset

#: What a cell can hold; None and nan are shown as missing.
Value: TypeAlias = str | int | float | bool | None
#: How a value is taken of an item: by a path of attributes and indices, on which a missing value stays missing, or by a
#: function.
Taken: TypeAlias = str | Callable[[Any], Any]


@dataclass(frozen=True)
class Column:
    """A column of a `Table`.

    Parameters
    ----------
    name : str
        Key in JSON, NetCDF and Python, with the unit, for example ``luminance_cd_m2``.
    label : str
        Head of the column in text, pages and sheets, without the unit.
    unit : str
        Unit as it is printed, for example ``cd/m²``. With ``%`` the values are fractions: text and pages show 100
        times the value, as do the numbers of sheets; JSON and NetCDF hold the fraction.
    meaning : str
        What the values are, in one sentence.
    digits : int
        Significant digits of a number that has no uncertainty in this table; 0 for a chosen value, which is shown as
        written.
    decimals : int or None
        Decimals instead, of what is shown; for columns whose numbers should line up.
    expanded : str
        Name of the column with the expanded uncertainty U (95 %); text then shows ``value ± U``.
    low, high : str
        Names of the columns with the ends of the 95 % interval; text then shows ``value (low to high)``.
    bound : str
        Name of the column that says whether the true value is larger (``>``), smaller (``<``) or not known (``?``);
        text then shows ``> value``, without an uncertainty.
    shown : bool
        Whether text and pages show the column by itself; sheets, JSON and NetCDF hold all columns.
    time : bool
        Whether values in seconds are shown in s, ms or µs, whichever is handy.
    unit_of : str
        Name of the column with the unit of each row, for tables of named quantities; rows in ``%`` hold fractions, too.
    value : str or callable
        For `Table.of_items`: path of attributes and indices from an item, or a function of it, that is the value; empty
        for the attribute `name`.
    """

    name: str
    label: str
    unit: str = ""
    meaning: str = ""
    digits: int = 4
    decimals: int | None = None
    expanded: str = ""
    low: str = ""
    high: str = ""
    bound: str = ""
    shown: bool = True
    time: bool = False
    unit_of: str = ""
    value: Taken = ""

    @property
    def head(self) -> str:
        """Label with unit."""
        return f"{self.label} ({self.unit})" if self.unit else self.label

    def unit_in(self, row: Mapping[str, Any]) -> str:
        """Return the unit of the value in a row."""
        return str(row[self.unit_of] or "") if self.unit_of else self.unit

    def within(self, path: str) -> Column:
        """Return the column for items at whose `path` its own items are."""
        own = self.value or self.name
        if isinstance(own, str):
            return replace(self, value=f"{path}.{own}")
        return replace(self, value=lambda item: own(_taken(path, item)))


def with_expanded(column: Column, expanded: Taken, name: str = "") -> tuple[Column, Column]:
    """Return a column that shows ``value ± U``, with that of U, whose name is ``expanded_`` and the column's, or given.

    In a table of items `expanded` is the value of U.
    """
    of_u = _hidden(column, name or f"expanded_{column.name}", "U (95 %) of", "Expanded uncertainty (95 %).", expanded)
    return replace(column, expanded=of_u.name), of_u


def uncertain(column: Column, u: Taken = "", expanded: Taken = "") -> tuple[Column, Column, Column]:
    """Return a column that shows ``value ± U``, with its columns of U and u.

    In a table of items `u` and `expanded` (by default 1.96 u) are their values.
    """
    standard = _hidden(column, f"u_{column.name}", "u of", "Standard uncertainty.", u)
    return *with_expanded(column, expanded or (lambda item: _expanded(_taken(u, item)))), standard


def with_bound(columns: Sequence[Column], bound: Taken) -> tuple[Column, ...]:
    """Return columns of an uncertain value with one that says whether it is a bound; `bound` is its value."""
    first, *others = columns
    name = f"{first.name}_bound"
    meaning = "Whether saturated pixels make the value a bound: the true one is larger (>), smaller (<) or unknown (?)."
    column = Column(name, f"{first.label}, bound", "", meaning, shown=False, value=bound)
    return replace(first, bound=name), *others, column


def with_interval(column: Column, interval: str) -> tuple[Column, Column, Column]:
    """Return a column of a probability that shows ``value (low to high)``, with the ends of its 95 % interval.

    In a table of items `interval` is the path to the pair of ends.
    """
    low, high = (
        Column(
            f"{column.name}_{name}", f"{column.label}, {end} end", "", f"{end.capitalize()} end of the 95 % interval.",
            decimals=5, shown=False, value=f"{interval}.{number}",
        )
        for number, (name, end) in enumerate((("low", "lower"), ("high", "upper")))
    )  # fmt: skip
    return replace(column, low=low.name, high=high.name), low, high


def _hidden(column: Column, name: str, of: str, meaning: str, value: Taken) -> Column:
    """Return a column of an uncertainty, which text shows with the value."""
    label = f"{of} {column.label}"
    return replace(column, name=name, label=label, meaning=meaning, digits=2, decimals=None, shown=False, value=value)


def _expanded(u: float | None) -> float | None:
    return None if u is None else Z_95 * u


def _taken(value: Taken, item: Any) -> Any:
    if not isinstance(value, str):
        return value(item)
    for part in value.split("."):
        if item is not None:
            item = item[int(part)] if part.isdigit() else getattr(item, part)
    return item


def values_of(columns: Sequence[Column], items: Sequence[Any]) -> dict[str, list[Any]]:
    """Return the values that columns take from items, a list for each column; of mappings those of its name."""
    return {column.name: [_value(column, item) for item in items] for column in columns}


def array_values_of(columns: Sequence[Column], record: Any) -> dict[str, list[Any]]:
    """Return the values that columns take from a record of arrays, a list for each column."""
    return {column.name: _taken(column.value or column.name, record).tolist() for column in columns}


def _value(column: Column, item: Any) -> Any:
    if isinstance(item, Mapping) and isinstance(column.value, str):
        return item.get(column.name)
    return _taken(column.value or column.name, item)


def variables_of(columns: Sequence[Column], dims: tuple[str, ...], items: Sequence[Any]) -> dict[str, Any]:
    """Return the values that columns take from items as variables of an `xarray.Dataset`, with units and meanings.

    Parameters
    ----------
    columns : sequence of Column
        What is taken.
    dims : tuple of str
        Names of the dimensions.
    items : sequence
        Items, also tuples, or sequences of such for two dimensions; of None all numbers are nan. A missing text is
        empty; what is neither a number nor a text is written as one.
    """
    import numpy as np

    flat = list(items) if len(dims) == 1 else [item for row in items for item in row]
    shape = (len(items),) if len(dims) == 1 else (len(items), len(flat) // max(len(items), 1))
    found = {}
    for column, values in zip(columns, values_of(columns, flat).values(), strict=True):
        numeric = all(value is None or isinstance(value, int | float | np.number | np.bool_) for value in values)
        known = ((np.nan if numeric else "") if value is None else value if numeric else str(value) for value in values)
        array = np.array(list(known)).reshape(shape)
        found[column.name] = (dims, array, attributes_of(column, array))
    return found


def attributes_of(column: Column, array: NDArray[Any]) -> dict[str, str]:
    """Return unit and meaning of a column's values as attributes of a variable of an `xarray.Dataset`."""
    unit = "1" if column.unit == "%" or (array.dtype.kind in "iuf" and not column.unit) else column.unit
    attributes = {"long_name": column.label, "units": unit.replace("²", "^2"), "description": column.meaning}
    return {key: text for key, text in attributes.items() if text}


@dataclass(frozen=True, eq=False)
class Table:
    """Values in labelled columns.

    Parameters
    ----------
    name : str
        Key of the table in JSON and name of its sheet.
    title : str
        Its caption.
    columns : tuple of Column
        The first one names the row.
    data : mapping of str to sequence
        Values of each column, all of one length.
    note : str
        What a reader has to know to read it; may be empty.
    matrix : bool
        Whether all columns but the first hold probabilities, which sheets show in colours.
    detail : bool
        Whether the terminal leaves it out; files have it.
    """

    name: str
    title: str
    columns: tuple[Column, ...]
    data: Mapping[str, Sequence[Any]]
    note: str = ""
    matrix: bool = False
    detail: bool = False

    def __post_init__(self) -> None:
        names = [column.name for column in self.columns]
        if sorted(names) != sorted(self.data):
            raise InputError(f"table {self.name!r} has columns {names} and data of {list(self.data)}")
        if len({len(values) for values in self.data.values()}) > 1:
            raise InputError(f"the columns of table {self.name!r} have different lengths")

    @classmethod
    def of_facts(cls, name: str, title: str, facts: Iterable[tuple[str, str]], item: str = "item") -> Table:
        """Make a table of named texts, without those that are empty."""
        kept = [(label, text) for label, text in facts if text]
        columns = (Column("item", item), Column("value", "value"))
        data = {"item": [label for label, _ in kept], "value": [text for _, text in kept]}
        return cls(name, title, columns, data, detail=True)

    @classmethod
    def of_items(
        cls,
        name: str,
        title: str,
        columns: Sequence[Column],
        items: Iterable[Any],
        note: str = "",
        detail: bool = False,
    ) -> Table:
        """Make a table of items, one a row, whose values the columns take; those that a mapping lacks are missing."""
        return cls.from_data(name, title, columns, values_of(columns, list(items)), note, detail)

    @classmethod
    def from_data(
        cls,
        name: str,
        title: str,
        columns: Sequence[Column],
        data: Mapping[str, Sequence[Any]],
        note: str = "",
        detail: bool = False,
    ) -> Table:
        """Make a table of values that its columns took before, from the items of one or of several lists."""
        return cls(name, title, tuple(replace(column, value="") for column in columns), data, note, detail=detail)

    def __len__(self) -> int:
        return len(self.data[self.columns[0].name]) if self.columns else 0

    def __getitem__(self, name: str) -> Sequence[Any]:
        return self.data[name]

    def column(self, name: str) -> Column:
        """Return the column of a name."""
        return next(column for column in self.columns if column.name == name)

    def rows(self) -> Iterator[dict[str, Any]]:
        """Iterate over the rows, each as Python's values by column name."""
        names = [column.name for column in self.columns]
        for values in zip(*(self.data[name] for name in names), strict=True):
            yield {name: _scalar(value) for name, value in zip(names, values, strict=True)}

    def select(self, keep: Sequence[int]) -> Table:
        """Return a table of the rows with these positions."""
        return replace(self, data={name: [values[index] for index in keep] for name, values in self.data.items()})

    def showing(self, *names: str) -> Table:
        """Return the table with only these columns, of those that are shown, in text and pages."""
        columns = tuple(replace(column, shown=column.shown and column.name in names) for column in self.columns)
        return replace(self, columns=columns)

    def as_detail(self) -> Table:
        """Return a table that the terminal leaves out."""
        return replace(self, detail=True)

    def all_shown(self) -> Table:
        """Return a table whose columns are all shown."""
        return replace(self, columns=tuple(replace(column, shown=True) for column in self.columns))

    def only(self, *names: str) -> Table:
        """Return a table of some columns, in this order."""
        columns = tuple(self.column(name) for name in names)
        return replace(self, columns=columns, data={name: self.data[name] for name in names})

    def sorted_by(self, name: str, reverse: bool = False) -> Table:
        """Return the table with its rows sorted by a column; missing values come last."""
        values = self.data[name]
        known = [index for index in range(len(self)) if values[index] is not None and values[index] == values[index]]
        rest = [index for index in range(len(self)) if index not in set(known)]
        return self.select([*sorted(known, key=lambda index: values[index], reverse=reverse), *rest])

    def to_dataset(self) -> Dataset:
        """Return the table as `xarray.Dataset` with the dimension ``row`` and units and meanings as attributes."""
        from xarray import Dataset

        return Dataset(variables_of(self.columns, ("row",), list(self.rows())), attrs={"title": self.title})


def _scalar(value: Any) -> Any:
    """Return a NumPy scalar as Python's."""
    return value.item() if hasattr(value, "item") else value
