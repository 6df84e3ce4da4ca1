"""Tables of text: CSV with comma, semicolon or tab."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass

from ..errors import InputError
from .files import AnyPath, name_of, read_bytes
from .quoting import quoted, reason

#: Size from which a table is refused, columns and rows.
_MOST_BYTES, _MOST_COLUMNS, _MOST_ROWS = 16 * 2**20, 1000, 200_000


@dataclass(frozen=True)
class CsvRow:
    """A row below the header.

    Parameters
    ----------
    line : int
        Its line in the file, the last one if it has several.
    cells : tuple of str
        As many as the header has, without spaces at their ends.
    raw : str
        The line as in the file.
    """

    line: int
    cells: tuple[str, ...]
    raw: str


@dataclass(frozen=True)
class CsvTable:
    """A table with a header.

    Parameters
    ----------
    header : tuple of str
        Names of the columns.
    rows : tuple of CsvRow
        Those that are not empty.
    separator : str
        Comma, semicolon or tab.
    data : bytes
        The file.
    """

    header: tuple[str, ...]
    rows: tuple[CsvRow, ...]
    separator: str
    data: bytes


def read_csv(path: AnyPath, what: str) -> CsvTable:
    """Read a CSV file of UTF-8 text with a header; semicolon or tab separate if the header has one, else comma.

    Parameters
    ----------
    path : path
        The file.
    what : str
        What to give instead, for messages.

    Raises
    ------
    InputError
        If it cannot be read, is no text or empty, or a row has more or fewer cells than the header; names the line.
    """
    data = read_bytes(path, what, _MOST_BYTES)
    try:
        lines = data.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as caught:
        raise InputError(
            f"{name_of(path)} is not UTF-8 text (byte {caught.start}): save it as CSV in UTF-8"
        ) from caught
    separator = next((one for one in ";\t" if lines and one in lines[0]), ",")
    rows = tuple(_rows(lines, separator, path))
    if not rows:
        raise InputError(f"{name_of(path)} is empty: give {what}")
    return CsvTable(rows[0].cells, rows[1:], separator, data)


def _rows(lines: list[str], separator: str, path: AnyPath) -> Iterator[CsvRow]:
    reader = csv.reader(lines, delimiter=separator, skipinitialspace=True, strict=True)
    width, n_rows = 0, 0
    try:
        for cells in reader:
            if not any(cell.strip() for cell in cells):
                continue
            width, n_rows = width or len(cells), n_rows + 1
            if width > _MOST_COLUMNS or n_rows > _MOST_ROWS:
                raise InputError(f"there are more than {_MOST_COLUMNS} columns or {_MOST_ROWS} rows: give fewer")
            if len(cells) != width:
                hint = "; a number with a decimal comma stands in quotes, or semicolons separate"
                raise InputError(
                    f"it has {len(cells)} cells, the header has {width}: {quoted(separator.join(cells))}"
                    f"{hint if separator == ',' else ''}"
                )
            yield CsvRow(reader.line_num, tuple(cell.strip() for cell in cells), lines[reader.line_num - 1])
    except InputError as error:
        raise InputError(f"{name_of(path)}, line {reader.line_num}: {error}") from error
    except csv.Error as error:
        raise InputError(f"{name_of(path)}, line {reader.line_num}: {reason(error)}") from error
