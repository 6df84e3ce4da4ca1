"""The one result object: tables and findings of an evaluation, and what they were made from."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from pathlib import Path
from typing import Any, Literal, TypeAlias

from .disk import file_sha256
from .quantity import Z_95
from .table import Column, Table, uncertain

#: ``info``: worth knowing, nothing to do. ``warning``: the user should act. ``error``: a part has no result.
Severity: TypeAlias = Literal["info", "warning", "error"]

#: Values of a finding.
FindingValue: TypeAlias = str | int | float | bool | list[str] | list[float] | None


@dataclass(frozen=True)
class Finding:
    """Something a user should know.

    Parameters
    ----------
    code : str
        Code in lower case with hyphens, for example ``patch-saturated``; the key of its text.
    severity : {'info', 'warning', 'error'}
        How much it matters.
    subject : str
        The patch, region, frame, file or device it is about; empty for the whole result.
    values : mapping
        Numbers and names that the text quotes, with units in their names.
    """

    code: str
    severity: Severity = "warning"
    subject: str = ""
    values: Mapping[str, FindingValue] = field(default_factory=dict, hash=False)

    def __str__(self) -> str:
        """Return code, subject and values, as logs have them; `labcdp.report.text` makes a sentence."""
        values = ", ".join(f"{name}={value}" for name, value in self.values.items())
        return " ".join(part for part in (self.code, self.subject and f"({self.subject})", values) if part)

    def within(self, place: str) -> Finding:
        """Return the finding with a place added to its subject, for example a colour plane."""
        return replace(self, subject=f"{self.subject}, {place}" if self.subject else place)


def info(code: str, subject: str = "", /, **values: FindingValue) -> Finding:
    """Return a finding that needs no action."""
    return Finding(code, "info", subject, values)


def warning(code: str, subject: str = "", /, **values: FindingValue) -> Finding:
    """Return a finding that the user should act upon."""
    return Finding(code, "warning", subject, values)


def error(code: str, subject: str = "", /, **values: FindingValue) -> Finding:
    """Return a finding that says why a part has no result."""
    return Finding(code, "error", subject, values)


def log_findings(log: logging.Logger, findings: Iterable[Finding]) -> None:
    """Log what the user should act upon."""
    for finding in findings:
        if finding.severity != "info":
            log.warning("%s", finding)


def unique(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return each finding once, the most severe first, otherwise in their order."""
    order = {"error": 0, "warning": 1, "info": 2}
    return tuple(sorted(dict.fromkeys(findings), key=lambda finding: order[finding.severity]))


@dataclass(frozen=True)
class NamedValue:
    """A named value, as a row of a table.

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


def quantity_table(name: str, title: str, quantities: Iterable[NamedValue], detail: bool = False) -> Table:
    """Return a table of quantities, one a row."""
    quantities = list(quantities)
    columns = (
        Column("quantity", "quantity", value="name"),
        *uncertain(Column("value", "value", meaning="Value of the quantity.", unit_of="unit"), "u", _expanded),
        Column("unit", "unit", meaning="Unit of value, U and u."),
        Column("meaning", "meaning", meaning="What the quantity is."),
        Column("key", "key", meaning="Name for programs.", shown=False),
    )
    named = any(quantity.key for quantity in quantities)
    return Table.of_items(name, title, columns if named else columns[:-1], quantities, detail=detail)


def _expanded(quantity: NamedValue) -> float | None:
    return Z_95 * quantity.u if quantity.expanded is None and quantity.u is not None else quantity.expanded


@dataclass(frozen=True)
class InputFile:
    """A file or folder that a result was made from.

    Parameters
    ----------
    role : str
        What it was used as, for example ``session``, ``calibration``, ``picture``, ``regions`` or ``chain``.
    path : str
        Where it was.
    sha256 : str
        Hash of its content, in hexadecimal digits; of a session, that of its journal.
    """

    role: str
    path: str
    sha256: str

    @classmethod
    def of(cls, role: str, path: str | Path) -> InputFile:
        """Return the record of a file; raises InputError if it cannot be read."""
        return cls(role, str(path), file_sha256(path, "the path of a file"))


@dataclass(frozen=True, eq=False)
class Result:
    """What an evaluation returns; terminal, page, spreadsheet, JSON and NetCDF are renderings of it.

    Parameters
    ----------
    kind : str
        Name of the command, for example ``evaluate`` or ``image``.
    title : str
        What was evaluated, for example the name of a session or file.
    tables : tuple of Table
        The numbers.
    findings : tuple of Finding
        What the user should know.
    inputs : tuple of InputFile
        What it was made from.
    configuration : mapping
        Options and configuration; values JSON can hold.
    seed : int or None
        Of the random numbers; None if there are none.
    simulated : bool
        Whether any of the data is simulated.
    """

    kind: str
    title: str
    tables: tuple[Table, ...]
    findings: tuple[Finding, ...] = ()
    inputs: tuple[InputFile, ...] = ()
    configuration: Mapping[str, Any] = field(default_factory=dict)
    seed: int | None = None
    simulated: bool = False

    @classmethod
    def of(
        cls, kind: str, title: str, tables: Iterable[Table], findings: Iterable[Finding], *inputs: InputFile, **how: Any
    ) -> Result:
        """Make a result whose findings are named once, the most severe first; `how` are the other parameters."""
        return cls(kind, title, tuple(tables), unique(findings), inputs, **how)

    def tables_named(self, *names: str) -> list[Table]:
        """Return the tables of these names, of those that the result has."""
        return [table for table in self.tables if table.name in names]

    def table(self, name: str) -> Table:
        """Return the table of a name."""
        return next(table for table in self.tables if table.name == name)


#: A longer table is cut off.
_MOST_ROWS = 50


def html_table(columns: Sequence[str], rows: Iterable[Sequence[str]], caption: str = "") -> str:
    """Return a table as HTML; all texts are escaped, rows beyond 50 left out."""
    shown = list(rows)
    left_out = len(shown) - _MOST_ROWS
    head = "".join(f"<th>{escape(column)}</th>" for column in columns)
    body = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in shown[:_MOST_ROWS])
    title = f"<caption>{escape(caption)}</caption>" if caption else ""
    more = f"<p>{left_out} more rows</p>" if left_out > 0 else ""
    return f"<table>{title}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{more}"


def number(value: float) -> str:
    """Return a number in four significant digits."""
    return f"{value:.4g}"
