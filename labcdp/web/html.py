"""Text, tables and layout of pages: a picture with tabs beside it, or below it on narrow screens; text is escaped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from importlib.resources import files
from typing import Any

import panel as pn
from bokeh.plotting import figure

from ..report.text import printable

#: Text of a cell, alone or with its class.
Cell = str | tuple[str, str]


def text(words: str) -> str:
    """Escape text."""
    return escape(printable(words), quote=True)


def table_row(head: str, cells: Sequence[Cell], attributes: str = "") -> str:
    """Return a row of a table; its head is HTML, its cells are text."""
    pairs = (cell if isinstance(cell, tuple) else (cell, "") for cell in cells)
    body = "".join(
        f"<td class='{kind}'>{text(words)}</td>" if kind else f"<td>{text(words)}</td>" for words, kind in pairs
    )
    return f"<tr{attributes}><th scope='row'>{head}</th>{body}</tr>"


def table(heads: Iterable[str], rows: Iterable[str], kind: str = "") -> str:
    """Return a table of rows."""
    head = "".join(f"<th scope='col'>{text(heading)}</th>" for heading in heads)
    return f"<table class='{kind}'><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def items(lines: Iterable[str]) -> str:
    """Return an HTML list of lines; empty text for none."""
    entries = "".join(f"<li>{text(line)}</li>" for line in lines)
    return f"<ul>{entries}</ul>" if entries else ""


#: Width of the tabs beside the picture.
SIDE_PX = 450
#: Screens up to this width have the tabs below the picture: tablets held upright, and phones.
_NARROW = "@media (max-width: 960px)"
#: Panel makes a layout as wide as its children ask for.
_FREE = ":host { min-width: 0 !important; }"
#: The theme changes the colours of everything but the picture; see themes.js.
TINTED = {"filter": "var(--tint, none)"}


def style() -> str:
    """Return the style of tables, cards and sentences."""
    names = ("page.css", "bench.css")
    return "".join(files("labcdp").joinpath(f"data/roi-page/{name}").read_text(encoding="utf-8") for name in names)


def row(*items: Any, **options: Any) -> Any:
    """Return a row that is broken where the screen is too narrow."""
    return pn.Row(*items, margin=options.pop("margin", 0), stylesheets=[":host { flex-wrap: wrap; }"], **options)


def column(*items: Any) -> Any:
    """Return the content of a tab, which scrolls where the screen is low."""
    width = f"{_FREE} :host {{ max-width: {SIDE_PX}px; }} {_NARROW} {{ :host {{ max-width: 100vw; }} }}"
    return pn.Column(*items, sizing_mode="stretch_both", scroll="y", margin=0, stylesheets=[width])


def small_plot(height: int, **options: Any) -> Any:
    """Return an empty plot of the width of a tab."""
    plot = figure(sizing_mode="stretch_width", height=height, toolbar_location=None, tools="", **options)
    # So close together that they would look like a bar.
    plot.yaxis.minor_tick_line_color = None
    return plot


def beside(picture: Any, side: Sequence[Any], *above: Any) -> Any:
    """Return the page: `above` the picture, and `side` at its right, or below it on narrow screens."""
    picture.stylesheets = [f"{_NARROW} {{ :host {{ flex: 0 0 48vh !important; width: 100%; }} }}"]
    pane = pn.pane.Bokeh(picture, sizing_mode="stretch_both", margin=0)
    side = pn.Column(
        *side,
        width=SIDE_PX,
        sizing_mode="stretch_height",
        margin=0,
        styles=TINTED,
        stylesheets=[f"{_FREE} {_NARROW} {{ :host {{ width: 100% !important; height: auto !important; }} }}"],
    )
    low = f"{_FREE} {_NARROW} {{ :host {{ flex: 0 0 auto !important; flex-direction: column !important; }} }}"
    both = pn.Row(pane, side, sizing_mode="stretch_both", min_height=380, margin=0, stylesheets=[low])
    scrolled = f"{_FREE} {_NARROW} {{ :host {{ overflow-y: auto; }} }}"
    return pn.Column(*above, both, sizing_mode="stretch_both", margin=0, stylesheets=[scrolled])
