"""JSON documents with format and version, validated by pydantic; unknown keys are errors at every level."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

from ...core.disk import quoted, read_json, validated_as
from ...core.errors import InputError

_T = TypeVar("_T")


@cache
def document_of(kind: Any) -> Any:
    """Pydantic model with the only key ``value``, which forbids unknown keys in all dataclasses within it too."""
    from pydantic import ConfigDict, create_model

    return create_model("Document", __config__=ConfigDict(extra="forbid"), value=(kind, ...))


def dumped(value: object, kind: Any, arrays: dict[str, Any] | None = None) -> Any:
    """Return a dataclass as values JSON can hold; arrays are put into a dictionary."""
    document = document_of(kind).model_construct(value=value)
    return document.model_dump(mode="json", context={"arrays": arrays})["value"]


def loaded(content: Any, kind: type[_T], arrays: dict[str, Any] | None = None) -> _T:
    """Make the dataclass again; raises InputError with the first key that is missing, unknown or wrong."""
    try:
        made: _T = validated_as(document_of(cast("Any", kind)), {"value": content}, arrays=arrays or {}).value
    except InputError as error:
        raise InputError(str(error).replace("key value.", "key ", 1)) from error
    return made


def json_text(document: dict[str, Any]) -> bytes:
    """Write a document as JSON."""
    return (json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode()


def read_document(
    path: Path, what: str, file_format: str, version: int, remedy: str, most_bytes: int = 2**26
) -> dict[str, Any]:
    """Read a document of a format and version.

    Parameters
    ----------
    path : Path
        The file.
    what : str
        Name of the kind of document in messages, for example ``calibration``.
    file_format, version : str, int
        Value of the keys ``format`` and ``version``.
    remedy : str
        What to do about an older version.
    most_bytes : int
        Largest size of the file.

    Raises
    ------
    InputError
        If it cannot be read, or has another format or version.
    """
    document = read_json(path, f"a {what} that labcdp saved", most_bytes)
    if not isinstance(document, dict) or document.get("format") != file_format:
        raise InputError(
            f"{path} is not a {what}: its key format is not {file_format!r}; give a file that labcdp saved"
        )
    found = document.get("version")
    if found != version:
        newer = isinstance(found, int) and found > version
        advice = "use a newer labcdp" if newer else remedy
        raise InputError(f"{what} {path} has version {quoted(found)}, this labcdp reads version {version}: {advice}")
    return document
