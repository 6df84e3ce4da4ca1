"""Files written whole or not at all: under a temporary name, flushed to the disk, then renamed."""

from __future__ import annotations

import errno
import hashlib
import os
import re
import secrets
import stat
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from os import PathLike
from pathlib import Path, PurePosixPath
from typing import TypeAlias

from ..core.disk import open_regular, reading
from ..core.disk.files import FILE_KINDS
from ..core.errors import InputError

Buffer: TypeAlias = bytes | memoryview

#: Errors of file systems that have no hard links.
_NO_LINKS = {errno.EPERM, errno.EACCES, errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTSUP, errno.EMLINK}


@dataclass(frozen=True)
class StoredFile:
    """A file as it was written.

    Parameters
    ----------
    name : str
        Path inside its folder, with forward slashes.
    sha256 : str
        SHA-256 of its bytes, in hexadecimal.
    size : int
        Length in bytes.
    """

    name: str
    sha256: str
    size: int

    @classmethod
    def of(cls, folder: Path, name: str) -> StoredFile:
        """Describe a file; raises OSError if it cannot be read."""
        with open_regular(folder / name) as file:
            return cls(name, hashlib.file_digest(file, "sha256").hexdigest(), os.fstat(file.fileno()).st_size)

    def is_unchanged(self, folder: Path) -> bool:
        """Whether the file is there, in real folders, with the content it was written with."""
        if not is_inside(folder, self.name):
            return False
        try:
            state = (folder / self.name).lstat()
            return stat.S_ISREG(state.st_mode) and state.st_size == self.size and self.of(folder, self.name) == self
        except OSError:
            return False


def is_inside(folder: Path, name: str) -> bool:
    """Whether the subfolders of a name are folders, and no links to elsewhere."""
    parents = [folder / parent for parent in PurePosixPath(name).parents if parent != PurePosixPath(".")]
    return not any(os.path.lexists(parent) and (parent.is_symlink() or not parent.is_dir()) for parent in parents)


def write_file(path: str | PathLike[str], data: Buffer, *, force: bool = False) -> None:
    """Write a file as `write_several` does.

    Parameters
    ----------
    path : path-like
        File to be written.
    data : bytes
        Its content.
    force : bool
        Whether an existing file is replaced.

    Raises
    ------
    InputError
        If it exists and is not to be replaced, also if it appeared meanwhile, or cannot be written; then no temporary
        file is left behind.

    Examples
    --------
    >>> from pathlib import Path
    >>> from labcdp.output import write_file
    >>> write_file("note.txt", b"measured at noon")
    >>> Path("note.txt").read_text()
    'measured at noon'
    """
    path = Path(path)
    with writing(path):
        try:
            write_several(path.parent, [(path.name, (data,))], force=force)
        except FileExistsError as error:
            raise file_exists(path) from error


def write_several(
    folder: Path, files: Iterable[tuple[str, Sequence[Buffer]]], *, force: bool = True
) -> list[StoredFile]:
    """Write files under temporary names, flush them to the disk, then give them their names.

    Whenever the process is killed, there is the whole file or none of a name; what may stay behind are temporary files
    (`is_temporary`).

    Parameters
    ----------
    folder : Path
        Where names begin.
    files : iterable of (str, sequence of bytes)
        Names and contents in parts, taken one by one and not kept.
    force : bool
        Whether a file that has the name already is replaced.

    Raises
    ------
    FileExistsError
        If there is a file of that name, and `force` is false.
    OSError
        If one cannot be written; then none of several has its name, and no temporary file is left behind.
    """
    written: list[StoredFile] = []
    partials: list[Path] = []
    named: list[Path] = []
    try:
        # Hashed while the disk is waited for: the hash of a frame may take longer than the disk.
        with ThreadPoolExecutor(1) as hashing:
            for name, parts in files:
                partials.append(temporary_name(folder / name))
                digest = hashing.submit(_sha256, parts)
                with open(partials[-1], "xb", buffering=0) as file:
                    for data in parts:
                        write_all(file.fileno(), data)
                    os.fsync(file.fileno())
                    _forget(file.fileno())
                size = sum(memoryview(data).nbytes for data in parts)
                written.append(StoredFile(name, digest.result(), size))
        for partial, stored in zip(partials, written, strict=True):
            put_in_place(partial, folder / stored.name, force=force)
            named.append(folder / stored.name)
    except BaseException:
        for path in (*partials, *(named if len(partials) > 1 else ())):
            with suppress(OSError):
                path.unlink(missing_ok=True)
        raise
    for parent in dict.fromkeys(path.parent for path in named):
        fsync_folder(parent)
    return written


def _sha256(parts: Sequence[Buffer]) -> str:
    digest = hashlib.sha256()
    for data in parts:
        digest.update(data)
    return digest.hexdigest()


def put_in_place(part: Path, path: Path, *, force: bool = False) -> None:
    """Give a whole file its name.

    Raises
    ------
    FileExistsError
        If there is a file of that name, and `force` is false.
    InputError
        If `force` is true, and what has that name is no file, as `require_replaceable`.
    OSError
        If it cannot be done.
    """
    if force:
        require_replaceable(path)
        part.replace(path)
        return
    try:
        # Unlike a renaming, a link never replaces a file that appeared meanwhile.
        os.link(part, path)
    except FileExistsError:
        raise
    except OSError as error:
        if error.errno not in _NO_LINKS:
            raise
        if os.path.lexists(path):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path)) from error
        part.rename(path)
    else:
        part.unlink()


def require_replaceable(path: Path, name: str = "") -> None:
    """Raise InputError if a path, called `name` in messages, leads to anything but a regular file or to nothing at all.

    Devices, pipes and sockets are never replaced, nor are links to them or to nowhere.
    """
    if not os.path.lexists(path):
        return
    try:
        mode = path.stat().st_mode
    except OSError as error:
        why = "is a link that leads nowhere" if path.is_symlink() else f"cannot be looked at ({error.strerror})"
        raise InputError(f"{name or path} {why}: choose another name") from error
    if not stat.S_ISREG(mode):
        kind = FILE_KINDS.get(stat.S_IFMT(mode), "not a regular file")
        raise InputError(f"{name or path} is {kind}, and labcdp replaces only files: choose another name")


def temporary_name(path: Path) -> Path:
    """Return a new hidden name in the same folder, with the same suffix."""
    return path.with_name(f".labcdp-{secrets.token_hex(8)}.part{path.suffix[:16]}")


def is_temporary(path: Path) -> bool:
    """Whether this is a temporary file that a kill left behind."""
    return re.fullmatch(r"\.labcdp-[0-9a-f]{16}\.part(\..*)?", path.name) is not None


def write_all(descriptor: int, data: Buffer) -> None:
    """Write all bytes; a call that takes only some is repeated, and on a full disk then raises its OSError."""
    view = memoryview(data)
    written = os.write(descriptor, view)
    while written < view.nbytes:
        written += os.write(descriptor, view[written:])


def _forget(descriptor: int) -> None:
    """Free the kernel's copy of a flushed file: a recording would fill the memory, whose first use takes time."""
    with suppress(OSError, AttributeError):  # not on all systems
        os.posix_fadvise(descriptor, 0, 0, os.POSIX_FADV_DONTNEED)


def fsync_folder(folder: Path) -> None:
    """Flush a folder's entries to the disk, so that a new name outlives a power cut."""
    if not hasattr(os, "O_DIRECTORY"):  # Windows has no such call
        return
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def lock(descriptor: int) -> bool:
    """Keep other processes from locking a file or folder until it is closed; False where there are no such locks.

    Raises
    ------
    BlockingIOError
        If another process holds it.
    """
    try:
        import fcntl  # not on all systems

        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except (ImportError, OSError):  # also of some network file systems
        return False
    return True


def make_folder(folder: Path, end: ExitStack) -> None:
    """Make a folder; at the end those that were made and are empty are removed; raises InputError."""
    made: list[Path] = []

    def remove_empty() -> None:
        for path in made:
            with suppress(OSError):  # not empty: it holds the results
                path.rmdir()

    end.callback(remove_empty)
    with writing(folder):
        try:
            made += [path for path in (folder, *folder.parents) if not path.exists()]
            folder.mkdir(parents=True, exist_ok=True)
        except FileExistsError as error:
            raise InputError(f"{folder} is not a folder: choose another folder") from error
        except NotADirectoryError as error:
            raise InputError(f"{folder} lies inside a file: choose another folder") from error


def lock_folder(folder: Path, end: ExitStack) -> bool:
    """Keep other processes of labcdp from writing into a folder until the end; False where there are no such locks."""
    if not hasattr(os, "O_DIRECTORY"):  # Windows
        return False
    with reading(folder, "another folder"):
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    end.callback(os.close, descriptor)
    try:
        return lock(descriptor)
    except BlockingIOError as error:
        raise InputError(
            f"another labcdp writes to {folder}: wait for it to finish, or choose another folder"
        ) from error


def file_exists(path: Path, option: str = "") -> InputError:
    """Return the error for a file that exists and is not to be replaced; `option` named it on the command line."""
    force = "add --force" if option else "use force"
    return InputError(f"{f'{option} {path}'.lstrip()} exists: choose another name, or {force} to replace it")


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn an OSError into an InputError that names the file or folder, and says what to do."""
    try:
        yield
    except OSError as error:
        raise InputError(
            f"{path} cannot be written ({error.strerror or error}): choose a folder you can write to, on a disk with "
            "enough space"
        ) from error
