"""Verifications as JSON files, units in the keys."""

from __future__ import annotations

from pathlib import Path

from ...core.errors import InputError
from ..record.document import dumped, json_text, loaded, read_document
from .result import Verification

#: Value of the key ``format`` of every file.
FORMAT = "labcdp-verification"
#: Version this program writes, and the only one it reads.
VERSION = 4


def save_verification(verification: Verification, path: str | Path, *, force: bool = False) -> None:
    """Write a verification to a JSON file atomically; with `force` an existing file is replaced.

    Raises
    ------
    InputError
        If the file exists or cannot be written.
    """
    from ...output import write_file

    content = {"verdict": verification.verdict, "verification": dumped(verification, Verification)}
    write_file(path, json_text({"format": FORMAT, "version": VERSION, **content}), force=force)


def load_verification(path: str | Path) -> Verification:
    """Read a verification that `save_verification` wrote.

    Raises
    ------
    InputError
        If the file cannot be read, is no verification, has another version, or a missing, unknown or wrong value.
    """
    document = read_document(Path(path), "verification", FORMAT, VERSION, "verify again")
    try:
        return loaded(document.get("verification"), Verification)
    except InputError as error:
        raise InputError(f"verification {path}, {error}") from error
