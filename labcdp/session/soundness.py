"""Soundness of a session: every file its journal knows is there as it was written, and no other."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..core.errors import SessionError
from ..output.file import is_temporary
from .files import read_checked, reported
from .journal_text import FORMER_END, JOURNAL, Entry, read_journal
from .records import SUPERSEDED


def unrecorded(folder: Path, entries: Sequence[Entry]) -> list[str]:
    """Files in a session's folder that its journal does not know, as names inside it."""
    known = {entry.file.name for entry in entries if entry.file} | {JOURNAL, FORMER_END}
    with reported(folder, "read"):
        files = [path for path in folder.rglob("*") if path.is_file() and not is_temporary(path)]
    return sorted({path.relative_to(folder).as_posix() for path in files} - known)


def problems(folder: Path, entries: Sequence[Entry]) -> list[str]:
    """Check a session's journal on the disk and every file in it.

    Parameters
    ----------
    folder : Path
        The session's folder.
    entries : sequence of Entry
        The journal's lines as they were read.

    Returns
    -------
    list of str
        One line for each fault, none if all is sound.
    """
    found: list[str] = []
    try:
        text = read_journal(folder)
        if text.torn:
            found.append(
                f"{folder / JOURNAL} ends with a line that is not whole: open the session for writing once to set it "
                "aside"
            )
        if [entry.check for entry in text.entries[: len(entries)]] != [e.check for e in entries]:
            found.append(f"{folder / JOURNAL} was replaced since it was opened: open the session again")
    except SessionError as error:
        found.append(str(error))
    replaced = {
        line
        for entry in entries
        if entry.kind == SUPERSEDED and entry.content.get("damaged")
        for line in entry.content["lines"]
    }
    for entry in entries:
        if entry.file is not None and entry.sequence not in replaced:
            try:
                read_checked(folder, entry.file)
            except SessionError as error:
                found.append(str(error))
    return found
