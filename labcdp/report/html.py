"""Pages and certificates as self-contained HTML files."""

from __future__ import annotations

import os
from base64 import b64encode
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote_from_bytes

from ..core.table import Table
from .layout import Block, Page, Script, Verbatim
from .text import finding_lines, is_number, printable, text_table

if TYPE_CHECKING:
    from bokeh.models import LayoutDOM
    from jinja2 import Environment


#: How pages of labcdp are recognised.
GENERATOR = '<meta name="generator" content="labcdp">'
#: Rows of a table that a page shows; the spreadsheet has all.
_MOST_ROWS = 2000


def render_page(page: Page, template: str = "page.html", **more: Any) -> str:
    """Return a page as HTML 5 with embedded figures and style; all text is escaped, scripts are allowed only if used.

    Parameters
    ----------
    page : Page
        The page.
    template : str
        Its template; for A4 ``certificate.html``, with identification and picture side by side as the lead.
    **more
        What else the template shows: of a certificate ``number``, printed on each page, ``dates``, named texts, and
        whether it is ``compact``, to stand on one sheet.
    """
    lines = finding_lines(page.findings, sentences=True)
    severe = [(severity, text) for severity, text in lines if severity != "info"]
    notes = [text for severity, text in lines if severity == "info"]
    scripts = any(isinstance(block, Script) for block in page.blocks)
    shown = {"page": page, "version": version("labcdp"), "scripts": scripts, "severe": severe, "notes": notes}
    return environment().get_template(template).render(**shown, **more)


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
    environment.filters |= {
        "data_uri": lambda figure: f"data:image/png;base64,{b64encode(figure.png).decode()}",
        "block_kind": _block_kind,
        "cells": _cells,
        "lines": lines,
        # As browsers ask for names of files, which may be no UTF-8.
        "urlencode": lambda path: quote_from_bytes(os.fsencode(str(path))),
    }
    return environment


def _block_kind(block: Block) -> str:
    """Return the template name of a block; a table of named values is drawn as a list."""
    if isinstance(block, str):
        return "paragraph"
    return "facts" if isinstance(block, Table) and [*block.data] == ["item", "value"] else type(block).__name__


def _cells(table: Table) -> dict[str, Any]:
    """Return a table for the template; a long one is truncated."""
    shown = [column for column in table.columns if column.shown]
    heads, rows = text_table(table if len(table) <= _MOST_ROWS else table.select(range(_MOST_ROWS)))
    return {
        "heads": [
            {"text": head, "meaning": column.meaning, "number": is_number(table[column.name])}
            for head, column in zip(heads, shown, strict=True)
        ],
        "rows": rows,
        "left_out": max(0, len(table) - _MOST_ROWS),
    }


def interactive(figure: LayoutDOM) -> Script:
    """Return a figure, or several, with BokehJS (1.3 to 1.7 MB) embedded.

    Parameters
    ----------
    figure : bokeh.models.LayoutDOM
        A figure, or a layout of figures and widgets.
    """
    from bokeh.embed import components
    from bokeh.models import Widget
    from bokeh.resources import Resources

    parts = ["bokeh", "bokeh-widgets"] if any(isinstance(model, Widget) for model in figure.references()) else ["bokeh"]
    script, element = components(figure)
    return Script("\n".join((Resources("inline", components=parts).render_js(), element, script)))
