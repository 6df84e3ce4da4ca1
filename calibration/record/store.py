"""Calibrations as JSON files, units in the keys; arrays are compressed in the same file."""

from __future__ import annotations

import hashlib
import json
from base64 import b64decode, b64encode
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np

from ...core.disk import quoted
from ...core.disk.arrays import parse_npz
from ...core.errors import InputError
from .document import dumped, json_text, loaded, read_document

if TYPE_CHECKING:
    from ..colour.model import ColourCalibration
    from ..model import Calibration

AnyCalibration: TypeAlias = "Calibration | ColourCalibration"

#: Value of the key ``format`` of every file.
FORMAT = "labcdp-calibration"
#: Version this program writes, and the only one it reads.
VERSION = 5
#: Largest size of a file, and of its arrays.
MOST_BYTES = 2**30
#: Kinds of calibration: value of the key ``kind``, module and class.
_KINDS = {"monochrome": ("model", "Calibration"), "colour": ("colour.model", "ColourCalibration")}


def save(calibration: AnyCalibration, path: str | Path, *, force: bool = False) -> None:
    """Write a calibration to a JSON file atomically; with `force` an existing calibration is replaced.

    Raises
    ------
    InputError
        If the file exists or cannot be written.
    """
    from ...output import write_file

    kind = next(kind for kind, (_, name) in _KINDS.items() if name == type(calibration).__name__)
    arrays: dict[str, Any] = {}
    content = {"kind": kind, "calibration": dumped(calibration, type(calibration), arrays), "arrays": _text(arrays)}
    document = {"format": FORMAT, "version": VERSION, "sha256": _digest(content), **content}
    write_file(path, json_text(document), force=force)


def load_any(path: str | Path) -> AnyCalibration:
    """Read a calibration of any kind that `save` wrote.

    Raises
    ------
    InputError
        If the file cannot be read, is not a calibration, has another version or a missing, unknown or invalid value, or
        was modified.
    """
    path = Path(path)
    document = _document(path)
    kind = document.get("kind")
    if not isinstance(kind, str) or kind not in _KINDS:
        raise InputError(f"calibration {path} has kind {quoted(kind)}: this labcdp knows {', '.join(_KINDS)}")
    module, name = _KINDS[kind]
    try:
        arrays = _arrays(document.get("arrays"))
        made: AnyCalibration = loaded(
            document.get("calibration"), getattr(import_module(f"..{module}", __package__), name), arrays
        )
    except InputError as error:
        raise InputError(f"calibration {path}, {error}") from error
    if document.get("sha256") != _digest(document):
        raise InputError(
            f"calibration {path} was changed after it was written (its sha256 does not match): restore the original, "
            "or calibrate again"
        )
    return made


def load(path: str | Path) -> Calibration:
    """Read the calibration of a monochrome camera; as `load_any`, and refuses that of a colour camera."""
    from ..model import Calibration

    calibration = load_any(path)
    if not isinstance(calibration, Calibration):
        raise InputError(f"calibration {path} is for a colour camera: give one of a monochrome camera")
    return calibration


def file_sha256(path: str | Path) -> str:
    """Return the identifying hash in a calibration's file; raises InputError as `load_any`."""
    return str(_document(Path(path)).get("sha256"))


def _document(path: Path) -> dict[str, Any]:
    return read_document(path, "calibration", FORMAT, VERSION, "calibrate again", MOST_BYTES)


def _text(arrays: dict[str, Any]) -> str | None:
    """Arrays as the Base64 text of a compressed NumPy archive; None without arrays."""
    if not arrays:
        return None
    file = BytesIO()
    # The lowest level takes a quarter of NumPy's time and makes files as small: maps are mostly noise.
    with ZipFile(file, "w", ZIP_DEFLATED, compresslevel=1) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w") as entry:
                np.lib.format.write_array(entry, np.asarray(array))
    return b64encode(file.getvalue()).decode()


def _arrays(text: Any) -> dict[str, Any]:
    if text is None:
        return {}
    try:
        data = b64decode(text, validate=True)
    except (TypeError, ValueError) as error:
        raise InputError("key arrays: it is no Base64 text") from error
    try:
        return dict(parse_npz(data, MOST_BYTES))
    except InputError as error:
        raise InputError(f"key arrays: {error}") from error


def _digest(document: Any) -> str:
    arrays = document.get("arrays")
    content = {"kind": document["kind"], "calibration": document.get("calibration")}
    if arrays is not None:
        content["arrays"] = hashlib.sha256(arrays.encode()).hexdigest()
    canonical = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(canonical.encode()).hexdigest()
