"""The journal: one line of JSON for each thing recorded, chained so that an altered or lost line is noticed.

Line n ends with a check, the SHA-256 of line n - 1's check followed by line n without its own. A line that was
altered, removed or swapped breaks the chain from there on. Lines cut off the end leave a good chain, so a second
file, ``journal.end``, holds the number and the check of the last line. It is written after the line, so after
a kill it may be one line late, but never early.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import logging
import os
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from io import FileIO
from itertools import count
from pathlib import Path
from typing import Any, Self

from ..errors import InputError, SessionError
from .files import StoredFile, reported, write_all, write_whole

JOURNAL = "journal.jsonl"
JOURNAL_END = "journal.end"

_START = "0" * 64
_LINE = re.compile(rb'(\{.*), "check": "([0-9a-f]{64})"\}', re.DOTALL)

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Entry:
    """One line of the journal.

    Parameters
    ----------
    sequence : int
        Number of the line, from 1.
    time : datetime
        Host time it was written, with time zone.
    kind : str
        What was recorded, for example ``frame``.
    content : dict
        What is to be known about it, as values JSON can hold.
    file : StoredFile or None
        The file it belongs to.
    check : str
        The line's check, in hexadecimal.
    """

    sequence: int
    time: datetime
    kind: str
    content: dict[str, Any]
    file: StoredFile | None
    check: str


@dataclass(frozen=True)
class JournalText:
    """What a journal holds.

    Parameters
    ----------
    entries : list of Entry
        The whole lines; their chain is good.
    whole_bytes : int
        Length of the whole lines.
    torn : bytes
        The rest: a line without its end, left by a writer that was killed, or that is writing just now.
    has_end : bool
        Whether ``journal.end`` is there.
    """

    entries: list[Entry]
    whole_bytes: int
    torn: bytes
    has_end: bool


def read_journal(folder: Path) -> JournalText:
    """Read a session's journal and verify its chain; changes nothing.

    Raises
    ------
    SessionError
        If there is no journal, it cannot be read, or a line was altered, removed or swapped.
    """
    # The end first: a writer may append between the two, and the end must not be ahead of the lines.
    end_path, path = folder / JOURNAL_END, folder / JOURNAL
    with reported(end_path, "read"):
        end = end_path.read_bytes() if end_path.exists() else None
    with reported(path, "read"):
        text = path.read_bytes()
    *lines, torn = text.split(b"\n")
    entries: list[Entry] = []
    for number, line in enumerate(lines, start=1):
        entry = _decode(line, entries[-1].check if entries else _START)
        if entry is None or entry.sequence != number:
            raise SessionError(
                f"{path} line {number} was altered, or a line there was removed or swapped: restore the journal "
                "from a copy of the session"
            )
        entries.append(entry)
    if end is not None:
        _check_end(folder, entries, end)
    return JournalText(entries, len(text) - len(torn), torn, end is not None)


def _check_end(folder: Path, entries: list[Entry], end: bytes) -> None:
    found = re.fullmatch(rb"(\d{1,18}) [0-9a-f]{64}\n", end)
    written = int(found[1]) if found else 0
    if written > len(entries):
        raise SessionError(
            f"{folder / JOURNAL} has {len(entries)} whole lines, but {written} were written: lines at its end are "
            f"missing; restore it from a copy of the session, or delete {JOURNAL_END} to do without them"
        )
    if not found or end != _end_text(entries[:written]):
        raise SessionError(
            f"{folder / JOURNAL_END} was altered, or belongs to another journal: restore both from a copy of the "
            f"session, or delete {JOURNAL_END} if the journal is known to be complete"
        )


def _end_text(entries: list[Entry]) -> bytes:
    return f"{len(entries)} {entries[-1].check if entries else _START}\n".encode()


def _encode(previous_check: str, values: dict[str, Any]) -> bytes:
    try:
        body = json.dumps(values, ensure_ascii=False, allow_nan=False).encode()
    except (TypeError, ValueError) as error:
        raise InputError(
            f"the content of this {values['kind']} record cannot be written as JSON ({error}): give text, finite "
            "numbers, truth values, lists and tables"
        ) from error
    check = hashlib.sha256(previous_check.encode() + body).hexdigest()
    return body[:-1] + f', "check": "{check}"}}'.encode()


def _decode(line: bytes, previous_check: str) -> Entry | None:
    """Return the entry, or None if the line does not follow one with that check."""
    found = _LINE.fullmatch(line)
    if not found:
        return None
    body, check = found[1] + b"}", found[2].decode()
    if hashlib.sha256(previous_check.encode() + body).hexdigest() != check:
        return None
    try:
        values = json.loads(body)
        file = StoredFile(values["file"], values["sha256"], values["size"]) if "file" in values else None
        time = datetime.fromisoformat(values["time"])
        return Entry(values["sequence"], time, values["kind"], values["content"], file, check)
    except (KeyError, TypeError, ValueError):
        return None


def _lock(file: FileIO, folder: Path) -> None:
    with reported(folder / JOURNAL, "written"):
        try:
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
    """

    def __init__(self, folder: Path, file: FileIO, text: JournalText) -> None:
        self._folder = folder
        self._file = file
        self._whole_bytes = text.whole_bytes
        self.entries = text.entries
        self.torn = text.torn

    @classmethod
    def create(cls, folder: Path) -> Self:
        """Make an empty journal and open it; raises OSError if it cannot be written."""
        write_whole(folder, JOURNAL, b"")
        write_whole(folder, JOURNAL_END, _end_text([]))
        return cls.open(folder)

    @classmethod
    def open(cls, folder: Path) -> Self:
        """Lock the journal, read it and verify its chain.

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
        if not text.has_end:
            _log.warning("%s was missing and is made anew", folder / JOURNAL_END)
        return cls(folder, file, text)

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
        """Add a line; when this returns, it is on the disk.

        Raises
        ------
        SessionError
            If the line cannot be written (then the journal is as before), or someone else changed the journal.
        InputError
            If `content` has values JSON does not have.
        """
        values: dict[str, Any] = {
            "sequence": len(self.entries) + 1,
            "time": datetime.now(UTC).isoformat(timespec="microseconds"),
            "kind": kind,
            "content": content,
        }
        if file is not None:
            values |= {"file": file.name, "sha256": file.sha256, "size": file.size}
        previous_check = self.entries[-1].check if self.entries else _START
        line = _encode(previous_check, values)
        entry = _decode(line, previous_check)
        assert entry is not None
        with reported(self._folder / JOURNAL, "written"):
            self._require_untouched()
            self._append(line + b"\n", entry)
        self.write_end()
        return entry

    def write_end(self) -> None:
        """Bring ``journal.end`` up to date."""
        try:
            write_whole(self._folder, JOURNAL_END, _end_text(self.entries))
        except OSError as error:
            # The line itself is safe; only a cut at the journal's end would go unnoticed until the next line.
            _log.warning("%s cannot be written (%s)", self._folder / JOURNAL_END, error.strerror)

    def _append(self, line: bytes, entry: Entry) -> None:
        """Write a line, or leave the journal as it was, also if Ctrl-C comes in between."""
        lines, whole_bytes = len(self.entries), self._whole_bytes
        try:
            write_all(self._file.fileno(), line)
            os.fsync(self._file.fileno())
            self._whole_bytes += len(line)
            self.entries.append(entry)
        except BaseException:
            del self.entries[lines:]
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
