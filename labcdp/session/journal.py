"""Writing the journal: adding lines that stay there whatever happens."""

from __future__ import annotations

import logging
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import datetime
from io import FileIO
from itertools import count
from pathlib import Path
from typing import Any, Self

from ..core.clock import Clock
from ..core.errors import SessionError
from ..output.file import write_all
from .files import StoredFile, reported, write_whole
from .journal_text import JOURNAL, Entry, JournalText, Line, decode, encode, read_journal

#: Kind of a line that says that the clock was set back.
CLOCK = "clock"

#: Clocks that follow a time server are put right in steps below this.
_CLOCK_STEP_S = 1.0

_log = logging.getLogger(__name__)


def _lock(file: FileIO, folder: Path) -> None:
    with reported(folder / JOURNAL, "written"):
        try:
            import fcntl  # not on all systems; reading needs no lock

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise SessionError(
                f"{folder} is in use by another process: end that one first, or open the session for reading"
            ) from error


class Journal:
    """A session's journal, open for writing; made by `create` or `open`.

    Parameters
    ----------
    folder : Path
        The session's folder.
    file : FileIO
        The journal, open for appending and locked.
    text : JournalText
        What it holds.
    clock : Clock
        Where the lines' times come from.
    """

    def __init__(self, folder: Path, file: FileIO, text: JournalText, clock: Clock) -> None:
        self._clock = clock
        self._folder = folder
        self._file = file
        self._whole_bytes = text.whole_bytes
        self.entries = text.entries
        self.torn = text.torn

    @classmethod
    def create(cls, folder: Path, clock: Clock) -> Self:
        """Make an empty journal and open it; raises OSError if it cannot be written."""
        write_whole(folder, JOURNAL, b"")
        return cls.open(folder, clock)

    @classmethod
    def open(cls, folder: Path, clock: Clock) -> Self:
        """Lock the journal, read it and verify its lines.

        Raises
        ------
        SessionError
            If another process has it open for writing, or as `read_journal`.
        """
        path = folder / JOURNAL
        with reported(path, "written"):
            file = FileIO(os.open(path, os.O_RDWR | os.O_APPEND | os.O_CLOEXEC), "r+")
        try:
            _lock(file, folder)
            text = read_journal(folder)
        except BaseException:
            file.close()
            raise
        return cls(folder, file, text, clock)

    def close(self) -> None:
        """Release the lock; may be called twice."""
        self._file.close()

    def set_torn_line_aside(self) -> None:
        """Move what follows the last whole line to a file of its own, and record that file."""
        number = len(self.entries) + 1
        names = (f"journal.torn-{number:04d}-{n}.txt" for n in count(1))
        name = next(name for name in names if not (self._folder / name).exists())
        with reported(self._folder / name, "written"):
            aside = write_whole(self._folder, name, self.torn)
        with reported(self._folder / JOURNAL, "written"):
            self._file.truncate(self._whole_bytes)
            os.fsync(self._file.fileno())
        _log.warning("%s: line %d is not whole, it is kept in %s", self._folder / JOURNAL, number, name)
        self.torn = b""
        self.append("torn line", {"line": number}, aside)

    def append(self, kind: str, content: Mapping[str, Any], file: StoredFile | None = None) -> Entry:
        """Add a line; as `append_several`."""
        return self.append_several([Line(kind, content, file)])[0]

    def append_several(self, lines: Sequence[Line]) -> list[Entry]:
        """Add lines; when this returns, they are on the disk, and if it raises, none of them counts.

        A line whose time is before that of the line above it, because the computer's clock was set back, gets a line of
        kind ``clock`` before it that says so.

        Raises
        ------
        SessionError
            If they cannot be written (then the journal is as before), or someone else changed the journal.
        InputError
            If a content has values JSON does not have.
        """
        now = self._clock.now()
        stepped_back_s = self._last_time_s(now) - now.timestamp()
        if stepped_back_s > _CLOCK_STEP_S:
            _log.warning(
                "%s: the computer's clock was set back by %.0f s; records keep their order by number",
                self._folder / JOURNAL,
                stepped_back_s,
            )
            lines = [Line(CLOCK, {"set_back_s": round(stepped_back_s, 3)}), *lines]
        text, entries = b"", []
        for number, line in enumerate(lines, start=len(self.entries) + 1):
            encoded = encode(line.values(number, now))
            entry = decode(encoded)
            assert entry is not None
            text += encoded + b"\n"
            entries.append(entry)
        with reported(self._folder / JOURNAL, "written"):
            self._require_untouched()
            self._append(text, entries)
        return [entry for entry in entries if entry.kind != CLOCK]

    def _last_time_s(self, now: datetime) -> float:
        return (self.entries[-1].time if self.entries else now).timestamp()

    def _append(self, text: bytes, entries: list[Entry]) -> None:
        """Write lines, or leave the journal as it was, also if Ctrl-C comes in between."""
        n_lines, whole_bytes = len(self.entries), self._whole_bytes
        try:
            write_all(self._file.fileno(), text)
            os.fsync(self._file.fileno())
            self._whole_bytes += len(text)
            self.entries += entries
        except BaseException:
            del self.entries[n_lines:]
            self._whole_bytes = whole_bytes
            with suppress(OSError):
                self._file.truncate(whole_bytes)
            raise

    def _require_untouched(self) -> None:
        """Refuse to write if an editor or a copy of this process changed or replaced the file."""
        path = self._folder / JOURNAL
        named, held = path.stat(), os.fstat(self._file.fileno())
        if (named.st_dev, named.st_ino) != (held.st_dev, held.st_ino) or held.st_size != self._whole_bytes:
            raise SessionError(
                f"{path} was changed by another program since this one opened it: open the session again"
            )
