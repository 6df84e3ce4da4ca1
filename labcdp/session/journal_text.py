"""The journal: one line of JSON for each thing recorded, chained so that an altered or lost line is noticed.

Line n ends with a check, the SHA-256 of line n - 1's check followed by line n without its own. A line that was
altered, removed or swapped breaks the chain from there on. Lines cut off the end leave a good chain, so a second
file, ``journal.end``, holds the number and the check of the last line. It is written after the line, so after
a kill it may be one line late, but never early.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from ..core.disk import parse_json, read_at_most, validated_as
from ..core.errors import InputError, SessionError
from .files import StoredFile, reported

JOURNAL = "journal.jsonl"
JOURNAL_END = "journal.end"

START = "0" * 64
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
    # A path that stays inside the session's folder.
    file: str | None = Field(None, pattern=r"^(?:[^/\\\x00.][^/\\\x00]*/)*[^/\\\x00.][^/\\\x00]*$")
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
    """Read a session's journal and verify its chain; changes nothing.

    Raises
    ------
    SessionError
        If there is no journal, it cannot be read, or a line was altered, removed or swapped.
    """
    # The end first: a writer may append between the two, and the end must not be ahead of the lines.
    end_path, path = folder / JOURNAL_END, folder / JOURNAL
    with reported(end_path, "read"):
        end = read_at_most(end_path, 1000) if end_path.exists() else None
    with reported(path, "read"):
        text = read_at_most(path, _MOST_BYTES)
    *lines, torn = text.split(b"\n")
    entries: list[Entry] = []
    for number, line in enumerate(lines, start=1):
        entry = decode(line, entries[-1].check if entries else START)
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
    if not found or end != end_text(entries[:written]):
        raise SessionError(
            f"{folder / JOURNAL_END} was altered, or belongs to another journal: restore both from a copy of the "
            f"session, or delete {JOURNAL_END} if the journal is known to be complete"
        )


def end_text(entries: list[Entry]) -> bytes:
    """Content of ``journal.end`` for a journal with these lines."""
    return f"{len(entries)} {entries[-1].check if entries else START}\n".encode()


def encode(previous_check: str, values: dict[str, Any]) -> bytes:
    """Make a line, without its end, that follows one with that check; raises InputError for what JSON has not."""
    try:
        body = json.dumps(values, ensure_ascii=False, allow_nan=False).encode()
    except (TypeError, ValueError) as error:
        raise InputError(
            f"the content of this {values['kind']} record cannot be written as JSON ({error}): give text, finite "
            "numbers, truth values, lists and tables"
        ) from error
    check = hashlib.sha256(previous_check.encode() + body).hexdigest()
    return body[:-1] + f', "check": "{check}"}}'.encode()


def decode(line: bytes, previous_check: str) -> Entry | None:
    """Return the entry, or None if the line does not follow one with that check, or is no line of a journal."""
    found = _LINE.fullmatch(line)
    if not found:
        return None
    body, check = found[1] + b"}", found[2].decode()
    if hashlib.sha256(previous_check.encode() + body).hexdigest() != check:
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
