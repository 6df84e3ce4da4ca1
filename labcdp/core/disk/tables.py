"""Tables that people keep, as CSV with comma, semicolon or tab, or as a spreadsheet: one record for both."""

from __future__ import annotations

import csv
import re
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from ..errors import InputError
from .files import AnyPath, quoted, read_bytes, reason, shortened
from .spreadsheets import ARCHIVE, COMPOUND_FILE, EMPTY, CellKind, Sheet, cell_name, read_sheets, titles

#: First line that states the separator of a CSV file.
_SEPARATOR = re.compile('"?sep=([,;\t])"?', re.IGNORECASE)
_LINE_END = re.compile("\r\n|\r|\n")
#: Size from which a table is refused, columns and rows.
_MOST_BYTES, _MOST_COLUMNS, _MOST_ROWS = 16 * 2**20, 1000, 200_000
#: Name of a column with its unit, as ``luminance (cd/m²)``, ``Luminance [fL]`` and ``L in cd/m2``.
_WITH_UNIT = re.compile(r"(?P<quantity>[^(\[]+?)\s*(?:\((?P<a>[^()]*)\)|\[(?P<b>[^\[\]]*)\]|\sin\s(?P<c>\S.*))")


@dataclass(frozen=True)
class WrittenRow:
    """A row below the header.

    Parameters
    ----------
    number : int
        Its line in a text file, the last one if it has several; its row in a spreadsheet.
    cells : tuple of str
        As many as the header has, without spaces at their ends.
    raw : str
        The line as in the file; the values of a spreadsheet's cells, separated by tabs.
    sheet : str
        Name of the sheet; empty for a text file.
    first_column : int
        Column of the first cell in its sheet, from 0.
    kinds : tuple of CellKind
        What each cell of a spreadsheet holds; empty for a text file.
    """

    number: int
    cells: tuple[str, ...]
    raw: str
    sheet: str = ""
    first_column: int = 0
    kinds: tuple[CellKind, ...] = ()

    def place(self, column: int = 0) -> str:
        """Return where a cell is, for messages: its line, or its name in a spreadsheet."""
        if not self.sheet:
            return f"line {self.number}"
        return shortened(cell_name(self.sheet, self.number, self.first_column + column))

    def text(self, column: int) -> str:
        """Return a cell; raises InputError, without its place, if a spreadsheet has no value there."""
        kind = self.kinds[column] if self.kinds else "text"
        if kind == "unstored":
            raise InputError(
                "there is a formula whose value is not stored: save the file in a spreadsheet program, or put the value"
            )
        if kind == "error":
            raise InputError(f"the spreadsheet has the error {quoted(self.cells[column])} there: correct it")
        return self.cells[column]

    def number_text(self, column: int) -> str:
        """Return a cell that holds a number; raises as `text`, or if a spreadsheet has text or a date there."""
        text = self.text(column)
        if self.kinds and text and self.kinds[column] != "number":
            what = "a date or time" if self.kinds[column] == "time" else "text"
            raise InputError(f"{quoted(text)} is {what}, not a number: type the number, and its unit in the header")
        return text


@dataclass(frozen=True)
class WrittenTable:
    """A table with a header.

    Parameters
    ----------
    header : WrittenRow
        Names of the columns.
    rows : tuple of WrittenRow
        Those that are not empty.
    comma_is_decimal : bool
        Whether a comma in a number can only be a decimal comma, as another mark separates the cells.
    data : bytes
        The file.
    """

    header: WrittenRow
    rows: tuple[WrittenRow, ...]
    comma_is_decimal: bool
    data: bytes


def read_table(path: AnyPath, what: str, is_header: Callable[[Sequence[str]], bool]) -> WrittenTable:
    """Read a table with a header: a CSV file, or a spreadsheet (.xlsx).

    Text is UTF-8, or UTF-16 with a byte order mark, as Excel saves "Unicode text"; semicolon or tab separate if the
    header, which is the first line, has one, else comma. A first line such as ``sep=;``, as Excel knows it, states the
    separator. In a spreadsheet the header is the first row that is known as one, of the one sheet that has it; the
    columns are those of the header, from the first to the last name.

    Parameters
    ----------
    path : path
        The file; its content says which it is.
    what : str
        What to give instead, for messages.
    is_header : callable
        Whether cells of a row of a spreadsheet are the header.

    Raises
    ------
    InputError
        If it cannot be read, is empty, a row of text has more or fewer cells than the header, or not one sheet has a
        header; names line or sheet.
    """
    data = read_bytes(path, what, _MOST_BYTES)
    if data.startswith((ARCHIVE, COMPOUND_FILE)):
        return _of_sheet(data, path, what, is_header)
    try:
        text = data.decode("utf-16" if data.startswith((BOM_UTF16_LE, BOM_UTF16_BE)) else "utf-8-sig")
    except UnicodeDecodeError as caught:
        raise InputError(f"{path} is not UTF-8 text (byte {caught.start}): save it as CSV in UTF-8") from caught
    # Cells may hold what else str.splitlines takes as the end of a line, such as U+2028.
    lines = _LINE_END.split(text.rstrip("\r\n"))
    stated = _SEPARATOR.fullmatch(lines[0])
    if stated is not None:
        # An empty line is left out, and lines keep their numbers.
        lines[0] = ""
    separator = stated[1] if stated else next((mark for mark in ";\t" if mark in lines[0]), ",")
    rows = tuple(_rows(lines, separator, path))
    if not rows:
        raise InputError(f"{path} is empty: give {what}")
    return WrittenTable(rows[0], rows[1:], separator != ",", data)


def _rows(lines: list[str], separator: str, path: AnyPath) -> Iterator[WrittenRow]:
    reader = csv.reader(lines, delimiter=separator, skipinitialspace=True, strict=True)
    width, n_rows = 0, 0
    try:
        for cells in reader:
            if not any(cell.strip() for cell in cells):
                continue
            width, n_rows = width or len(cells), n_rows + 1
            _require_moderate(width, n_rows)
            if len(cells) != width:
                hint = "; a number with a decimal comma stands in quotes, or semicolons separate"
                raise InputError(
                    f"it has {len(cells)} cells, the header has {width}: {quoted(separator.join(cells))}"
                    f"{hint if separator == ',' else ''}"
                )
            yield WrittenRow(reader.line_num, tuple(cell.strip() for cell in cells), lines[reader.line_num - 1])
    except InputError as error:
        raise InputError(f"{path}, line {reader.line_num}: {error}") from error
    except csv.Error as error:
        raise InputError(f"{path}, line {reader.line_num}: {reason(error)}") from error


def _require_moderate(n_columns: int, n_rows: int) -> None:
    if n_columns > _MOST_COLUMNS or n_rows > _MOST_ROWS:
        raise InputError(f"there are more than {_MOST_COLUMNS} columns or {_MOST_ROWS} rows: give fewer")


def _of_sheet(data: bytes, path: AnyPath, what: str, is_header: Callable[[Sequence[str]], bool]) -> WrittenTable:
    sheets = read_sheets(data, path)
    with_header = [table for sheet in sheets if (table := _table(sheet, is_header))]
    if len(with_header) > 1:
        names = shortened(", ".join(rows[0].sheet for rows in with_header))
        raise InputError(f"{path} has several sheets with such a table ({names}): keep one of them, of {what}")
    if not with_header:
        raise InputError(f"{path} has no such table in its sheets ({shortened(titles(sheets))}): give {what}")
    header, *rows = with_header[0]
    try:
        _require_moderate(len(header.cells), len(rows))
    except InputError as error:
        raise InputError(f"{path}, {header.place()}: {error}") from error
    return WrittenTable(header, tuple(rows), True, data)


def _table(sheet: Sheet, is_header: Callable[[Sequence[str]], bool]) -> list[WrittenRow]:
    """Return header and rows of a sheet, or nothing if it has no header."""
    rows: list[WrittenRow] = []
    columns = slice(0)
    for number, cells in sheet.rows:
        if not rows:
            named = [at for at, cell in enumerate(cells) if cell.text]
            columns = slice(named[0], named[-1] + 1) if named else slice(0)
            if not is_header([cell.text for cell in cells[columns]]):
                continue
        width = columns.stop - columns.start
        part = (*cells[columns], *[EMPTY] * (width - len(cells[columns])))
        if all(cell.kind == "empty" for cell in part):
            continue
        texts, kinds = tuple(cell.text for cell in part), tuple(cell.kind for cell in part)
        raw = "\t".join(cell.raw for cell in part)
        rows.append(WrittenRow(number, texts, raw, sheet.title, columns.start, kinds))
    return rows


def quantity_and_unit(name: str) -> tuple[str, str | None]:
    """Return quantity, in small letters, and unit of the name of a column; None if it names no unit.

    Examples
    --------
    >>> quantity_and_unit("Luminance (cd/m²)"), quantity_and_unit("L in fL"), quantity_and_unit("patch")
    (('luminance', 'cd/m²'), ('l', 'fL'), ('patch', None))
    """
    name = " ".join(name.split())
    parts = _WITH_UNIT.fullmatch(name)
    if parts is None:
        return name.lower(), None
    unit = next(part for part in (parts["a"], parts["b"], parts["c"]) if part is not None)
    return parts["quantity"].lower(), unit.strip()
