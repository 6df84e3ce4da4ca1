"""Verifications as JSON files, units in the keys."""

from __future__ import annotations

import json
from pathlib import Path

from ..errors import InputError
from .verification import Verification

#: Value of the key ``format`` of every file.
FORMAT = "labcdp-verification"
#: Version this program writes, and the only one it reads.
VERSION = 2


def save_verification(verification: Verification, path: str | Path) -> None:
    """Write a verification to a JSON file, whole or not at all; an existing file is replaced.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    from pydantic import TypeAdapter

    from ..session.files import write_whole

    path = Path(path)
    content = TypeAdapter(Verification).dump_python(verification, mode="json")
    document = {"format": FORMAT, "version": VERSION, "verification": content}
    text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    try:
        write_whole(path.parent, path.name, text.encode())
    except OSError as error:
        raise InputError(f"verification {path} cannot be written: {error.strerror or error}") from error


def load_verification(path: str | Path) -> Verification:
    """Read a verification that `save_verification` wrote.

    Raises
    ------
    InputError
        If the file cannot be read, is no verification, has another version, or an unusable value.
    """
    from pydantic import TypeAdapter, ValidationError

    path = Path(path)
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"verification {path} cannot be read: {error.strerror or error}") from error
    except ValueError as error:
        raise InputError(f"verification {path} is not valid JSON: {error}") from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise InputError(f"{path} is not a verification: its key format is not {FORMAT!r}; give one that labcdp saved")
    if document.get("version") != VERSION:
        raise InputError(
            f"verification {path} has version {document.get('version')!r}, this labcdp reads version {VERSION}: use "
            "the labcdp that wrote it, or verify again"
        )
    try:
        content = json.dumps(document.get("verification"))
        return TypeAdapter(Verification).validate_json(content, strict=True)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"]) or "verification"
        raise InputError(f"verification {path}, key {place}: {first['msg']}") from error
