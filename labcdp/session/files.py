"""Whole files or none: writing that a kill or a power cut cannot leave half done, and reading that checks."""

from __future__ import annotations

import errno
import hashlib
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from shlex import quote

from ..core.disk import open_regular, reason
from ..core.errors import SessionError
from ..output.file import Buffer, fsync_folder, is_temporary, temporary_name, write_all

#: Folder of the frames in a session.
FRAMES = "frames"


@dataclass(frozen=True)
class StoredFile:
    """A file as the journal records it.

    Parameters
    ----------
    name : str
        Path inside the session's folder, with forward slashes.
    sha256 : str
        SHA-256 of its bytes, in hexadecimal.
    size : int
        Its length in bytes.
    """

    name: str
    sha256: str
    size: int


def write_whole(folder: Path, name: str, data: Buffer) -> StoredFile:
    """Write a file under a temporary name, flush it to the disk, then give it its name.

    Whenever the process is killed, there is the whole file or none of that name; what may stay behind is a
    temporary file, see `remove_partial`. A file that has the name already is replaced.

    Raises
    ------
    OSError
        If it cannot be written; then no temporary file is left behind.
    """
    (stored,) = write_several(folder, [(name, (data,))])
    return stored


def write_several(folder: Path, files: Iterable[tuple[str, Sequence[Buffer]]]) -> list[StoredFile]:
    """Write files as `write_whole` does, and flush their folder once; all are of one folder below `folder`.

    Parameters
    ----------
    folder : Path
        Where names begin.
    files : iterable of (str, sequence of bytes)
        Names and contents in parts, taken one by one and not kept.

    Raises
    ------
    OSError
        If one cannot be written; then none of them has its name, and no temporary file is left behind.
    """
    written: list[StoredFile] = []
    partials: list[Path] = []
    named: list[Path] = []
    try:
        for name, parts in files:
            partials.append(temporary_name(folder / name))
            digest, size = hashlib.sha256(), 0
            with open(partials[-1], "xb", buffering=0) as file:
                for data in parts:
                    write_all(file.fileno(), data)
                    digest.update(data)
                    size += memoryview(data).nbytes
                os.fsync(file.fileno())
            written.append(StoredFile(name, digest.hexdigest(), size))
        for partial, stored in zip(partials, written, strict=True):
            os.rename(partial, folder / stored.name)
            named.append(folder / stored.name)
    except BaseException:
        for path in (*partials, *(named if len(partials) > 1 else ())):
            with suppress(OSError):
                path.unlink(missing_ok=True)
        raise
    for parent in dict.fromkeys(path.parent for path in named):
        fsync_folder(parent)
    return written


def remove_partial(folder: Path) -> None:
    """Remove temporary files that a killed `write_whole` left in a folder."""
    for path in folder.iterdir():
        if is_temporary(path) and path.is_file():
            path.unlink()


def read_checked(folder: Path, stored: StoredFile) -> bytes:
    """Read a recorded file and check it against its record.

    Raises
    ------
    SessionError
        If it is missing, shorter or longer than recorded, altered, or cannot be read.
    """
    path = folder / stored.name
    # Not Path.exists, which raises for a name that is too long.
    if not os.path.exists(path):
        raise SessionError(f"{path} is missing: {_again(folder, stored)}")
    with reported(path, "read"), open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size
        data = file.read() if size == stored.size else b""
    if size < stored.size:
        fault = f"is truncated: {size} of {stored.size} bytes are left"
    elif size > stored.size:
        fault = f"was altered: it has {size} bytes, {stored.size} were recorded"
    elif hashlib.sha256(data).hexdigest() != stored.sha256:
        fault = "was altered: its SHA-256 is not the recorded one"
    else:
        return data
    raise SessionError(f"{path} {fault}; {_again(folder, stored)}")


def _again(folder: Path, stored: StoredFile) -> str:
    remedy = "restore it from a copy of the session"
    if not stored.name.startswith(f"{FRAMES}/"):
        return remedy
    command = f"labcdp acquire {quote(str(folder / 'session.toml'))} {quote(str(folder))} --replace-damaged"
    return f"{remedy}, or record it again: {command}"


@contextmanager
def reported(path: Path, done: str) -> Iterator[None]:
    """Turn an OSError into a SessionError that names the file and the remedy; `done` is "read" or "written"."""
    try:
        yield
    except FileNotFoundError as error:
        # A file to be written cannot be missing, but its folder can.
        what = path if done == "read" or path.parent.is_dir() else path.parent
        raise SessionError(f"{what} is missing: restore it from a copy of the session") from error
    except OSError as error:
        remedies = {
            errno.EACCES: f"give yourself the right to have it {done}",
            errno.EPERM: f"give yourself the right to have it {done}",
            errno.EROFS: "use a folder on a disk you may write to",
            errno.ENOSPC: "free some space on the disk and record it again",
            errno.EDQUOT: "free some of your disk quota and record it again",
            errno.EFBIG: "raise the limit of the file size and record it again",
        }
        remedy = remedies.get(error.errno or 0, "check the path and the disk")
        raise SessionError(f"{path} cannot be {done} ({reason(error)}): {remedy}") from error
