"""Tables and text of pages as HTML; text of files and names is escaped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from ..report.text import printable

#: Text of a cell, alone or with its class.
Cell = str | tuple[str, str]


def text(words: str) -> str:
    """Escape text."""
    return escape(printable(words), quote=True)


def row(head: str, cells: Sequence[Cell], attributes: str = "") -> str:
    """Return a row of a table; its head is HTML, its cells are text."""
    pairs = (cell if isinstance(cell, tuple) else (cell, "") for cell in cells)
    body = "".join(
        f"<td class='{kind}'>{text(words)}</td>" if kind else f"<td>{text(words)}</td>" for words, kind in pairs
    )
    return f"<tr{attributes}><th scope='row'>{head}</th>{body}</tr>"


def region_row(name: str, head: str, cells: Sequence[Cell], chosen: bool) -> str:
    """Return a row that selects a region when it is clicked."""
    return row(head, cells, f"{' class=chosen' if chosen else ''} data-region='{text(name)}'")


def table(heads: Iterable[str], rows: Iterable[str], kind: str = "") -> str:
    """Return a table of rows."""
    head = "".join(f"<th scope='col'>{text(one)}</th>" for one in heads)
    return f"<table class='{kind}'><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def items(lines: Iterable[str]) -> str:
    """Return a list, empty for no lines."""
    found = "".join(f"<li>{text(line)}</li>" for line in lines)
    return f"<ul>{found}</ul>" if found else ""
