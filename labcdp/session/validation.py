"""Validation of configuration tables, with one line that says which key is wrong and what to give instead."""

from __future__ import annotations

import json
import re
from difflib import get_close_matches
from inspect import isclass
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from ..errors import ConfigurationError

Model = TypeVar("Model", bound=BaseModel)

#: Unit by the ending of a key; the longer ending wins.
_UNITS = {
    "_cd_m2": "cd/m2",
    "_c": "degC",
    "_dn_per_e": "DN/e-",
    "_dn": "DN",
    "_db": "dB",
    "_e": "e-",
    "_e_s": "e-/s",
    "_m": "m",
    "_s": "s",
}


def validated(model: type[Model], document: dict[str, Any], source: str) -> Model:
    """Make `model` of a table as tomllib returned it.

    Each field of the model carries a ``description`` that completes "give ...": what the value is, its unit and
    its range. A validator of the model raises ValueError with a text that completes the key's path.

    Parameters
    ----------
    model : type of pydantic.BaseModel
        What to make.
    document : dict
        The table.
    source : str
        What messages call the document, usually its file.

    Raises
    ------
    ConfigurationError
        Naming the first wrong key, its value with unit, and what to give. Unknown keys come before all others,
        because a mistyped key also leaves the right one missing.
    """
    try:
        return model.model_validate(document, by_alias=True, by_name=False)
    except ValidationError as error:
        problems = error.errors(include_url=False)
        first = min(problems, key=lambda problem: problem["type"] != "extra_forbidden")
        raise ConfigurationError(f"{source}: {_sentence(model, first)}") from error


def _sentence(model: type[BaseModel], problem: ErrorDetails) -> str:
    location = problem["loc"]
    path = _path(location)
    if problem["type"] == "extra_forbidden":
        return f"{path} is not a known key: {_suggestion(model, location)}"
    if problem["type"] == "value_error":
        return f"{path} {problem['ctx']['error']}".lstrip()
    field = _field(model, location)
    what = field.description if field else "a table"
    if problem["type"] == "missing":
        return f"{path} is missing: give {what}"
    if problem["type"] == "tuple_type":
        what = f"a list in square brackets, {what}"
    key = next((part for part in reversed(location) if isinstance(part, str)), "")
    return f"{path} is {_shown(problem['input'], key)}: give {what}"


def _path(location: tuple[int | str, ...]) -> str:
    text = ""
    for part in location:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            key = part if re.fullmatch(r"[\w-]+", part, re.ASCII) else json.dumps(part)
            text += f".{key}" if text else key
    return text


def _shown(value: object, key: str) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        endings = [ending for ending in _UNITS if key.endswith(ending)]
        return f"{value!r} {_UNITS[max(endings, key=len)]}" if endings else repr(value)
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    return repr(value) if isinstance(value, str) else str(value)


def _suggestion(model: type[BaseModel], location: tuple[int | str, ...]) -> str:
    for part in location[:-1]:
        if isinstance(part, str):
            nested = _nested(_fields(model)[part].annotation)
            assert nested is not None
            model = nested
    known = list(_fields(model))
    close = get_close_matches(str(location[-1]), known, n=1)
    return f"did you mean {close[0]}?" if close else f"known here are {', '.join(known)}"


def _field(model: type[BaseModel], location: tuple[int | str, ...]) -> FieldInfo | None:
    field, table = None, model
    for part in location:
        if isinstance(part, str):
            field = _fields(table)[part]
            table = _nested(field.annotation) or table
    return field


def _fields(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """Fields by the key a document uses for them."""
    return {str(field.validation_alias or name): field for name, field in model.model_fields.items()}


def _nested(annotation: object) -> type[BaseModel] | None:
    """Return the model inside an annotation such as ``tuple[Patch, ...]`` or ``Guess | None``."""
    if isclass(annotation) and issubclass(annotation, BaseModel):
        return annotation
    return next((found for part in get_args(annotation) if (found := _nested(part))), None)
