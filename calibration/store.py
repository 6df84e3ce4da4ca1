"""Calibrations as JSON files, units in the keys, with their arrays in a NumPy file beside.

The arrays' file is named by its content and written before the JSON text that names it, so whenever a program is
killed, a JSON text and the arrays it means are there together, or the older pair still is.
"""

from __future__ import annotations

import hashlib
import json
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError

if TYPE_CHECKING:
    from .colour import ColourCalibration
    from .model import Calibration

AnyCalibration: TypeAlias = "Calibration | ColourCalibration"

#: Value of the key ``format`` of every file.
FORMAT = "labcdp-calibration"
#: Version this program writes, and the only one it reads.
VERSION = 2
#: What a file can hold: value of the key ``kind``, module and class.
_KINDS = {"monochrome": ("model", "Calibration"), "colour": ("colour", "ColourCalibration")}


def save(calibration: AnyCalibration, path: str | Path) -> None:
    """Write a calibration to a JSON file, and its arrays to ``<name>.<hash>.npz`` beside it; replaces what is there.

    Whatever happens, the file can be read afterwards: as it was, or as it is now.

    Raises
    ------
    InputError
        If a file cannot be written.
    """
    from pydantic import TypeAdapter

    from ..session.files import write_whole

    path = Path(path)
    kind = next(kind for kind, (_, name) in _KINDS.items() if name == type(calibration).__name__)
    arrays: dict[str, NDArray[Any]] = {}
    content = TypeAdapter(type(calibration)).dump_python(calibration, mode="json", context={"arrays": arrays})
    data = _npz(arrays) if arrays else None
    beside = None
    if data is not None:
        digest = hashlib.sha256(data).hexdigest()
        beside = {"file": f"{path.stem}.{digest[:16]}.npz", "sha256": digest}
    signed = {"kind": kind, "arrays": beside, "calibration": content}
    document = {"format": FORMAT, "version": VERSION, "sha256": _digest(signed), **signed}
    text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    older = _file_of_arrays(path)
    try:
        if data is not None and beside is not None:
            write_whole(path.parent, beside["file"], data)
        write_whole(path.parent, path.name, text.encode())
        if older is not None and older != (beside or {}).get("file"):
            (path.parent / older).unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"calibration {path} cannot be written: {error.strerror or error}") from error


def load_any(path: str | Path) -> AnyCalibration:
    """Read a calibration of any kind that `save` wrote.

    Raises
    ------
    InputError
        If the file or the arrays beside it cannot be read, it is no calibration, has another version, a missing,
        unknown or unusable value, or one of the two was changed after it was written.
    """
    path = Path(path)
    document = _document(path)
    kind = document.get("kind")
    if kind not in _KINDS:
        raise InputError(f"calibration {path} has kind {kind!r}: this labcdp knows {', '.join(_KINDS)}")
    content, beside = document.get("calibration"), document.get("arrays")
    arrays = {} if beside is None else _arrays(path, beside)
    calibration: Calibration | ColourCalibration = _validated(_class(kind), content, arrays, path)
    if document.get("sha256") != _digest({"kind": kind, "arrays": beside, "calibration": content}):
        raise InputError(
            f"calibration {path} was changed after it was written (its sha256 does not match): restore the original, "
            "or calibrate again"
        )
    return calibration


def load(path: str | Path) -> Calibration:
    """Read the calibration of a monochrome camera; as `load_any`, and refuses that of a colour camera."""
    from .model import Calibration

    calibration = load_any(path)
    if not isinstance(calibration, Calibration):
        raise InputError(f"calibration {path} is for a colour camera: give one of a monochrome camera")
    return calibration


def calibration_schema(kind: str = "monochrome") -> dict[str, Any]:
    """JSON schema (2020-12) of a file, as pydantic writes it.

    Parameters
    ----------
    kind : {'monochrome', 'colour'}
        What the file holds.
    """
    from pydantic import TypeAdapter

    schema = TypeAdapter(_class(kind)).json_schema(mode="serialization", ref_template="#/$defs/{model}")
    definitions = schema.pop("$defs", {})
    text, sha256 = {"type": "string"}, {"type": "string", "pattern": "^[0-9a-f]{64}$"}
    beside = {"type": "object", "properties": {"file": text, "sha256": sha256}, "required": ["file", "sha256"]}
    properties = {
        "format": {"const": FORMAT},
        "version": {"const": VERSION},
        "sha256": sha256,
        "kind": {"const": kind},
        "arrays": {"anyOf": [beside, {"type": "null"}]},
        "calibration": schema,
    }
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"labcdp calibration, {kind}",
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
        "$defs": definitions,
    }


def file_sha256(path: str | Path) -> str:
    """Hash that stands in a calibration's file and tells it from any other; raises InputError as `load_any`."""
    return str(_document(Path(path)).get("sha256"))


def _class(kind: str) -> Any:
    module, name = _KINDS[kind]
    return getattr(import_module(f".{module}", __package__), name)


def _document(path: Path) -> dict[str, Any]:
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
    version = document.get("version")
    if version != VERSION:
        newer = isinstance(version, int) and version > VERSION
        remedy = "use a newer labcdp" if newer else "calibrate again"
        raise InputError(f"calibration {path} has version {version!r}, this labcdp reads version {VERSION}: {remedy}")
    return document


def _arrays(path: Path, beside: Any) -> dict[str, NDArray[Any]]:
    """Read the arrays beside; the file must lie beside, whatever a name says."""
    name = beside.get("file") if isinstance(beside, dict) else None
    if not isinstance(name, str) or Path(name).name != name or not isinstance(beside.get("sha256"), str):
        raise InputError(f"calibration {path}, key arrays: it names no file beside it")
    file = path.parent / name
    try:
        data = file.read_bytes()
    except OSError as error:
        raise InputError(
            f"{file}, which holds the arrays of calibration {path.name}, cannot be read ({error.strerror or error}): "
            "copy both files together"
        ) from error
    if hashlib.sha256(data).hexdigest() != beside["sha256"]:
        raise InputError(
            f"{file}, which holds the arrays of calibration {path.name}, was changed after it was written: restore the "
            "original, or calibrate again"
        )
    with np.load(BytesIO(data), allow_pickle=False) as archive:
        return {key: archive[key] for key in archive.files}


def _npz(arrays: dict[str, NDArray[Any]]) -> bytes:
    file = BytesIO()
    np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
    return file.getvalue()


def _file_of_arrays(path: Path) -> str | None:
    """Name of the arrays' file of the calibration that `save` is about to replace; None if there is none."""
    try:
        name = _document(path)["arrays"]["file"]
    except (InputError, KeyError, TypeError):
        return None
    ours = isinstance(name, str) and Path(name).name == name and name.startswith(f"{path.stem}.")
    return name if ours and name.endswith(".npz") else None


def _validated(kind: Any, content: Any, arrays: dict[str, NDArray[Any]], path: Path) -> Any:
    from pydantic import TypeAdapter, ValidationError

    adapter = TypeAdapter(kind)
    try:
        calibration = adapter.validate_json(json.dumps(content), strict=True, context={"arrays": arrays})
    except ValidationError as error:
        # Of a field with several types, keys that the others have are missing too.
        errors = error.errors()
        first = next((one for one in errors if one["type"] != "missing"), errors[0])
        place = ".".join(str(part) for part in first["loc"]) or "calibration"
        raise InputError(f"calibration {path}, key {place}: {first['msg']}") from error
    unknown = _unknown_key(content, adapter.dump_python(calibration, mode="json", context={"arrays": {}}))
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
