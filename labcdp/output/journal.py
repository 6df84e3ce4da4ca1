"""The journal in a folder of results, with which the command that writes them resumes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ..core.disk.journal import LineJournal
from .folder import Destination, open_results


@contextmanager
def results_journal(
    destination: Destination | None, command: str, name: str, head: Mapping[str, Any], what: str
) -> Iterator[LineJournal]:
    """Open the journal of results, or begin one; without a result it goes, and other settings may have the folder.

    Parameters
    ----------
    destination : path, ResultsFolder or None
        Folder of the results; None for one that goes.
    command : str
        Command whose results these are.
    name : str
        Name of the journal in the folder.
    head, what
        As for `LineJournal.open`.

    Raises
    ------
    InputError
        As `LineJournal.open`, or if the folder cannot be used.
    """
    with ExitStack() as stack:
        if destination is None:
            path = Path(stack.enter_context(TemporaryDirectory(prefix="labcdp-"))) / name
        else:
            path = stack.enter_context(open_results(destination, command)).journal(name)
        journal = LineJournal.open(path, head, what)
        stack.callback(lambda: journal.close() if len(journal) else journal.discard())
        yield journal
