"""Objects in notebooks: small tables as HTML."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

#: A longer table is cut off.
_MOST_ROWS = 50


def html_table(columns: Sequence[str], rows: Iterable[Sequence[str]], caption: str = "") -> str:
    """Return a table as HTML; all texts are escaped, rows beyond 50 left out."""
    shown = list(rows)
    left_out = len(shown) - _MOST_ROWS
    head = "".join(f"<th>{escape(column)}</th>" for column in columns)
    body = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in shown[:_MOST_ROWS])
    title = f"<caption>{escape(caption)}</caption>" if caption else ""
    more = f"<p>{left_out} more rows</p>" if left_out > 0 else ""
    return f"<table>{title}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{more}"


def number(value: float) -> str:
    """Return a number in four significant digits."""
    return f"{value:.4g}"
