"""The journal: one line of JSON for each thing recorded, with a check by which an altered line is noticed.

A line ends with the SHA-256 of what stands before it. Lines are numbered, so that one that was removed or swapped is
noticed too. Sessions of format 1 have checks over the check of the line before as well, and a file ``journal.end``.
"""

from __future__ import annotations

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
from typing import Annotated, Any, ClassVar, Self, TypeAlias

from pydantic import AfterValidator, Field

from ..core.clock import Clock
from ..core.disk import read_at_most, validated_as
from ..core.disk.files import SESSION_JOURNAL
from ..core.disk.journal import decoded, encoded
from ..core.errors import InputError, SessionError
from ..output.file import StoredFile, lock, write_all, write_several
from .frames import reported

#: File of sessions of format 1, which is not read any more.
FORMER_END = "journal.end"
#: Kind of a line that says that the clock was set back.
CLOCK = "clock"

_FORMER_START = "0" * 64
#: Size from which a journal is refused: some 100 000 frames.
_MOST_BYTES = 2**28
#: A path that stays inside the session's folder, and can be printed.
_NAME = re.compile(r"(?:[\w-][\w .-]*/)*[\w-][\w .-]*")
_LONGEST_NAME = 250
#: Clocks that follow a time server are put right in steps below this.
_CLOCK_STEP_S = 1.0

_log = logging.getLogger(__name__)

#: A line to be added: its kind, what is to be known about it as values JSON can hold, and the file it belongs to.
Line: TypeAlias = tuple[str, Mapping[str, Any], StoredFile | None]


def _inside(file: StoredFile) -> StoredFile:
    if not (_NAME.fullmatch(file.name) and len(file.name) <= _LONGEST_NAME):
        raise ValueError("it does not name a file in the session")
    return file


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
        Kind of the record, for example ``frame``.
    content : dict
        Content of the record, as values JSON can hold.
    check : str
        The line's check, in hexadecimal.
    file : StoredFile or None
        The file it belongs to.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    sequence: Annotated[int, Field(ge=1)]
    time: datetime
    kind: Annotated[str, Field(min_length=1)]
    content: dict[str, Any]
    check: str
    file: Annotated[StoredFile, AfterValidator(_inside)] | None = None


def read_journal(folder: Path) -> tuple[list[Entry], int, bytes]:
    """Read a session's journal and verify its lines; changes nothing.

    Returns
    -------
    list of Entry
        The whole lines.
    int
        Their length in bytes.
    bytes
        The rest: a line without its end, left by a writer that was killed, or that is writing just now.

    Raises
    ------
    SessionError
        If there is no journal, it cannot be read, or a line was altered, removed or swapped.
    """
    path = folder / SESSION_JOURNAL
    with reported(path, "read"):
        text = read_at_most(path, _MOST_BYTES)
    *lines, torn = text.split(b"\n")
    entries: list[Entry] = []
    for number, line in enumerate(lines, start=1):
        entry = _decode(line + b"\n", entries[-1].check if entries else _FORMER_START)
        if entry is None or entry.sequence != number:
            raise SessionError(
                f"{path} line {number} was altered, or a line there was removed or swapped: restore the journal "
                "from a copy of the session"
            )
        entries.append(entry)
    return entries, len(text) - len(torn), torn


def _encode(number: int, time: datetime, line: Line) -> bytes:
    """Make a line; raises InputError for what JSON has not."""
    kind, content, file = line
    values = {"sequence": number, "time": time.isoformat(timespec="microseconds"), "kind": kind, "content": content}
    if file is not None:
        values |= {"file": file.name, "sha256": file.sha256, "size": file.size}
    try:
        return encoded(values, allow_nan=False)[0]
    except (TypeError, ValueError) as error:
        raise InputError(
            f"the content of this {kind} record cannot be written as JSON ({error}): give text, finite numbers, truth "
            "values, lists and tables"
        ) from error


def _decode(line: bytes, former_check: str = "") -> Entry | None:
    """Return the entry, None if it is no whole line; the check may be over that of the line before as well."""
    entry = decoded(line, "", former_check, allow_nan=False)
    if entry is None:
        return None
    values, check = entry
    try:
        if values.get("file") is not None:
            values["file"] = {"name": values["file"], "sha256": values.pop("sha256"), "size": values.pop("size")}
        return validated_as(Entry, values | {"check": check})
    except (ValueError, KeyError):
        return None


class Journal:
    """A session's journal, open for writing; made by `create` or `open`.

    Parameters
    ----------
    folder : Path
        The session's folder.
    file : FileIO
        The journal, open for appending and locked.
    entries : list of Entry
        Its whole lines.
    whole_bytes : int
        Their length.
    torn : bytes
        What follows them.
    clock : Clock
        Where the lines' times come from.
    """

    def __init__(
        self, folder: Path, file: FileIO, entries: list[Entry], whole_bytes: int, torn: bytes, clock: Clock
    ) -> None:
        self._clock = clock
        self._folder = folder
        self._file = file
        self._whole_bytes = whole_bytes
        self.entries = entries
        self.torn = torn

    @classmethod
    def create(cls, folder: Path, clock: Clock) -> Self:
        """Make an empty journal and open it; raises OSError if it cannot be written."""
        write_several(folder, [(SESSION_JOURNAL, (b"",))])
        return cls.open(folder, clock)

    @classmethod
    def open(cls, folder: Path, clock: Clock) -> Self:
        """Lock the journal, read it and verify its lines.

        Raises
        ------
        SessionError
            If another process has it open for writing, or as `read_journal`.
        """
        path = folder / SESSION_JOURNAL
        with reported(path, "written"):
            file = FileIO(os.open(path, os.O_RDWR | os.O_APPEND | os.O_CLOEXEC), "r+")
        try:
            if not lock(file.fileno()):
                raise SessionError(f"{folder} cannot be locked: record on a disk whose file system has locks")
            return cls(folder, file, *read_journal(folder), clock)
        except BlockingIOError as error:
            file.close()
            raise SessionError(
                f"{folder} is in use by another process: end that process first, or open the session for reading"
            ) from error
        except BaseException:
            file.close()
            raise

    def close(self) -> None:
        """Release the lock; may be called twice."""
        self._file.close()

    def moved_to(self, folder: Path) -> None:
        """Take note that the session's folder was renamed."""
        self._folder = folder

    def set_torn_line_aside(self) -> None:
        """Move what follows the last whole line to a file of its own, and record that file."""
        number = len(self.entries) + 1
        names = (f"journal.torn-{number:04d}-{n}.txt" for n in count(1))
        name = next(name for name in names if not (self._folder / name).exists())
        with reported(self._folder / name, "written"):
            (aside,) = write_several(self._folder, [(name, (self.torn,))])
        with reported(self._folder / SESSION_JOURNAL, "written"):
            self._file.truncate(self._whole_bytes)
            os.fsync(self._file.fileno())
        _log.warning("%s: line %d is incomplete and kept in %s", self._folder / SESSION_JOURNAL, number, name)
        self.torn = b""
        self.append("torn line", {"line": number}, aside)

    def append(self, kind: str, content: Mapping[str, Any], file: StoredFile | None = None) -> Entry:
        """Add a line; as `append_several`."""
        return self.append_several([(kind, content, file)])[0]

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
        stepped_back_s = (self.entries[-1].time - now).total_seconds() if self.entries else 0.0
        if stepped_back_s > _CLOCK_STEP_S:
            _log.warning(
                "%s: the computer's clock was set back by %.0f s; records keep their order by number",
                self._folder / SESSION_JOURNAL,
                stepped_back_s,
            )
            lines = [(CLOCK, {"set_back_s": round(stepped_back_s, 3)}, None), *lines]
        text, entries = b"", []
        for number, line in enumerate(lines, start=len(self.entries) + 1):
            written = _encode(number, now, line)
            entry = _decode(written)
            assert entry is not None
            text += written
            entries.append(entry)
        with reported(self._folder / SESSION_JOURNAL, "written"):
            self._require_untouched()
            self._append(text, entries)
        return [entry for entry in entries if entry.kind != CLOCK]

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
        path = self._folder / SESSION_JOURNAL
        named, held = path.stat(), os.fstat(self._file.fileno())
        if (named.st_dev, named.st_ino) != (held.st_dev, held.st_ino) or held.st_size != self._whole_bytes:
            raise SessionError(
                f"{path} was changed by another program since this one opened it: open the session again"
            )
