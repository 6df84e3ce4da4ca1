"""The journal of a sweep: finished cells on disk, so that one that was broken off goes on."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError

FILE_NAME = "sweep.jsonl"

Block = tuple[int, NDArray[np.float64]]


class SweepJournal:
    """Finished blocks of cells of one sweep, one a line after a first line that says which sweep it is.

    A last line that was not finished is taken off when the journal is opened again.

    Parameters
    ----------
    file : IO
        Open for appending, positioned at its end.
    finished : sequence of (int, ndarray)
        Blocks read from it: number of the first cell, and values of shape (cells, variables).
    """

    def __init__(self, file: IO[str], finished: Sequence[Block]) -> None:
        self._file = file
        self.finished = tuple(finished)

    @classmethod
    def open(cls, folder: Path, sweep: Mapping[str, Any]) -> SweepJournal:
        """Open the journal of a folder, or begin one.

        Parameters
        ----------
        folder : Path
            Made if it does not exist.
        sweep : mapping
            All that decides the results; JSON.

        Raises
        ------
        InputError
            If the folder holds another sweep or a damaged journal, or cannot be written.
        """
        path = folder / FILE_NAME
        head = json.dumps(sweep, sort_keys=True)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            # A first line that is not whole says nothing: the journal begins anew.
            whole = path.read_bytes() if path.exists() else b""
            whole = whole[: whole.rfind(b"\n") + 1]
            lines = whole.decode().splitlines()
            if len(lines) == 1:
                # No cell was finished, as after a mistake in the first one: there is nothing to keep.
                whole, lines = b"", []
            if lines and lines[0] != head:
                raise InputError(
                    f"{folder} holds another sweep{_differing(lines[0], sweep)}: give another folder, or remove {path}"
                )
            finished = [_block(line, path) for line in lines[1:]]
            file = path.open("r+" if path.exists() else "w", encoding="utf-8")
            file.seek(len(whole))
            file.truncate()
            journal = cls(file, finished)
            if not lines:
                journal._write(head)
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "not text"
            raise InputError(f"{path} cannot be used ({reason}): give a folder you can write to") from error
        return journal

    def add(self, first: int, values: NDArray[np.float64]) -> None:
        """Record a finished block and make sure that it is on the disk.

        Raises
        ------
        InputError
            If it cannot be written.
        """
        self._write(json.dumps({"first": first, "values": values.tolist()}))

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _write(self, line: str) -> None:
        try:
            self._file.write(line + "\n")
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise InputError(
                f"{self._file.name} cannot be written ({error.strerror}): make room, and start the same sweep again"
            ) from error


def _differing(line: str, sweep: Mapping[str, Any]) -> str:
    """Say in what the recorded sweep differs, if that can be known."""
    try:
        recorded = json.loads(line)
        names = [name for name, value in sweep.items() if recorded[name] != json.loads(json.dumps(value))]
    except (ValueError, KeyError, TypeError):
        return ""
    return f" (another {', '.join(names)})" if names else ""


def _block(line: str, path: Path) -> Block:
    try:
        record = json.loads(line)
        return int(record["first"]), np.atleast_2d(np.array(record["values"], dtype=np.float64))
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path} is damaged ({line[:40]!r}): remove it, and start the sweep again") from error
