"""Calibrations as JSON files, units in the keys."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from ..errors import InputError
from .model import Calibration

#: Value of the key ``format`` of every file.
FORMAT = "labcdp-calibration"
#: Version this program writes, and the only one it reads.
VERSION = 1


def save(calibration: Calibration, path: str | Path) -> None:
    """Write a calibration to a JSON file, whole or not at all; an existing file is replaced.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    from pydantic import TypeAdapter

    from ..session.files import write_whole

    path = Path(path)
    content = TypeAdapter(Calibration).dump_python(calibration, mode="json")
    document = {"format": FORMAT, "version": VERSION, "sha256": _digest(content), "calibration": content}
    text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    try:
        write_whole(path.parent, path.name, text.encode())
    except OSError as error:
        raise InputError(f"calibration {path} cannot be written: {error.strerror or error}") from error


def load(path: str | Path) -> Calibration:
    """Read a calibration that `save` wrote.

    Raises
    ------
    InputError
        If the file cannot be read, is no calibration, has another version, a missing, unknown or unusable
        value, or was changed after it was written.
    """
    path = Path(path)
    try:
        document = json.loads(path.read_text(encoding="utf-8"), parse_constant=_refuse_constant)
    except OSError as error:
        raise InputError(f"calibration {path} cannot be read: {error.strerror or error}") from error
    except ValueError as error:
        raise InputError(f"calibration {path} is not valid JSON: {error}") from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise InputError(
            f"{path} is not a calibration: its key format is not {FORMAT!r}; give a file that labcdp saved"
        )
    if document.get("version") != VERSION:
        raise InputError(
            f"calibration {path} has version {document.get('version')!r}, this labcdp reads version {VERSION}: use the "
            "labcdp that wrote it, or calibrate again"
        )
    content = document.get("calibration")
    calibration = _validated(content, path)
    if document.get("sha256") != _digest(content):
        raise InputError(
            f"calibration {path} was changed after it was written (its sha256 does not match): restore the original, "
            "or calibrate again"
        )
    return calibration


def _validated(content: Any, path: Path) -> Calibration:
    from pydantic import TypeAdapter, ValidationError

    adapter = TypeAdapter(Calibration)
    try:
        calibration = adapter.validate_json(json.dumps(content), strict=True)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"]) or "calibration"
        raise InputError(f"calibration {path}, key {place}: {first['msg']}") from error
    unknown = _unknown_key(content, adapter.dump_python(calibration, mode="json"))
    if unknown:
        raise InputError(f"calibration {path} has an unknown key {unknown}: remove it")
    return calibration


def _unknown_key(content: Any, known: Any) -> str | None:
    """First key of `content` that `known` lacks, with its place; pydantic skips unknown keys of dataclasses."""
    if isinstance(content, dict) and isinstance(known, dict):
        pairs = [(key, content[key], known.get(key)) for key in content]
        missing = next((key for key in content if key not in known), None)
        if missing is not None:
            return str(missing)
    elif isinstance(content, list) and isinstance(known, list):
        pairs = [(str(i), a, b) for i, (a, b) in enumerate(zip(content, known, strict=True))]
    else:
        return None
    for key, a, b in pairs:
        below = _unknown_key(a, b)
        if below is not None:
            return f"{key}.{below}"
    return None


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name} is not a number")


def _digest(content: Any) -> str:
    canonical = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(canonical.encode()).hexdigest()
