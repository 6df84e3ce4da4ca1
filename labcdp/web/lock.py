"""Lock of a region file: one process at a time edits it."""

from __future__ import annotations

import errno
import fcntl
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..core.errors import InputError
from ..report.text import printable

#: Upper limit of the size of a lock file's content.
_MOST_BYTES = 400

#: First line of a lock file.
_OURS = b"process "


@contextmanager
def locked(output: Path) -> Iterator[Callable[[str], None]]:
    """Lock a region file for this process by a hidden file in the same folder, which is removed at the end.

    Parameters
    ----------
    output : Path
        Region file; it need not exist.

    Yields
    ------
    callable
        Publishes the address of this process's page to other processes.

    Raises
    ------
    InputError
        If another process holds the lock, or it cannot be created.

    Notes
    -----
    The kernel releases the lock (flock) when the process ends, so a file left by a killed process locks nothing.
    """
    path = output.with_name(f".{output.name}.lock")
    descriptor = _taken(path, output)
    try:
        _tell(descriptor, f"process {os.getpid()}")
        yield lambda where: _tell(descriptor, f"process {os.getpid()}, {where}")
    finally:
        # Remove it while locked: afterwards it may belong to another process.
        with suppress(OSError):
            path.unlink()
        os.close(descriptor)


def _taken(path: Path, output: Path) -> int:
    """Descriptor of the locked lock file."""
    while True:
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o644)
        except OSError as error:
            raise _impossible(path, output, error) from error
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.pread(descriptor, len(_OURS), 0) not in (b"", _OURS):
                raise FileExistsError(errno.EEXIST, "it is no lock of labcdp")
            if _is_still(path, descriptor):
                return descriptor
        except BlockingIOError as error:
            holder = printable(os.pread(descriptor, _MOST_BYTES, 0).decode(errors="replace")) or "another process"
            os.close(descriptor)
            raise InputError(
                f"{output} is in use by another labcdp ({holder}): end that one first, or give another region file"
            ) from error
        except OSError as error:
            os.close(descriptor)
            raise _impossible(path, output, error) from error
        # Removed by its previous holder in the meantime.
        os.close(descriptor)


def _is_still(path: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(os.stat(path, follow_symlinks=False), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def _impossible(path: Path, output: Path, error: OSError) -> InputError:
    return InputError(f"{output} cannot be locked ({path.name}: {error.strerror}): give one in another folder")


def _tell(descriptor: int, text: str) -> None:
    with suppress(OSError):  # disk full: the lock holds without content
        os.pwrite(descriptor, text.encode(), 0)
        os.ftruncate(descriptor, len(text.encode()))
