"""Cells of a spreadsheet (.xlsx, ISO/IEC 29500-1), read in a child process within limits."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import date, datetime, time, timedelta
from decimal import Decimal
from io import BytesIO
from itertools import zip_longest
from typing import Any, Literal

from ..errors import InputError
from .files import AnyPath, damage_reported
from .tiff import read_in_child

#: How the bytes of an archive, thus of .xlsx, and of an OLE compound file ([MS-CFB] 2.2) begin.
ARCHIVE, COMPOUND_FILE = b"PK\x03\x04", b"\xd0\xcf\x11\xe0"
#: A compound file that holds an encrypted .xlsx has a stream of this name ([MS-OFFCRYPTO] 2.3.4.4).
_ENCRYPTED = "EncryptedPackage".encode("utf-16-le")
#: Sizes from which a file is refused: its parts unpacked, its cells, and the rows that a sheet can have.
_MOST_UNPACKED_BYTES, _MOST_CELLS, _MOST_ROWS = 2**28, 500_000, 2**20
#: What Excel keeps of a number; more are errors of binary fractions.
_DIGITS = 15
#: What a number format shows as it is: quoted or escaped text, colours and conditions, and blanks.
_LITERAL = re.compile(r'"[^"]*"|\\.|\[[^\]]*\]|_.|\*.')
_FORMAT = re.compile(r"[#,0?]*0(?:\.(?P<decimals>0+)[#?]*)?(?P<exponent>E[+-]0+)?")

#: ``unstored`` is a formula without a value.
CellKind = Literal["empty", "number", "time", "text", "error", "unstored"]


@dataclass(frozen=True)
class Cell:
    """A cell.

    Parameters
    ----------
    kind : str
        What it holds.
    text : str
        It as text: of a number the value stored, with the trailing zeros that the cell shows; ISO 8601 of a date.
    raw : str
        The value stored.
    """

    kind: CellKind
    text: str
    raw: str


EMPTY = Cell("empty", "", "")


@dataclass(frozen=True)
class Sheet:
    """A sheet.

    Parameters
    ----------
    title : str
        Its name.
    rows : tuple of (int, tuple of Cell)
        Those that are not empty, with their numbers; cells from column A on.
    """

    title: str
    rows: tuple[tuple[int, tuple[Cell, ...]], ...]


def read_sheets(data: bytes, path: AnyPath) -> list[Sheet]:
    """Return the sheets of a spreadsheet.

    Parameters
    ----------
    data : bytes
        The file, which begins as `ARCHIVE` or `COMPOUND_FILE`.
    path : path
        For messages.

    Raises
    ------
    InputError
        If it is encrypted, of another format or damaged, or unpacks to more than 256 MiB or 500,000 cells.
    """
    if data.startswith(COMPOUND_FILE):
        if _ENCRYPTED in data:
            raise InputError(f"{path} is encrypted: save it without a password")
        raise InputError(f"{path} is a spreadsheet or document of an old format: save it as .xlsx, or as CSV in UTF-8")
    with damage_reported(f"{path} cannot be read as a spreadsheet", ": save it again as .xlsx, or as CSV in UTF-8"):
        try:
            with zipfile.ZipFile(BytesIO(data)) as parts:
                if sum(part.file_size for part in parts.infolist()) > _MOST_UNPACKED_BYTES:
                    raise ValueError(f"it unpacks to more than {_MOST_UNPACKED_BYTES // 2**20} MiB")
            sheets: list[Sheet] = read_in_child(f"{__name__}:sheets_of", data)
        except InputError as error:
            # Of the child, it says nothing of the file.
            raise ValueError(str(error)) from error
    return sheets


def sheets_of(data: bytes) -> list[Sheet]:
    """Read all cells with openpyxl, which raises nearly anything for damaged files; for `read_sheets`."""
    from openpyxl import load_workbook

    # One pass has the values, the other says which cells are formulas.
    books = [load_workbook(BytesIO(data), read_only=True, data_only=values) for values in (True, False)]
    sheets, n_cells = [], 0
    for values, formulas in zip(*(book.worksheets for book in books), strict=True):
        rows = []
        for number, cells in _rows(values, formulas):
            n_cells += sum(cell.kind != "empty" for cell in cells)
            if n_cells > _MOST_CELLS:
                raise InputError(f"it has more than {_MOST_CELLS} cells")
            rows.append((number, cells))
        sheets.append(Sheet(values.title, tuple(rows)))
    return sheets


def _rows(values: Any, formulas: Any) -> Iterator[tuple[int, tuple[Cell, ...]]]:
    for sheet in (values, formulas):
        # What a file states as its size may be wrong, and would cut it.
        sheet.reset_dimensions()
    for number, (row, stored) in enumerate(zip(values.rows, formulas.rows, strict=True), start=1):
        if number > _MOST_ROWS:
            raise InputError(f"a sheet has more than {_MOST_ROWS} rows")
        cells = tuple(_cell(one, formula.data_type == "f") for one, formula in zip_longest(row, stored))
        if any(cell.kind != "empty" for cell in cells):
            yield number, cells


def _cell(cell: Any, is_formula: bool) -> Cell:
    value = cell.value
    if value is None:
        # The result of a formula may be the empty text.
        return Cell("unstored", "", "") if is_formula and cell.data_type != "str" else EMPTY
    if cell.data_type == "e":
        return Cell("error", str(value), str(value))
    if isinstance(value, int | float) and not isinstance(value, bool):
        return Cell("number", number_text(value, cell.number_format), repr(value))
    if isinstance(value, datetime | date | time | timedelta):
        return Cell("time", str(value), str(value))
    text = " ".join(str(value).split())
    return Cell("text", text, str(value)) if text else EMPTY


def number_text(value: float, number_format: str) -> str:
    """Return a number of a cell as text: the value stored, with the trailing zeros that the cell shows.

    Parameters
    ----------
    value : float
        The number; 15 digits of it count.
    number_format : str
        Format of the cell, as ``0.00`` (ISO/IEC 29500-1, 18.8.31).

    Examples
    --------
    >>> number_text(12.5, "0.00"), number_text(12.5, "General"), number_text(12.345, "0.0")
    ('12.50', '12.5', '12.345')
    """
    exact = Decimal(f"{value:.{_DIGITS}g}")
    text = f"{exact:f}" if -20 < exact.adjusted() < _DIGITS else f"{exact:e}"
    shown = _FORMAT.fullmatch(_LITERAL.sub("", number_format.partition(";")[0]).strip())
    if shown is None:
        return text
    places = len(shown["decimals"] or "")
    as_shown = f"{exact:.{places}{'e' if shown['exponent'] else 'f'}}"
    return as_shown if Decimal(as_shown) == exact else text


def cell_name(title: str, row: int, column: int) -> str:
    """Return the name of a cell as formulas write it; columns count from 0.

    Examples
    --------
    >>> cell_name("Sheet1", 7, 1), cell_name("My sheet", 1, 27)
    ('Sheet1!B7', "'My sheet'!AB1")
    """
    letters = ""
    column += 1
    while column:
        column, letter = divmod(column - 1, 26)
        letters = chr(ord("A") + letter) + letters
    plain = re.fullmatch(r"\w+", title)
    return f"{title if plain else _in_quotes(title)}!{letters}{row}"


def _in_quotes(title: str) -> str:
    doubled = title.replace("'", "''")
    return f"'{doubled}'"


def titles(sheets: Sequence[Sheet]) -> str:
    """Return the names of sheets for a message."""
    return ", ".join(sheet.title for sheet in sheets)
