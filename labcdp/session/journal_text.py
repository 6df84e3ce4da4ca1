"""The journal: one line of JSON for each thing recorded, with a check by which an altered line is noticed.

A line ends with the SHA-256 of what stands before it. Lines are numbered, so that one that was removed or swapped is
noticed too. Sessions of format 1 have checks over the check of the line before as well, and a file ``journal.end``.
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
