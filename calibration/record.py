"""Calibrations, verifications and observations as JSON files, units in the keys, with compressed arrays.

pydantic validates the dataclasses themselves; unknown keys are errors at every level.
"""

from __future__ import annotations

import hashlib
import json
from base64 import b64decode, b64encode
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any, TypeVar, cast
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np

from ..core.disk import file_sha256, quoted, read_json, validated_as
from ..core.disk.arrays import parse_npz
from ..core.errors import InputError, naming
from .colour.model import AnyCalibration, ColourCalibration
from .frames.observations import DarkObservation, PatchObservation
from .model import Calibration
from .verify.result import Verification

#: Value of the key ``format`` of calibrations, verifications and observations.
CALIBRATION, VERIFICATION, _OBSERVATIONS = "labcdp-calibration", "labcdp-verification", "labcdp-observations"
#: Largest size of a calibration, and of its arrays; and of a verification or of observations.
MOST_BYTES, _MOST_BYTES_VERIFICATION = 2**30, 2**26
#: By format: its name in messages, the only version that is written and read, and what to do about an older one.
_FORMATS = {
    CALIBRATION: ("calibration", 6, "calibrate again"),
    VERIFICATION: ("verification", 5, "verify again"),
    _OBSERVATIONS: ("observations", 1, "calibrate again"),
}
#: Beyond any number of a camera, of which powers would overflow.
_LARGEST = 1e60
#: Kinds of calibration, by the value of the key ``kind``.
_KINDS: dict[str, type[AnyCalibration]] = {"monochrome": Calibration, "colour": ColourCalibration}

_T = TypeVar("_T")


def save(calibration: AnyCalibration, path: str | Path, *, force: bool = False) -> None:
    """Write a calibration to a JSON file atomically; with `force` an existing calibration is replaced.

    Raises
    ------
    InputError
        If the file exists or cannot be written.

    Examples
    --------
    >>> from labcdp import Session, calibration
    >>> from labcdp.session import example_session
    >>> calibration.save(Session.open(example_session()).calibrate().calibration, "camera.json")
    >>> calibration.load("camera.json").planes[0].weights
    (1.0,)
    """
    kind = next(kind for kind, model in _KINDS.items() if model is type(calibration))
    arrays: dict[str, Any] = {}
    content = {"kind": kind, "calibration": _dumped(calibration, arrays), "arrays": _text(arrays)}
    digest = _digest(content)
    _write(path, CALIBRATION, {"number": _number(digest), "sha256": digest, **content}, force)


def load_any(path: str | Path) -> AnyCalibration:
    """Read a calibration of any kind that `save` wrote.

    Raises
    ------
    InputError
        If the file cannot be read, is not a calibration, has another version or a missing, unknown or invalid value, or
        was modified.

    Examples
    --------
    >>> from labcdp import Session, calibration
    >>> from labcdp.session import example_session
    >>> calibration.save(Session.open(example_session()).calibrate().calibration, "any.json")
    >>> calibration.load_any("any.json").state.bit_depth
    12
    """
    document = _read(Path(path), CALIBRATION)
    kind = document.get("kind")
    if not isinstance(kind, str) or kind not in _KINDS:
        raise InputError(f"calibration {path} has kind {quoted(kind)}: this labcdp knows {', '.join(_KINDS)}")
    made = _loaded(path, CALIBRATION, document, _KINDS[kind])
    digest = _digest(document)
    # Calibrations had no number once.
    if document.get("sha256") != digest or document.get("number", _number(digest)) != _number(digest):
        raise InputError(
            f"calibration {path} was changed after it was written (its sha256 or number does not match): restore the "
            "original, or calibrate again"
        )
    return made


def load(path: str | Path) -> Calibration:
    """Read the calibration of a monochrome camera; as `load_any`, and refuses that of a colour camera.

    Examples
    --------
    >>> from labcdp import Session, calibration
    >>> from labcdp.session import example_session
    >>> calibration.save(Session.open(example_session()).calibrate().calibration, "mono.json")
    >>> calibration.load("mono.json").source_spectrum
    'D65'
    """
    calibration = load_any(path)
    if not isinstance(calibration, Calibration):
        raise InputError(f"calibration {path} is for a colour camera: give one of a monochrome camera")
    return calibration


def calibration_sha256(path: str | Path) -> str:
    """Return the identifying hash in a calibration's file; raises InputError as `load_any`."""
    return str(_read(Path(path), CALIBRATION).get("sha256"))


@dataclass(frozen=True)
class SavedFile:
    """Identity of a saved calibration or verification, for its certificate.

    Parameters
    ----------
    name : str
        Name of the file.
    number : str
        Follows from the content: another one for each result, the same if the result is saved again.
    sha256 : str
        Hash of the file's bytes.
    """

    name: str
    number: str
    sha256: str

    @classmethod
    def of(cls, path: str | Path) -> SavedFile:
        """Identify a calibration, or else a verification; raises InputError if it is neither."""
        path = Path(path)
        most_bytes = max(MOST_BYTES, _MOST_BYTES_VERIFICATION)
        document = read_json(path, "a calibration or verification that labcdp saved", most_bytes)
        of_verification = isinstance(document, dict) and document.get("format") == VERIFICATION
        document = _read(path, VERIFICATION if of_verification else CALIBRATION)
        digest = _digest_of_verification(document) if of_verification else str(document.get("sha256"))
        return cls(path.name, _number(digest), file_sha256(path, "a calibration or verification"))


def save_verification(verification: Verification, path: str | Path, *, force: bool = False) -> None:
    """Write a verification to a JSON file; as `save`."""
    content = {"verdict": verification.verdict, "verification": _dumped(verification)}
    _write(path, VERIFICATION, {"number": _number(_digest_of_verification(content)), **content}, force)


def load_verification(path: str | Path) -> Verification:
    """Read a verification that `save_verification` wrote; raises InputError as `load_any`."""
    return _loaded(path, VERIFICATION, _read(Path(path), VERIFICATION), Verification)


@dataclass(frozen=True)
class SessionObservations:
    """Observations of the frames of a session, kept so that the frames need not be measured again.

    Parameters
    ----------
    key : str
        Hash of all that they follow from: frames, regions, corrections.
    frames_sha256 : tuple of str
        Hashes of the pixels of the frames, but not of those of simulated cameras.
    patches : tuple of PatchObservation
        Of all colour planes; their vignetting is None, whichever it was.
    darks : tuple of DarkObservation
        Of all colour planes.
    """

    key: str
    frames_sha256: tuple[str, ...]
    patches: tuple[PatchObservation, ...]
    darks: tuple[DarkObservation, ...]


def save_observations(observations: Iterable[SessionObservations], path: str | Path) -> None:
    """Write observations of sessions to a JSON file; as `save`, and raises ValueError for a number not finite."""
    content = [_dumped(of_session) for of_session in observations]
    _write(path, _OBSERVATIONS, {"sha256": _sha256(content), "observations": content}, force=False)


def load_observations(path: str | Path) -> list[SessionObservations]:
    """Read observations that `save_observations` wrote; raises InputError as `load_any`."""
    document = _read(Path(path), _OBSERVATIONS)
    content = document.get("observations")
    if not isinstance(content, list) or document.get("sha256") != _sha256(content):
        raise InputError(f"observations {path} were changed after they were written: calibrate again")
    return [_loaded(path, _OBSERVATIONS, {"observations": of_session}, SessionObservations) for of_session in content]


@cache
def _document_model(kind: Any) -> Any:
    """Pydantic model with the only key ``value``, which forbids unknown keys in all dataclasses within it too."""
    from pydantic import ConfigDict, create_model

    return create_model("Document", __config__=ConfigDict(extra="forbid"), value=(kind, ...))


def _dumped(value: object, arrays: dict[str, Any] | None = None) -> Any:
    """Return a dataclass as values JSON can hold; arrays are put into a dictionary."""
    document = _document_model(cast("Any", type(value))).model_construct(value=value)
    return document.model_dump(mode="json", context={"arrays": arrays})["value"]


def _loaded(path: str | Path, file_format: str, document: dict[str, Any], kind: type[_T]) -> _T:
    """Make the dataclass again; raises InputError with the first key that is missing, unknown or wrong."""
    name = _FORMATS[file_format][0]
    try:
        arrays = _arrays(document.get("arrays"))
        _require_possible(document.get(name))
        made: _T = validated_as(_document_model(cast("Any", kind)), {"value": document.get(name)}, arrays=arrays).value
    except InputError as error:
        raise InputError(f"{name} {path}, {str(error).replace('key value.', 'key ', 1)}") from error
    return made


def _require_possible(value: Any, key: str = "") -> None:
    """Refuse numbers that no camera, lens or meter has; raises InputError with the first key."""
    if isinstance(value, int | float) and abs(value) > _LARGEST:
        raise InputError(f"key {key}: {value:g} is beyond any measurement")
    children = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for part, child in children:
        _require_possible(child, f"{key}.{part}" if key else f"{part}")


def _write(path: str | Path, file_format: str, content: dict[str, Any], force: bool) -> None:
    from ..output import write_file

    document = {"format": file_format, "version": _FORMATS[file_format][1], **content}
    text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)
    write_file(path, (text + "\n").encode(), force=force)


def _read(path: Path, file_format: str) -> dict[str, Any]:
    """Read a document of this format and version."""
    name, version, remedy = _FORMATS[file_format]
    most_bytes = MOST_BYTES if file_format == CALIBRATION else _MOST_BYTES_VERIFICATION
    document = read_json(path, f"a {name} that labcdp saved", most_bytes)
    if not isinstance(document, dict) or document.get("format") != file_format:
        raise InputError(
            f"{path} is not a {name}: its key format is not {file_format!r}; give a file that labcdp saved"
        )
    stated = document.get("version")
    if stated != version:
        newer = isinstance(stated, int) and stated > version
        advice = "use a newer labcdp" if newer else remedy
        raise InputError(f"{name} {path} has version {quoted(stated)}, this labcdp reads version {version}: {advice}")
    return document


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
        raise InputError("key arrays: it is not Base64 text") from error
    with naming("key arrays"):
        return dict(parse_npz(data, MOST_BYTES))


def _digest(document: Any) -> str:
    arrays = document.get("arrays")
    content = {"kind": document["kind"], "calibration": document.get("calibration")}
    if arrays is not None:
        content["arrays"] = hashlib.sha256(arrays.encode()).hexdigest()
    return _sha256(content)


def _digest_of_verification(document: Any) -> str:
    return _sha256({"verification": document.get("verification")})


def _sha256(content: Any) -> str:
    canonical = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(canonical.encode()).hexdigest()


def _number(digest: str) -> str:
    """Return the first 48 bits of a hash, in groups that can be read out."""
    return "-".join(digest[start : start + 4] for start in (0, 4, 8))
