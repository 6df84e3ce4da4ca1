"""One file, written whole or not at all, and the place of a folder of results."""

from __future__ import annotations

import errno
import os
import re
import secrets
from collections.abc import Iterable
from contextlib import ExitStack, suppress
from os import PathLike
from pathlib import Path
from typing import TypeAlias

from ..core.errors import InputError
from .file_list import LIST_FILE, by_name, read_list

Buffer: TypeAlias = bytes | memoryview

#: Errors of file systems that have no hard links.
_NO_LINKS = {errno.EPERM, errno.EACCES, errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTSUP, errno.EMLINK}


def check_file(
    path: str | PathLike[str], *, force: bool = False, inputs: Iterable[Path] = (), option: str = "--output"
) -> Path:
    """Check that a file can be written, before the work whose result it will hold.

    Parameters
    ----------
    path : path-like
        File to be written.
    force : bool
        Whether an existing file may be replaced.
    inputs : iterable of Path
        Files that are never replaced, and folders in which none is.
    option : str
        Option of the command line that names the file, for messages; empty in Python.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        If it exists and may not be replaced, is a folder, an input, or one of the results in a folder of labcdp, or its
        folder is missing or not writable.
    """
    path = Path(path)
    name = f"{option} {path}".lstrip()
    try:
        is_folder, has_folder = path.is_dir(), path.parent.is_dir()
    except OSError as error:  # as of a name that is too long
        raise cannot_be_written(path, error) from error
    if is_folder:
        raise InputError(f"{name} is a folder: give the name of a file")
    if any(_is_input(path, one) for one in inputs):
        raise InputError(f"{name} is an input of this command: give another name")
    if os.path.lexists(path):
        if not force:
            raise _exists(path, option)
        _require_no_result(path, name)
    if not has_folder:
        raise InputError(f"{name} cannot be written: {path.parent} is not a folder; give one that exists")
    if not os.access(path.parent, os.W_OK):
        raise InputError(f"{name} cannot be written: you may not write to {path.parent}; give another folder")
    return path


def write_file(path: str | PathLike[str], data: Buffer, *, force: bool = False) -> None:
    """Write a file under a temporary name in the same folder, flush it to the disk, then give it its name.

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
    """
    path = Path(path)
    part = temporary_name(path)
    try:
        try:
            with open(part, "xb", buffering=0) as file:
                write_all(file.fileno(), data)
                os.fsync(file.fileno())
            put_in_place(part, path, force=force)
        finally:
            with suppress(OSError):
                part.unlink(missing_ok=True)
        fsync_folder(path.parent)
    except FileExistsError as error:
        raise _exists(path, "") from error
    except OSError as error:
        raise cannot_be_written(path, error) from error


def put_in_place(part: Path, path: Path, *, force: bool = False) -> None:
    """Give a whole file its name.

    Raises
    ------
    FileExistsError
        If there is a file of that name, and `force` is false.
    OSError
        If it cannot be done.
    """
    if force:
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


def temporary_name(path: Path) -> Path:
    """Return a new hidden name in the same folder, with the same suffix."""
    return path.with_name(f".labcdp-{secrets.token_hex(8)}.part{path.suffix[:16]}")


def is_temporary(path: Path) -> bool:
    """Whether this is a temporary file that a kill left behind."""
    return re.fullmatch(r"\.labcdp-[0-9a-f]{16}\.part(\..*)?", path.name) is not None


def is_same_file(one: Path, other: Path) -> bool:
    """Whether two paths lead to one file; False if one of them leads nowhere."""
    try:
        return os.path.samefile(one, other)
    except OSError:
        return False


def _is_input(path: Path, one: Path) -> bool:
    """Whether a file is an input, or exists already in an input folder."""
    inside = one.is_dir() and os.path.lexists(path) and path.parent.resolve().is_relative_to(one.resolve())
    return inside or is_same_file(path, one)


def _require_no_result(path: Path, name: str) -> None:
    """Refuse a file that the list of a results folder names, or the list itself."""
    place = path.parent.resolve() / path.name
    for folder in place.parents:
        listed = read_list(folder)
        if listed and (place == folder / LIST_FILE or place.relative_to(folder).as_posix() in by_name(listed.files)):
            raise InputError(f"{name} belongs to the results of labcdp {listed.command}: give another name")


def write_all(descriptor: int, data: Buffer) -> None:
    """Write all bytes; a call that takes only some is repeated, and on a full disk then raises its OSError."""
    view = memoryview(data)
    written = os.write(descriptor, view)
    while written < view.nbytes:
        written += os.write(descriptor, view[written:])


def fsync_folder(folder: Path) -> None:
    """Flush a folder's entries to the disk, so that a new name outlives a power cut."""
    if not hasattr(os, "O_DIRECTORY"):  # Windows has no such call
        return
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def cannot_be_written(path: Path, error: OSError) -> InputError:
    """Return the error for a file or folder that cannot be written."""
    return InputError(
        f"{path} cannot be written ({error.strerror or error}): give a folder you can write to, on a disk with enough "
        "space"
    )


def _exists(path: Path, option: str) -> InputError:
    force = "--force" if option else "force=True"
    return InputError(f"{f'{option} {path}'.lstrip()} exists: give another name, or {force} to replace it")


def make_folder(folder: Path, end: ExitStack) -> None:
    """Make a folder; at the end those that were made and are empty are removed.

    Raises
    ------
    InputError
        If it cannot be made.
    """
    try:
        made = [path for path in (folder, *folder.parents) if not path.exists()]
        end.callback(_remove_empty, made)
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        raise InputError(f"{folder} is not a folder: give another --output") from error
    except NotADirectoryError as error:
        raise InputError(f"{folder} lies in a file: give another --output") from error
    except OSError as error:
        raise cannot_be_written(folder, error) from error


def lock_folder(folder: Path, end: ExitStack) -> bool:
    """Keep other processes of labcdp from writing into a folder until the end.

    Returns
    -------
    bool
        False where there are no such locks.

    Raises
    ------
    InputError
        If another process holds it.
    """
    try:
        import fcntl
    except ImportError:
        return False
    try:
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    except OSError as error:
        raise InputError(f"{folder} cannot be read ({error.strerror}): give another --output") from error
    end.callback(os.close, descriptor)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise InputError(f"another labcdp writes to {folder}: wait until it ends, or give another --output") from error
    except OSError:  # some network file systems
        return False
    return True


def staging_name(folder: Path) -> Path:
    """Return a new name of a subfolder in which files wait."""
    return folder / f".labcdp-{secrets.token_hex(8)}.unfinished"


def is_staging(path: Path) -> bool:
    """Whether this is a subfolder in which files waited, left behind by a kill: by its name and its mark."""
    is_named = path.name.startswith(".labcdp-") and path.name.endswith(".unfinished")
    return is_named and not path.is_symlink() and (path / LIST_FILE).is_file()


def _remove_empty(folders: Iterable[Path]) -> None:
    for one in folders:
        with suppress(OSError):  # not empty: it holds the results
            one.rmdir()
