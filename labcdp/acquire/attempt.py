"""An acquisition that is refused at its start leaves nothing behind."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..core.errors import LabcdpError
from ..session import EventRecord, Session
from ..session.records import SIMULATED_BENCH

#: Records with which every session begins.
_OF_A_NEW_SESSION = ("session", "readme", SIMULATED_BENCH)


@contextmanager
def no_bare_session(path: Path) -> Iterator[None]:
    """Remove a session that failed before its first record, unless it was there before.

    Parameters
    ----------
    path : Path
        Folder of the session, which the block creates or resumes, and closes.
    """
    new = not holds_something(path)
    try:
        yield
    except LabcdpError:
        if new and holds_something(path):
            session = Session.open(path)
            if all(isinstance(one, EventRecord) and one.kind in _OF_A_NEW_SESSION for one in session.records):
                session.remove()
        raise


def holds_something(path: Path) -> bool:
    """Whether there is anything at a path but an empty folder."""
    return path.exists() and not (path.is_dir() and not any(path.iterdir()))
