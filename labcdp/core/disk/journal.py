"""Journals: lines of JSON with a check each; that of results chains its checks, so that interrupted work is resumed."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from time import monotonic
from typing import IO, Any

from ..errors import InputError, encodable
from .documents import parse_json
from .files import open_regular, reason

#: Seconds after which lines are flushed to the disk; to the operating system they go at once, so that only a power
#: cut costs the last ones, and these are computed again.
_SYNC_S = 2.0
#: A line that is longer is none of these journals.
_MOST_BYTES_OF_LINE = 64 * 2**20
_LINE = re.compile(rb'(\{.*), "check": "([0-9a-f]{64})"\}\n', re.DOTALL)

Row = dict[str, Any]


class LineJournal:
    """Results in a file, a line each, after a line that says what they are of.

    The check of a line is over that of the line before, too. Where that fails, as in a line
    that was not finished or was altered, the journal ends, and what follows is computed again.

    Parameters
    ----------
    path : Path
        The file.
    file : IO
        Open for reading and writing.
    """

    def __init__(self, path: Path, file: IO[bytes]) -> None:
        self.path = path
        self._file, self._check = file, ""
        #: Where each line of a result begins, in bytes, and where the last one ends.
        self._ends: list[int] = []
        self._synced = monotonic()

    @classmethod
    def open(cls, path: Path, head: Mapping[str, Any], what: str) -> LineJournal:
        """Open a journal, or begin one.

        Parameters
        ----------
        path : Path
            Its folder is made if it does not exist.
        head : mapping
            All that decides the results; JSON.
        what : str
            What the results are of, for messages: "sweep".

        Raises
        ------
        InputError
            If the file holds results of something else or is no journal, or cannot be written.
        """
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            journal = cls(path, open_regular(path, writable=True))
            journal._begin(stored_values(head), what)
        except OSError as error:
            raise InputError(f"{path} cannot be used ({reason(error)}): choose a folder you can write to") from error
        return journal

    def _begin(self, head: Row, what: str) -> None:
        first = self._line()
        found, at = decoded(first, ""), self._file.tell()
        if found is None and not encoded(head)[0].startswith(first):
            self._file.close()
            raise InputError(
                f"{self.path} is not a journal of this version of labcdp, or its first line was altered: choose "
                "another "
                "folder, or remove it"
            )
        has_result = found is not None and decoded(self._line(), found[1]) is not None
        if found is None or (found[0] != head and not has_result):
            # Its first line was not finished, or it was refused before its first result: there is nothing to keep.
            self._file.seek(0)
            self._file.truncate()
            self._write(head)
            self._ends = [self._file.tell()]
            return
        if found[0] != head:
            self._file.close()
            raise InputError(
                f"{self.path.parent} holds the results of another {what}{_differing(found[0], head)}: give another "
                f"folder, or remove {self.path}"
            )
        self._file.seek(at)
        self._check, self._ends = found[1], [at]
        while (found := decoded(self._line(), self._check)) is not None:
            self._check = found[1]
            self._ends.append(self._file.tell())
        self._file.seek(self._ends[-1])
        self._file.truncate()

    def _line(self) -> bytes:
        return self._file.readline(_MOST_BYTES_OF_LINE)

    def __len__(self) -> int:
        """Return the number of results."""
        return max(0, len(self._ends) - 1)

    def rows(self) -> Iterator[Row]:
        """All results so far, read from the disk."""
        self._file.flush()
        with open_regular(self.path) as file:
            file.seek(self._ends[0])
            for start, end in zip(self._ends, self._ends[1:], strict=False):
                yield _values(file.read(end - start))

    def row(self, place: int) -> Row:
        """Read a result by its place, from 0."""
        start, end = self._ends[place : place + 2]
        with open_regular(self.path) as file:
            file.seek(start)
            return _values(file.read(end - start))

    def add(self, row: Mapping[str, Any]) -> None:
        """Record a result.

        Raises
        ------
        InputError
            If it cannot be written.
        """
        try:
            self._write(row)
            if monotonic() - self._synced > _SYNC_S:
                os.fsync(self._file.fileno())
                self._synced = monotonic()
        except OSError as error:
            raise InputError(
                f"{self.path} cannot be written ({reason(error)}): free some disk space, and run the same command "
                "again to resume"
            ) from error
        self._ends.append(self._file.tell())

    def close(self) -> None:
        """Flush it to the disk and close it."""
        if not self._file.closed:
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file.close()

    def discard(self) -> None:
        """Close and remove it, where it holds nothing that is worth resuming."""
        self._file.close()
        self._ends = []
        self.path.unlink(missing_ok=True)

    def _write(self, values: Mapping[str, Any]) -> None:
        line, self._check = encoded(values, self._check)
        self._file.write(line)
        self._file.flush()


def stored_values(values: Mapping[str, Any]) -> Row:
    """Return values as they are read back from a journal."""
    row: Row = _encodable(json.loads(json.dumps(dict(values))))
    return row


def _encodable(values: Any) -> Any:
    """Values JSON can hold, with what UTF-8 cannot encode escaped."""
    if isinstance(values, Mapping):
        return {encodable(str(key)): _encodable(value) for key, value in values.items()}
    if isinstance(values, list | tuple):
        return [_encodable(value) for value in values]
    return encodable(values) if isinstance(values, str) else values


def recorded_head(path: Path) -> Row | None:
    """Return what a journal was begun with, None if there is no journal with a result."""
    try:
        with open_regular(path) as file:
            head = decoded(file.readline(_MOST_BYTES_OF_LINE), "")
            return None if head is None or decoded(file.readline(_MOST_BYTES_OF_LINE), head[1]) is None else head[0]
    except OSError:
        return None


def encoded(values: Mapping[str, Any], before: str = "", *, allow_nan: bool = True) -> tuple[bytes, str]:
    """Return a line with these values and a check over them and the check `before`, and that check.

    Floats are written so that they are read back bit for bit. ValueError is raised for nan and infinities unless they
    are allowed, and TypeError or ValueError for what JSON has not.
    """
    text = json.dumps(values, ensure_ascii=False, allow_nan=allow_nan)
    try:
        body = text.encode()
    except UnicodeEncodeError:
        body = json.dumps(_encodable(values), ensure_ascii=False, allow_nan=allow_nan).encode()
    check = hashlib.sha256(before.encode() + body).hexdigest()
    return body[:-1] + f', "check": "{check}"}}\n'.encode(), check


def decoded(line: bytes, *before: str, allow_nan: bool = True) -> tuple[Row, str] | None:
    """Return values and check of a line, None if it is not whole or follows none of the checks `before`."""
    found = _LINE.fullmatch(line)
    if found is None:
        return None
    body, check = found[1] + b"}", found[2].decode()
    if check not in (hashlib.sha256(one.encode() + body).hexdigest() for one in before):
        return None
    try:
        values = parse_json(body, allow_nan=allow_nan)
    except InputError:
        return None
    return (values, check) if isinstance(values, dict) else None


def _values(line: bytes) -> Row:
    values: Row = parse_json(line, allow_nan=True)
    del values["check"]
    return values


def _differing(recorded: Mapping[str, Any], head: Mapping[str, Any]) -> str:
    names = [name for name in head if recorded.get(name) != head[name]]
    return f" (another {', '.join(names)})" if names else ""
