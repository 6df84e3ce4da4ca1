"""A document of sections, each of text, tables and figures: what a page is made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from .facts import Fact
from .figures import ReportFigure
from .tables import Table


@dataclass(frozen=True)
class Section:
    """A part of a document; what is empty is left out.

    Parameters
    ----------
    title : str
        Its heading.
    paragraphs : sequence of str
        Text.
    tables : sequence of (str, Table)
        Captions and tables.
    figures : sequence of ReportFigure
        Pictures with captions.
    facts : sequence of Fact
        Named values.
    pages : sequence of (str, str)
        Names of other pages, and where they are, relative to this one.
    text : str
        Text that keeps its lines.
    """

    title: str = ""
    paragraphs: Sequence[str] = field(default=())
    tables: Sequence[tuple[str, Table]] = field(default=())
    figures: Sequence[ReportFigure] = field(default=())
    facts: Sequence[Fact] = field(default=())
    pages: Sequence[tuple[str, str]] = field(default=())
    text: str = ""


@dataclass(frozen=True)
class Document:
    """A document.

    Parameters
    ----------
    kind, title : str
        What sort of document it is, and its title.
    banner : str
        What a reader must not overlook; may be empty.
    warnings : sequence of str
        What to mind.
    sections : sequence of Section
        Its parts.
    """

    kind: str
    title: str
    banner: str
    warnings: Sequence[str]
    sections: Sequence[Section]
