"""Sheets of any length as an Office Open XML workbook, written row by row."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from io import BytesIO
from pathlib import Path
from typing import TypeAlias
from xml.sax.saxutils import escape

from .digits import printable
from .workbook import ZIP_TIME, Cell, Sheet, workbook

#: Rows below the head, and columns beside the first, that a sheet can have (limits of Excel and of LibreOffice).
MOST_ROWS, MOST_COLUMNS = 2**20 - 1, 2**14 - 1

#: A cell as it is written: text stays text, nan and None are empty cells.
LongCell: TypeAlias = float | int | str | None

#: Rows put together before they are compressed.
_ROWS_AT_ONCE = 200

#: No number takes more bytes than this with its marks, and no text of a head on average.
_BYTES_OF_CELL = 64

_CELL_STYLE = re.compile(r'<c r="[A-Z]+([12])"(?: s="(\d+)")?')


@dataclass(frozen=True)
class LongSheet:
    """A sheet whose rows are made while they are written.

    Parameters
    ----------
    title : str
        Its name.
    header : sequence of str
        Heads of the columns, with units.
    pattern : sequence of (str, Number or None)
        One cell a column: kind, decimals and width of what the column holds. Columns beyond are as the last one.
    rows : iterable of sequences of (float, int, str or None)
        Taken once, and not kept.
    n_rows : int
        How many there are.
    matrix : bool
        Whether the first column holds heads, too, and all others probabilities, which get colours.
    """

    title: str
    header: Sequence[str]
    pattern: Sequence[Cell]
    rows: Iterable[Sequence[LongCell]]
    n_rows: int
    matrix: bool = False


def write_long_workbook(path: Path, sheets: Sequence[LongSheet | Sheet], title: str, time: datetime) -> None:
    """Write a workbook that looks as those of `workbook`; memory does not grow with the number of rows.

    openpyxl makes a workbook with one row a sheet, and with it all styles; the rows are written here as it writes
    them, which takes a tenth of the time.

    Parameters
    ----------
    path : Path
        Written as it goes: give a temporary name and rename.
    sheets : sequence of LongSheet or Sheet
        No longer or wider than a sheet can be.
    title : str
        For the file's properties.
    time : datetime
        Time of the content, with time zone, for the file's properties.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    skeleton = workbook([_short(sheet) if isinstance(sheet, LongSheet) else sheet for sheet in sheets], title, time)
    pages = {
        f"xl/worksheets/sheet{number}.xml": sheet
        for number, sheet in enumerate(sheets, start=1)
        if isinstance(sheet, LongSheet)
    }
    with zipfile.ZipFile(BytesIO(skeleton)) as old, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as new:
        for name in old.namelist():
            entry = zipfile.ZipInfo(name, ZIP_TIME)
            entry.compress_type = zipfile.ZIP_DEFLATED
            if name not in pages:
                new.writestr(entry, old.read(name))
                continue
            # Excel opens a file with the extension for more than 2 GiB only after a word about repairing it.
            size = (pages[name].n_rows + 1) * len(pages[name].header) * _BYTES_OF_CELL
            with new.open(entry, "w", force_zip64=size > zipfile.ZIP64_LIMIT) as file:
                for text in _page(old.read(name).decode(), pages[name]):
                    file.write(text.encode())


def _short(sheet: LongSheet) -> Sheet:
    """Return the sheet with its pattern as only row; an empty cell would get no style."""
    pattern = ["" if cell is None else cell for cell in sheet.pattern]
    return Sheet(sheet.title, sheet.header[: len(pattern)], [pattern], sheet.matrix)


def _page(short: str, sheet: LongSheet) -> Iterator[str]:
    """Return a sheet's XML in parts, made of that with one row."""
    before, rest = short.split("<sheetData>")
    rows, after = rest.split("</sheetData>")
    styles: dict[str, list[str]] = {"1": [], "2": []}
    for row, style in _CELL_STYLE.findall(rows):
        styles[row].append(style or "0")
    n_columns, n_patterns = len(sheet.header), len(sheet.pattern)
    heads, cells = (of_row + of_row[-1:] * (n_columns - n_patterns) for of_row in (styles["1"], styles["2"]))
    last = f"{_letters(n_columns)}{sheet.n_rows + 1}"
    # On one page across, hundreds of columns could not be read.
    before = before.replace('fitToPage="1"', 'fitToPage="0"')
    yield re.sub(r'(<dimension ref="A1:)\w+"', rf'\g<1>{last}"', before).replace(
        f'max="{n_patterns}"', f'max="{n_columns}"'
    )
    height = re.search(r'<row r="1"[^>]*?( ht="[^"]*" customHeight="1")', rows)
    yield f"<sheetData><row{height.group(1) if height else ''}>"
    yield "".join(map(_text, heads, sheet.header))
    yield "</row>"
    buffer = []
    for values in sheet.rows:
        buffer.append(_row(cells, values))
        if len(buffer) == _ROWS_AT_ONCE:
            yield "".join(buffer)
            buffer.clear()
    yield "".join(buffer)
    yield "</sheetData>" + re.sub(r'sqref="B2[^"]*"', f'sqref="B2:{last}"', after)


def _row(styles: Sequence[str], values: Sequence[LongCell]) -> str:
    parts = ["<row>"]
    for style, value in zip(styles, values, strict=True):
        if isinstance(value, str):
            parts.append(_text(style, value) if value else "<c/>")
        elif value is None or value - value != 0:  # nan or infinite
            parts.append("<c/>")
        else:
            parts.append(f'<c s="{style}"><v>{value!r}</v></c>')
    parts.append("</row>")
    return "".join(parts)


def _text(style: str, text: str) -> str:
    return f'<c s="{style}" t="inlineStr"><is><t xml:space="preserve">{escape(printable(text))}</t></is></c>'


def _letters(column: int) -> str:
    from openpyxl.utils import get_column_letter

    return str(get_column_letter(column))


def continued(title: str, number: int, total: int) -> str:
    """Return the name of a sheet that is continued on further ones: "Frames", or "Frames (2 of 3)"."""
    return title if total == 1 else f"{title} ({number} of {total})"


def pieces(total: int, most: int) -> list[range]:
    """Cut a number of rows or columns into ranges that each fit a sheet."""
    return [range(start, min(start + most, total)) for start in range(0, total, most)]
