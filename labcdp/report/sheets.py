"""Tables as an Office Open XML workbook, written row by row in constant memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from functools import cache
from io import BytesIO
from itertools import chain, islice
from math import ceil, isfinite
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from ..core.disk.text import numbered
from ..core.errors import InputError
from ..core.result import Result
from ..core.table import Column, Table
from .text import cell_decimals, finding_text, is_number, printable

if TYPE_CHECKING:
    from xlsxwriter import Workbook

#: Most rows below the head, columns, and characters of a cell (limits of Excel and LibreOffice).
MOST_ROWS, MOST_COLUMNS, MOST_CHARACTERS = 2**20 - 1, 2**14, 32767
#: Excel's number of the paper.
_A4 = 9
#: Longest name of a sheet, and characters not allowed in it.
_LONGEST_NAME, _FORBIDDEN = 31, str.maketrans(dict.fromkeys("[]:*?/\\", "-"))
#: Least and greatest width of columns in characters; wider text is wrapped.
_NARROWEST, _WIDEST = 9, 60
#: Width in characters that stays readable on a landscape A4 page; wider tables are printed on several side by side.
_PAGE_WIDTH = 190
#: Decimals from which a number is shown with an exponent.
_MOST_DECIMALS = 9
#: How values are to be read, on the sheet of meanings and below each printed page.
_CONVENTION = "Values are in the unit of their head: 37 under (%) is 37 %, which JSON and NetCDF hold as 0.37."
#: Number of rows examined to find type and width of a column.
_FIRST_ROWS = 200
#: Colours of a probability of 0, 0.5 and 1, light enough for black numbers, and distinguishable by colour-blind
#: readers.
_SCALE = ("#F5B895", "#FFFFFF", "#8FC3E8")


def result_workbook(result: Result, time: datetime) -> bytes:
    """Return a workbook of a result: a sheet for each table, one for the findings, and one that explains all columns.

    Parameters
    ----------
    result : Result
        The result to write.
    time : datetime
        Time of the content, with time zone, for the file's properties.

    Raises
    ------
    InputError
        If a table is wider than a sheet can be.
    """
    file = BytesIO()
    write_result(file, result, time)
    return file.getvalue()


def write_result(file: Path | IO[bytes], result: Result, time: datetime, others: Sequence[Table] = ()) -> None:
    """Write the tables of a result as sheets, with others; a table longer than a sheet is continued in the next one.

    Equal results and times give equal bytes. Text stays text, even if it looks like a formula.

    Parameters
    ----------
    file : Path or binary file
        Written incrementally: give a temporary name and rename.
    result, time
        As for `result_workbook`.
    others : sequence of Table
        Further tables.

    Raises
    ------
    InputError
        If a table is wider than a sheet can be.
    OSError
        If the file cannot be written.
    """
    from xlsxwriter import Workbook
    from xlsxwriter.exceptions import FileCreateError

    tables = [*result.tables, *others, *_appendix(result, others)]
    for table in tables:
        if len(table.columns) > MOST_COLUMNS:
            raise InputError(
                f"table {table.name!r} has {len(table.columns)} columns, and a sheet holds {MOST_COLUMNS}: "
                "use NetCDF or JSON"
            )
    target = str(file) if isinstance(file, Path) else file
    options = {"constant_memory": True, "nan_inf_to_errors": False, "strings_to_formulas": False}
    try:
        with Workbook(target, {**options, "strings_to_urls": False, "strings_to_numbers": False}) as book:
            title, created = printable(f"{result.title}: {result.kind}"), time.astimezone(UTC).replace(tzinfo=None)
            book.set_properties({"title": title, "author": "labcdp", "created": created})
            # Each format is made once.
            formats = cache(lambda **properties: book.add_format({"valign": "top", **properties}))
            names: set[str] = set()
            for table in tables:
                rows: Iterator[Mapping[str, Any]] | None = table.rows()
                while rows is not None:
                    rows = _write_sheet(book, formats, _sheet_name(table.name, names), table, rows)
    except FileCreateError as error:
        raise OSError(f"{file}: {error}") from error


def _write_sheet(
    book: Workbook, formats: Callable[..., Any], name: str, table: Table, rows: Iterator[Mapping[str, Any]]
) -> Iterator[Mapping[str, Any]] | None:
    """Write as many rows as a sheet holds; return the remaining rows, or None."""
    sheet = book.add_worksheet(name)
    first = list(islice(rows, _FIRST_ROWS))
    rows = chain(first, rows)
    sheet.freeze_panes(1, 1 if table.matrix else 0)
    sheet.repeat_rows(0)
    sheet.set_landscape()
    sheet.set_paper(_A4)
    sheet.set_margins(left=0.4, right=0.4, top=0.7, bottom=0.7)
    sheet.set_header("&L&A&R&P / &N")
    sheet.set_footer(f"&L&8{_CONVENTION}")
    columns = [[row[column.name] for row in first] for column in table.columns]
    widths = [_width(column, cells) for column, cells in zip(table.columns, columns, strict=True)]
    n_pages = ceil(sum(widths) / _PAGE_WIDTH)
    if not table.matrix:
        sheet.fit_to_pages(n_pages, 0)
    if table.matrix or n_pages > 1:
        # What a row is of stands on each of the pages.
        sheet.repeat_columns(0)
    for index, (column, cells, width) in enumerate(zip(table.columns, columns, widths, strict=True)):
        sheet.set_column(index, index, width)
        side = "right" if is_number(cells) else "left"
        head = formats(bold=True, text_wrap=True, valign="bottom", align=side)
        sheet.write_string(0, index, printable(column.head), head)
    text = formats(text_wrap=True, align="left")
    n_rows = 0
    for n_rows, values in enumerate(islice(rows, MOST_ROWS), start=1):
        for index, column in enumerate(table.columns):
            value = values[column.name]
            if isinstance(value, str):
                if value:
                    sheet.write_string(n_rows, index, printable(value)[:MOST_CHARACTERS], text)
            elif isinstance(value, bool):
                sheet.write_string(n_rows, index, "yes" if value else "no", text)
            elif value is not None and isfinite(value):
                # 7, and not the 7.000000000000001 that 100 times 0.07 is.
                value = float(f"{100 * value:.15g}") if column.unit_in(values) == "%" else value
                n = max(cell_decimals(column, values), 0)
                shown = f"{0:.{n}f}" if n <= _MOST_DECIMALS else "0.00E+00"
                if bound := values.get(column.bound):
                    shown = f'"{bound} "{shown}'
                sheet.write_number(n_rows, index, value, formats(num_format=shown, align="right"))
    if table.matrix and n_rows:
        rule: dict[str, Any] = {"type": "3_color_scale"}
        for end, value, colour in zip(("min", "mid", "max"), (0, 0.5, 1), _SCALE, strict=True):
            rule |= {f"{end}_type": "num", f"{end}_value": value, f"{end}_color": colour}
        sheet.conditional_format(1, 1, n_rows, len(table.columns) - 1, rule)
    following = next(rows, None) if n_rows == MOST_ROWS else None
    return None if following is None else chain([following], rows)


def _width(column: Column, values: Sequence[Any]) -> float:
    widest = max((len(value) for value in values if isinstance(value, str)), default=0)
    words = max(len(word) for word in column.head.split() or [""])
    return min(max(widest, words, min(len(column.head), 14), _NARROWEST), _WIDEST) + 2


def _sheet_name(name: str, taken: set[str]) -> str:
    """Return a unique sheet name; names are case-insensitive."""
    base = printable(name).translate(_FORBIDDEN).strip("'") or "sheet"
    names = (base[: _LONGEST_NAME - len(ending)] + ending for ending in numbered(" ({})"))
    unused = next(name for name in names if name.lower() not in taken)
    taken.add(unused.lower())
    return unused


def _appendix(result: Result, others: Sequence[Table]) -> Iterator[Table]:
    """Yield the tables of findings and of column descriptions."""
    severity, subject = Column("severity", "severity"), Column("subject", "subject")
    if result.findings:
        text = Column("text", "finding", value=finding_text)
        yield Table.of_items("findings", "Findings", (severity, subject, text), result.findings)
    columns = (Column("table", "sheet"), Column("head", "column"), Column("key", "key"), Column("meaning", "meaning"))
    tables = [*result.tables, *others]
    rows = [
        {"table": table.name, "head": column.head, "key": column.name, "meaning": column.meaning}
        for table in tables
        for column in table.columns[: 1 if table.matrix else None]
    ]
    rows.insert(0, {"table": "", "head": "", "key": "", "meaning": _CONVENTION})
    rows += [
        {"table": "", "head": file.role, "key": file.path, "meaning": f"SHA-256 {file.sha256}"}
        for file in result.inputs
    ]
    yield Table.of_items("about", "About", columns, rows)
