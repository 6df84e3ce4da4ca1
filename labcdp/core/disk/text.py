"""Text on disk: results as JSON, TOML as a person would write it, and CSV with comma, semicolon or tab."""

from __future__ import annotations

import csv
import json
import re
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import date
from itertools import chain, count
from math import isfinite
from typing import Any

from ..errors import InputError, encodable, printable
from .files import AnyPath, quoted, read_bytes, reason


def results_json(values: Any) -> str:
    """Write values as JSON; see `json_values`."""
    return json.dumps(json_values(values), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def json_values(values: Any) -> Any:
    """Return what JSON can hold: no types of NumPy; infinity and nan become null, anything unknown its text.

    Texts are such as UTF-8 can encode.
    """
    if isinstance(values, Mapping):
        return {encodable(str(key)): json_values(value) for key, value in values.items()}
    if isinstance(values, list | tuple):
        return [json_values(value) for value in values]
    if hasattr(values, "tolist"):
        return json_values(values.tolist())
    if isinstance(values, float) and not isfinite(values):
        return None
    return values if isinstance(values, int | float | bool) or values is None else encodable(str(values))


_BARE_KEY = re.compile("[A-Za-z0-9_-]+")


def toml_text(document: Mapping[str, Any], comments: Mapping[tuple[str, str], str] | None = None) -> str:
    """Write nested tables of text, numbers, truth values, dates and lists as TOML.

    tomli_w puts each number of a list on a line of its own and short tables in braces, which makes a session's
    configuration hard to read; hence this writer.

    Parameters
    ----------
    document : mapping
        The tables.
    comments : mapping of (str, str) to str
        Comments behind values, by the path of their table and their key.

    Raises
    ------
    TypeError
        For a value of another type.
    """
    return "\n".join(_table(document, "", comments or {})).lstrip("\n") + "\n"


def _table(document: Mapping[str, Any], path: str, comments: Mapping[tuple[str, str], str]) -> list[str]:
    """Return the lines of a table and those in it; `path` ends with a dot, or is empty."""
    lines = []
    for key, value in document.items():
        if not _is_table(value):
            comment = comments.get((path[:-1], key))
            lines.append(f"{_key(key)} = {_value(value)}" + (f"  # {printable(comment)}" if comment else ""))
    for key, value in document.items():
        if isinstance(value, Mapping):
            lines += ["", f"[{path}{_key(key)}]", *_table(value, f"{path}{_key(key)}.", comments)]
        elif _is_table(value):
            for item in value:
                lines += ["", f"[[{path}{_key(key)}]]", *_table(item, f"{path}{_key(key)}.", comments)]
    return lines


def _key(key: str) -> str:
    return key if _BARE_KEY.fullmatch(key) else _value(key)


def _is_table(value: object) -> bool:
    if isinstance(value, list | tuple):
        return bool(value) and all(isinstance(item, Mapping) for item in value)
    return isinstance(value, Mapping)


def _value(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        # JSON's escapes are TOML's too; TOML also wants DEL escaped.
        return json.dumps(encodable(value), ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, date):
        return value.isoformat()
    if isinstance(value, list | tuple):
        return f"[{', '.join(_value(item) for item in value)}]"
    raise TypeError(f"TOML has no value for {type(value).__name__}")


#: First line that states the separator of a CSV file.
_SEPARATOR = re.compile('"?sep=([,;\t])"?', re.IGNORECASE)
_LINE_END = re.compile("\r\n|\r|\n")
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
    """Read a CSV file with a header; semicolon or tab separate if the header has one, else comma.

    The text is UTF-8, or UTF-16 with a byte order mark, as Excel saves "Unicode text". A first line such as ``sep=;``,
    as Excel knows it, states the separator.

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
    if data.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
        raise InputError(f"{path} is a spreadsheet or an archive, not text: save it as CSV in UTF-8")
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
        raise InputError(f"{path}, line {reader.line_num}: {error}") from error
    except csv.Error as error:
        raise InputError(f"{path}, line {reader.line_num}: {reason(error)}") from error


def numbered(pattern: str) -> Iterator[str]:
    """Yield endings that make equal names differ: none, then the pattern with 2, 3 and so on."""
    return chain([""], map(pattern.format, count(2)))
