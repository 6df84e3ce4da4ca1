"""What command info says of files that labcdp wrote: results, workbooks, pages, journals and lists of files."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import unescape
from io import BytesIO
from pathlib import Path

from ..core.disk import read_bytes
from ..core.disk.files import damage_reported
from ..core.disk.journal import recorded_head
from ..core.disk.spreadsheets import COMPOUND_FILE
from ..core.errors import InputError
from ..core.table import Table
from ..evaluate.sweep.run import JOURNAL as SWEEP_JOURNAL
from ..evaluate.video.evaluate import JOURNAL as VIDEO_JOURNAL
from ..output import LIST_FILE, read_list
from ..report.files import whole_result
from ..report.html import GENERATOR

#: Largest workbook and page, and what is read of their descriptions.
_MOST_BYTES, _MOST_OF_HEAD = 2**31, 2**20
#: Commands whose results.json can be compared.
_COMPARABLE = ("evaluate", "image", "characterise", "sweep", "calibrate")


@dataclass(frozen=True)
class Description:
    """What a file is.

    Parameters
    ----------
    kind : str
        Its kind.
    commands : tuple of str
        Commands that use it, with {file} for its path and {folder} for its folder.
    properties : dict of str
        Its content, by name.
    tables : tuple of Table
        More of it.
    """

    kind: str
    commands: tuple[str, ...]
    properties: dict[str, str] = field(default_factory=dict)
    tables: tuple[Table, ...] = ()


def describe_result(path: Path, content: dict[str, object]) -> Description:
    """Describe results as JSON; raises InputError if they are incomplete or damaged."""
    found = whole_result(path, content)
    tables = (f"{name} ({len(table.rows)} row{'s' * (len(table.rows) != 1)})" for name, table in found.tables.items())
    properties = {
        "command": found.kind,
        "title": found.title,
        "tables": ", ".join(tables),
        "inputs": ", ".join(one.path for one in found.inputs),
    }
    commands: tuple[str, ...] = ("compare {file} OTHER",) if found.kind in _COMPARABLE else ()
    if found.kind == "characterise":
        commands += ("init chain my.toml --sensor {file}",)
    return Description("results", commands, properties)


def describe_workbook(path: Path) -> Description | None:
    """Describe a spreadsheet that labcdp wrote, None for one of another program; raises InputError if it is damaged."""
    data = read_bytes(path, "a spreadsheet (.xlsx)", _MOST_BYTES)
    if data.startswith(COMPOUND_FILE):
        return None
    with (
        damage_reported(f"{path} cannot be read as a spreadsheet", ": save it again as .xlsx"),
        zipfile.ZipFile(BytesIO(data)) as parts,
    ):
        about, book = (_beginning(parts, name) for name in ("docProps/core.xml", "xl/workbook.xml"))
    if "<dc:creator>labcdp</dc:creator>" not in about:
        return None
    title = re.search("<dc:title>([^<]*)</dc:title>", about)
    sheets = re.findall('<sheet name="([^"]*)"', book)
    properties = {"title": unescape(title[1]) if title else "", "sheets": ", ".join(map(unescape, sheets))}
    return Description(
        "spreadsheet of results", _beside(path), properties | {"use": "open it in a spreadsheet program"}
    )


def _beginning(parts: zipfile.ZipFile, name: str) -> str:
    # Programs leave out the description of a workbook.
    if name not in parts.namelist():
        return ""
    with parts.open(name) as part:
        return part.read(_MOST_OF_HEAD).decode("utf-8", errors="replace")


def describe_page(path: Path) -> Description:
    """Describe a page that labcdp wrote; raises InputError for any other."""
    text = read_bytes(path, "a page of labcdp", _MOST_BYTES)[:_MOST_OF_HEAD].decode("utf-8", errors="replace")
    if GENERATOR not in text:
        raise InputError(f"{path} is not a results page: choose a file that labcdp wrote or reads")
    title = re.search("<title>([^<]*)</title>", text)
    properties = {"title": unescape(title[1]) if title else "", "use": "open it in a browser"}
    return Description("page of results", _beside(path), properties)


def describe_journal(path: Path) -> Description:
    """Describe a journal with which an interrupted command resumes; raises InputError for any other file."""
    kinds = {SWEEP_JOURNAL: "sweep", VIDEO_JOURNAL: "video"}
    if path.name not in kinds or recorded_head(path) is None:
        raise InputError(f"{path} is not a journal of labcdp, or is damaged: remove it to start again")
    properties = {"use": f"the same labcdp {kinds[path.name]} resumes with it if it was interrupted"}
    return Description(f"journal of labcdp {kinds[path.name]}", _beside(path), properties)


def describe_list(folder: Path, kind: str, names: Sequence[str] = ()) -> Description:
    """Describe a folder of results by the list of its files; raises InputError if that is damaged."""
    listed = read_list(folder)
    if listed is None:
        raise InputError(f"{folder} has no {LIST_FILE}: give a folder of results")
    properties = {
        "command": listed.command,
        "state": "complete" if listed.finished else "interrupted: the same command resumes or replaces it",
        "files": ", ".join(names or sorted({one.name for one in listed.files})),
    }
    return Description(kind, _beside(folder / LIST_FILE), properties)


def _beside(path: Path) -> tuple[str, ...]:
    """Commands for the results beside a file."""
    return ("info {folder}/results.json",) if (path.parent / "results.json").is_file() else ()
