"""One process at a time draws for one file of regions."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..errors import InputError
from ..report.digits import printable

#: More than a process writes into the lock file about itself.
_MOST_BYTES = 400


@contextmanager
def locked(output: Path) -> Iterator[Callable[[str], None]]:
    """Hold a file of regions for this process, by a lock on a hidden file beside it that is removed at the end.

    Parameters
    ----------
    output : Path
        File of regions; it need not exist.

    Yields
    ------
    callable
        Tells other processes where this one's page is.

    Raises
    ------
    InputError
        If another process holds it, or there can be no lock.

    Notes
    -----
    The lock is the kernel's (flock) and ends with the process, so what a killed process leaves locks nothing.
    """
    path = output.with_name(f".{output.name}.lock")
    descriptor = _taken(path, output)
    try:
        _tell(descriptor, f"process {os.getpid()}")
        yield lambda where: _tell(descriptor, f"process {os.getpid()}, {where}")
    finally:
        # While it is still locked: afterwards it may be another's.
        with suppress(OSError):
            path.unlink()
        os.close(descriptor)


def _taken(path: Path, output: Path) -> int:
    """Descriptor of the lock file, locked."""
    while True:
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o644)
        except OSError as error:
            raise _impossible(path, output, error) from error
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if _is_still(path, descriptor):
                return descriptor
        except BlockingIOError as error:
            holder = printable(os.pread(descriptor, _MOST_BYTES, 0).decode(errors="replace")) or "another process"
            os.close(descriptor)
            raise InputError(
                f"{output} is in use by another labcdp rois ({holder}): end that one first, or give another --output"
            ) from error
        except OSError as error:
            os.close(descriptor)
            raise _impossible(path, output, error) from error
        # Its holder removed it meanwhile.
        os.close(descriptor)


def _is_still(path: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(os.stat(path, follow_symlinks=False), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def _impossible(path: Path, output: Path, error: OSError) -> InputError:
    return InputError(f"{output} cannot be locked ({path.name}: {error.strerror}): give --output in another folder")


def _tell(descriptor: int, text: str) -> None:
    with suppress(OSError):  # a full disk: the lock holds without it
        os.pwrite(descriptor, text.encode(), 0)
        os.ftruncate(descriptor, len(text.encode()))
