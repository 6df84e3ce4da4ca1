"""The place of a folder of results: made, locked, and with a subfolder in which files wait."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterable
from contextlib import ExitStack, suppress
from pathlib import Path

from ..core.errors import InputError
from .file import cannot_be_written
from .file_list import LIST_FILE


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
