"""Sheets of text and numbers as an Office Open XML workbook."""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from datetime import UTC, datetime
from io import BytesIO
from math import isfinite
from textwrap import wrap
from typing import Any, TypeAlias

from .digits import printable

#: Columns are as wide as their content, up to this many characters; longer text is wrapped.
_WIDEST_COLUMN = 60
_WIDEST_HEAD = 16

#: Width of the first column of a sheet of probabilities, whose head tells of both axes.
_CORNER_WIDTH = 30

#: Colours of a probability of 0, 0.5 and 1, light enough for black numbers, and told apart by colour-blind readers.
_SCALE = ("F5B895", "FFFFFF", "8FC3E8")

#: Height of a line in points.
_LINE_POINTS = 15.0

#: Time of all entries in the file, so that equal content is equal in every byte; the earliest a ZIP file can hold.
ZIP_TIME = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True)
class Number:
    """A number, and how many decimals of it are shown; the cell holds all of them.

    Parameters
    ----------
    value : float
        What the cell holds; the cell stays empty if it is not finite.
    n_decimals : int
        How many are shown.
    percent : bool
        Whether the cell shows a fraction in percent.
    """

    value: float
    n_decimals: int
    percent: bool = False


Cell: TypeAlias = str | Number | None


@dataclass(frozen=True)
class Sheet:
    """A sheet of a workbook.

    Parameters
    ----------
    title : str
        Its name.
    header : sequence of (str or Number)
        Heads of the columns, with units.
    rows : sequence of sequence of (str, Number or None)
        Cells; None stays empty.
    matrix : bool
        Whether the first column holds heads, too, and all others probabilities, which get colours.
    """

    title: str
    header: Sequence[str | Number]
    rows: Sequence[Sequence[Cell]]
    matrix: bool = False


def workbook(sheets: Sequence[Sheet], title: str, time: datetime) -> bytes:
    """Write a workbook; equal sheets, titles and times give equal bytes.

    Parameters
    ----------
    sheets : sequence of Sheet
        Text in them stays text, even if it looks like a formula.
    title : str
        For the file's properties.
    time : datetime
        Time of the content, with time zone, for the file's properties.

    Returns
    -------
    bytes
        Content of an .xlsx file.
    """
    from openpyxl import Workbook

    book = Workbook()
    book.remove(book.active)
    for sheet in sheets:
        _fill(book.create_sheet(sheet.title), sheet)
    book.properties.title = printable(title)
    book.properties.creator = "labcdp"
    book.properties.created = time.astimezone(UTC).replace(tzinfo=None)
    file = BytesIO()
    book.save(file)
    # Saving has set the time of modification to now.
    book.properties.modified = book.properties.created
    return _without_times(file.getvalue(), book.properties)


def _fill(page: Any, sheet: Sheet) -> None:
    from openpyxl.utils import get_column_letter

    widths = []
    for column, head in enumerate(sheet.header):
        widest = max([_width(row[column]) for row in sheet.rows], default=0)
        widest_head = _CORNER_WIDTH if sheet.matrix and not column else _WIDEST_HEAD
        widths.append(min(max(widest, min(_width(head), widest_head)), _WIDEST_COLUMN))
        page.column_dimensions[get_column_letter(column + 1)].width = widths[-1] + 3
        _write_head(page.cell(1, column + 1), head, any(isinstance(row[column], Number) for row in sheet.rows))
    _set_height(page, 1, sheet.header, widths)
    for row, cells in enumerate(sheet.rows, start=2):
        for column, content in enumerate(cells, start=1):
            _write(page.cell(row, column), content)
        _set_height(page, row, cells, widths)
    page.freeze_panes = "B2" if sheet.matrix else "A2"
    if sheet.matrix:
        _colour(page)
    page.print_title_rows = "1:1"
    page.page_setup.orientation = "landscape"
    page.page_setup.fitToHeight = 0
    page.sheet_properties.pageSetUpPr.fitToPage = True


def _colour(page: Any) -> None:
    """Colour all cells but the heads by their value, from 0 to 1."""
    from openpyxl.formatting.rule import ColorScaleRule
    from openpyxl.utils import get_column_letter

    stops: dict[str, Any] = {}
    for stop, value, colour in zip(("start", "mid", "end"), (0, 0.5, 1), _SCALE, strict=True):
        stops |= {f"{stop}_type": "num", f"{stop}_value": value, f"{stop}_color": colour}
    last = f"{get_column_letter(page.max_column)}{page.max_row}"
    page.conditional_formatting.add(f"B2:{last}", ColorScaleRule(**stops))


def _write_head(cell: Any, head: str | Number, numeric: bool) -> None:
    _write(cell, head)
    font = copy(cell.font)
    font.bold = True
    cell.font = font
    alignment = copy(cell.alignment)
    alignment.horizontal = "right" if numeric else "left"
    alignment.indent = 0 if numeric else alignment.indent
    alignment.vertical = "bottom"
    cell.alignment = alignment


def _write(cell: Any, content: Cell) -> None:
    from openpyxl.styles import Alignment

    if isinstance(content, Number):
        if isfinite(content.value):
            cell.value = float(content.value)
            shown = "0" if content.n_decimals <= 0 else f"0.{'0' * content.n_decimals}"
            cell.number_format = f"{shown}%" if content.percent else shown
            cell.alignment = Alignment(vertical="top")
    elif content is not None:
        cell.value = printable(content)
        # Text that begins with = would become a formula, and be run by who opens the file.
        cell.data_type = "s"
        cell.quotePrefix = True
        # Indented, so that it does not touch a number to the left of it.
        indent = 0 if cell.column == 1 else 1
        cell.alignment = Alignment(horizontal="left", vertical="top", indent=indent, wrap_text=True)


def _width(content: Cell) -> int:
    if isinstance(content, Number):
        kind = "%" if content.percent else "f"
        return len(f"{content.value:.{max(content.n_decimals, 0)}{kind}}")
    return len(content or "")


def _set_height(page: Any, row: int, cells: Sequence[Cell], widths: Sequence[int]) -> None:
    """Make room for wrapped text; not every program does so by itself."""
    lines = max(
        len(wrap(cell, width)) if isinstance(cell, str) else 1 for cell, width in zip(cells, widths, strict=True)
    )
    if lines > 1:
        page.row_dimensions[row].height = _LINE_POINTS * lines


def _without_times(data: bytes, properties: Any) -> bytes:
    """Write the ZIP file anew, with the properties given and no time of its making."""
    from openpyxl.xml.functions import tostring

    file = BytesIO()
    with zipfile.ZipFile(BytesIO(data)) as old, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as new:
        for name in old.namelist():
            content = tostring(properties.to_tree()) if name == "docProps/core.xml" else old.read(name)
            entry = zipfile.ZipInfo(name, ZIP_TIME)
            entry.compress_type = zipfile.ZIP_DEFLATED
            new.writestr(entry, content)
    return file.getvalue()
