"""The journal: one line of JSON for each thing recorded, with a check by which an altered line is noticed.

A line ends with the SHA-256 of what stands before it. Lines are numbered, so that one that was removed or swapped is
noticed too. Sessions of format 1 have checks over the check of the line before as well, and a file ``journal.end``.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from io import FileIO
from itertools import count
from pathlib import Path
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field

from ..core.clock import Clock
from ..core.disk import parse_json, read_at_most, validated_as
from ..core.errors import InputError, SessionError
from ..output.file import write_all
from .files import StoredFile, reported, write_whole

JOURNAL = "journal.jsonl"
#: File of sessions of format 1, which is not read any more.
FORMER_END = "journal.end"

_FORMER_START = "0" * 64
#: Size from which a journal is refused: some 100 000 frames.
_MOST_BYTES = 2**28
_LINE = re.compile(rb'(\{.*), "check": "([0-9a-f]{64})"\}', re.DOTALL)


class _LineValues(BaseModel):
    """A line without its check."""

    model_config = ConfigDict(extra="forbid")
    sequence: int = Field(ge=1)
    time: str
    kind: str = Field(min_length=1)
    content: dict[str, Any]
    # A path that stays inside the session's folder, and can be printed.
    file: str | None = Field(None, pattern=r"^(?:[\w-][\w .-]*/)*[\w-][\w .-]*$", max_length=250)
    sha256: str = Field("", pattern="^[0-9a-f]{64}$")
    size: int = Field(0, ge=0, le=2**40)


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
        The whole lines.
    whole_bytes : int
        Length of the whole lines.
    torn : bytes
        The rest: a line without its end, left by a writer that was killed, or that is writing just now.
    """

    entries: list[Entry]
    whole_bytes: int
    torn: bytes


@dataclass(frozen=True)
class Line:
    """A line to be added.

    Parameters
    ----------
    kind : str
        What is recorded.
    content : mapping
        What is to be known about it, as values JSON can hold.
    file : StoredFile or None
        The file it belongs to.
    """

    kind: str
    content: Mapping[str, Any]
    file: StoredFile | None = None

    def values(self, number: int, time: datetime) -> dict[str, Any]:
        """Values of the line, all but its check."""
        values: dict[str, Any] = {
            "sequence": number,
            "time": time.isoformat(timespec="microseconds"),
            "kind": self.kind,
            "content": self.content,
        }
        if self.file is not None:
            values |= {"file": self.file.name, "sha256": self.file.sha256, "size": self.file.size}
        return values


def read_journal(folder: Path) -> JournalText:
    """Read a session's journal and verify its lines; changes nothing.

    Raises
    ------
    SessionError
        If there is no journal, it cannot be read, or a line was altered, removed or swapped.
    """
    path = folder / JOURNAL
    with reported(path, "read"):
        text = read_at_most(path, _MOST_BYTES)
    *lines, torn = text.split(b"\n")
    entries: list[Entry] = []
    for number, line in enumerate(lines, start=1):
        entry = decode(line, entries[-1].check if entries else _FORMER_START)
        if entry is None or entry.sequence != number:
            raise SessionError(
                f"{path} line {number} was altered, or a line there was removed or swapped: restore the journal "
                "from a copy of the session"
            )
        entries.append(entry)
    return JournalText(entries, len(text) - len(torn), torn)


def encode(values: dict[str, Any]) -> bytes:
    """Make a line, without its end; raises InputError for what JSON has not."""
    try:
        body = json.dumps(values, ensure_ascii=False, allow_nan=False).encode()
    except (TypeError, ValueError) as error:
        raise InputError(
            f"the content of this {values['kind']} record cannot be written as JSON ({error}): give text, finite "
            "numbers, truth values, lists and tables"
        ) from error
    check = hashlib.sha256(body).hexdigest()
    return body[:-1] + f', "check": "{check}"}}'.encode()


def decode(line: bytes, former_check: str = "") -> Entry | None:
    """Return the entry, None if it is no whole line; the check may be over that of the line before as well."""
    found = _LINE.fullmatch(line)
    if not found:
        return None
    body, check = found[1] + b"}", found[2].decode()
    if check not in (hashlib.sha256(before + body).hexdigest() for before in (b"", former_check.encode())):
        return None
    try:
        values = parse_json(body)
        line_values = validated_as(_LineValues, values)
        time = datetime.fromisoformat(line_values.time)
    except ValueError:
        return None
    file = None
    if line_values.file is not None:
        file = StoredFile(line_values.file, line_values.sha256, line_values.size)
    return Entry(line_values.sequence, time, line_values.kind, values["content"], file, check)


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
