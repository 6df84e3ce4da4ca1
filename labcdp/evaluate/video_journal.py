"""The journal of a video's evaluation: finished frames on disk, so that one that was broken off goes on."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from time import monotonic
from typing import IO, Any

from ..errors import InputError

FILE_NAME = "video.jsonl"
#: Seconds after which lines are flushed to the disk; to the operating system they go at once, so that only a power
#: cut costs the last ones, and these are evaluated again.
_SYNC_S = 2.0

Row = dict[str, Any]


class VideoJournal:
    """Results of the frames of one video, a line each, after a line that says what was evaluated.

    Each line ends with a check, the SHA-256 of the line before's check and its own text. Where that fails, as in a line
    that was not finished, the journal ends, and what follows is evaluated anew.

    Parameters
    ----------
    path : Path
        The file.
    file : IO
        Open for reading and writing.
    check : str
        Check of the last line.
    ends : list of int
        Where each line of a frame begins, in bytes, and where the last one ends.
    """

    def __init__(self, path: Path, file: IO[bytes], check: str, ends: list[int]) -> None:
        self.path = path
        self._file, self._check, self._ends = file, check, ends
        self._synced = monotonic()

    @classmethod
    def open(cls, folder: Path, head: Mapping[str, Any]) -> VideoJournal:
        """Open the journal of a folder, or begin one.

        Parameters
        ----------
        folder : Path
            Made if it does not exist.
        head : mapping
            All that decides the results; JSON.

        Raises
        ------
        InputError
            If the folder holds the journal of another evaluation, or cannot be written.
        """
        path = folder / FILE_NAME
        try:
            folder.mkdir(parents=True, exist_ok=True)
            file = path.open("r+b" if path.exists() else "w+b")
            journal = cls(path, file, "", [])
            journal._begin(json.loads(json.dumps(dict(head))))
        except OSError as error:
            raise InputError(f"{path} cannot be used ({error.strerror}): give a folder you can write to") from error
        return journal

    def _begin(self, head: Mapping[str, Any]) -> None:
        first = self._file.readline()
        found = _decode(first, "")
        if found is None:
            # No line was finished: there is nothing to keep.
            self._begin_anew(head)
            return
        values, self._check = found
        at = self._file.tell()
        if values != head and _decode(self._file.readline(), self._check) is None:
            # It was refused before its first frame.
            self._begin_anew(head)
            return
        self._file.seek(at)
        if values != head:
            self._file.close()
            raise InputError(
                f"{self.path.parent} holds the results of another evaluation{_differing(values, head)}: give another "
                f"folder, or remove {self.path}"
            )
        self._ends = [self._file.tell()]
        while (found := _decode(self._file.readline(), self._check)) is not None:
            self._check = found[1]
            self._ends.append(self._file.tell())
        self._file.seek(self._ends[-1])
        self._file.truncate()

    def _begin_anew(self, head: Mapping[str, Any]) -> None:
        self._check = ""
        self._file.seek(0)
        self._file.truncate()
        self._write(dict(head))
        self._ends = [self._file.tell()]

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self._ends) - 1

    def rows(self) -> Iterator[Row]:
        """All rows so far, read from the disk."""
        self._file.flush()
        with self.path.open("rb") as file:
            file.seek(self._ends[0])
            for start, end in zip(self._ends, self._ends[1:], strict=False):
                yield _values(file.read(end - start))

    def row(self, place: int) -> Row:
        """Row by its place, from 0."""
        start, end = self._ends[place : place + 2]
        with self.path.open("rb") as file:
            file.seek(start)
            return _values(file.read(end - start))

    def add(self, row: Row) -> None:
        """Record the results of a frame.

        Raises
        ------
        InputError
            If they cannot be written.
        """
        try:
            self._write(row)
            if monotonic() - self._synced > _SYNC_S:
                os.fsync(self._file.fileno())
                self._synced = monotonic()
        except OSError as error:
            raise InputError(
                f"{self.path} cannot be written ({error.strerror}): make room, and start the same evaluation again"
            ) from error
        self._ends.append(self._file.tell())

    def close(self) -> None:
        """Flush it to the disk and close it."""
        if not self._file.closed:
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file.close()

    def discard(self) -> None:
        """Close it and take it away, where it holds nothing that is worth going on with."""
        self._file.close()
        self.path.unlink(missing_ok=True)

    def _write(self, values: Mapping[str, Any]) -> None:
        # Floats are written so that they are read back bit for bit; nan as NaN, which the reader knows.
        text = json.dumps(values, ensure_ascii=False)
        self._check = _check_of(self._check, text)
        self._file.write(f"{text}\t{self._check}\n".encode())
        self._file.flush()


def recorded_head(folder: Path) -> Row | None:
    """Return what the journal of a folder was begun with, None if there is no journal with a row."""
    try:
        with (folder / FILE_NAME).open("rb") as file:
            head = _decode(file.readline(), "")
            return None if head is None or _decode(file.readline(), head[1]) is None else head[0]
    except OSError:
        return None


def _check_of(before: str, text: str) -> str:
    return hashlib.sha256(f"{before}{text}".encode()).hexdigest()


def _decode(line: bytes, before: str) -> tuple[Row, str] | None:
    """Values and check of a line, None if it is not whole or does not follow the one with the check `before`."""
    text, _, check = line.rpartition(b"\t")
    if not line.endswith(b"\n") or _check_of(before, text.decode(errors="replace")) != check[:-1].decode(
        errors="replace"
    ):
        return None
    return json.loads(text), check[:-1].decode()


def _values(line: bytes) -> Row:
    values: Row = json.loads(line.rpartition(b"\t")[0])
    return values


def _differing(recorded: Mapping[str, Any], head: Mapping[str, Any]) -> str:
    names = [name for name in head if recorded.get(name) != head[name]]
    return f" (another {', '.join(names)})" if names else ""
