"""Pages as self-contained HTML files."""

from __future__ import annotations

from base64 import b64encode
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.finding import Finding, unique
from ..core.table import Table
from .cells import is_number, text_table
from .digits import printable
from .figure import ReportFigure
from .findings import finding_text
from .layout import Block, Page, Script, Verbatim

if TYPE_CHECKING:
    from jinja2 import Environment

#: Rows of a table that a page shows; the spreadsheet has all.
_MOST_ROWS = 2000


def render_page(page: Page) -> str:
    """Return a page as HTML 5 with embedded figures and style; all text is escaped, scripts are allowed only if used.

    Parameters
    ----------
    page : Page
        The page.
    """
    blocks = [*page.lead, *(block for section in page.sections for block in section.blocks)]
    severe = [finding for finding in unique(page.findings) if finding.severity != "info"]
    return (
        environment()
        .get_template("page.html")
        .render(
            page=page,
            version=version("labcdp"),
            scripts=any(isinstance(block, Script) for block in blocks),
            severe=[(finding.severity, _sentence(finding)) for finding in severe],
            notes=[_sentence(finding) for finding in unique(page.findings) if finding.severity == "info"],
        )
    )


def _sentence(finding: Finding) -> str:
    text = finding_text(finding)
    return text[:1].upper() + text[1:]


@cache
def environment() -> Environment:
    """Return the templates of pages; all text is escaped and printable."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from markupsafe import Markup, escape

    def plain(value: Any) -> Any:
        """Replace unprintable characters in all text."""
        return printable(value) if type(value) is str else value

    def lines(block: Verbatim) -> Markup:
        return Markup("\n").join(escape(printable(line)) for line in block.text.splitlines())

    environment = Environment(
        loader=FileSystemLoader(Path(__file__).with_name("templates")),
        autoescape=True,
        finalize=plain,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"data_uri": _data_uri, "block_kind": _block_kind, "cells": _cells, "lines": lines}
    return environment


def _data_uri(figure: ReportFigure) -> str:
    return f"data:image/png;base64,{b64encode(figure.png).decode()}"


def _block_kind(block: Block) -> str:
    return "paragraph" if isinstance(block, str) else type(block).__name__


def _cells(table: Table) -> dict[str, Any]:
    """Return a table for the template; a long one is truncated."""
    shown = [column for column in table.columns if column.shown]
    heads, rows = text_table(table.select(range(min(len(table), _MOST_ROWS))))
    return {
        "heads": [
            {"text": head, "meaning": column.meaning, "number": is_number(table[column.name])}
            for head, column in zip(heads, shown, strict=True)
        ],
        "rows": rows,
        "left_out": max(0, len(table) - _MOST_ROWS),
    }
