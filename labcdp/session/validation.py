"""Validation of configuration tables, with one line that says which key is wrong and what to give instead."""

from __future__ import annotations

import json
import re
from inspect import isclass
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from ..core.disk.files import quoted, shortened, suggestion
from ..core.errors import ConfigurationError

#: Length of what a validator says, which may name all patches.
_MOST_CHARACTERS = 400

Model = TypeVar("Model", bound=BaseModel)

#: Unit by the ending of a key; the longer ending wins.
_UNITS = {
    "_cd_m2": "cd/m2",
    "_c": "°C",
    "_dn_per_e": "DN/e⁻",
    "_dn": "DN",
    "_db": "dB",
    "_e": "e-",
    "_e_s": "e⁻/s",
    "_m": "m",
    "_s": "s",
}


def validated(model: type[Model], document: dict[str, Any], source: str, **context: Any) -> Model:
    """Make `model` of a table as tomllib returned it.

    Each field of the model carries a ``description`` that completes "give ...": what the value is, its unit and
    its range. A validator of the model raises ValueError with a text that completes the key's path.

    Parameters
    ----------
    model : type of pydantic.BaseModel
        Model to make.
    document : dict
        The table.
    source : str
        Name of the document in messages, usually its file.
    **context
        Context for the validators of the model, for example the folder of the document.

    Raises
    ------
    ConfigurationError
        Naming the first wrong key, its value with unit, and what to give, or all missing keys. Unknown keys come
        before all others, because a mistyped key also leaves the right one missing.
    """
    try:
        return model.model_validate(document, context=context, by_alias=True, by_name=False)
    except ValidationError as error:
        problems = error.errors(include_url=False)
        first = min(problems, key=lambda problem: problem["type"] != "extra_forbidden")
        sentence = _sentence(model, first)
        if first["type"] == "missing":
            others = [_path(problem["loc"]) for problem in problems if problem["type"] == "missing"]
            others = [path for path in dict.fromkeys(others) if path != _path(first["loc"])]
            if others:
                sentence += shortened(f"; also missing: {', '.join(others)}", _MOST_CHARACTERS)
        raise ConfigurationError(f"{source}: {sentence}") from error


def _sentence(model: type[BaseModel], problem: ErrorDetails) -> str:
    location = problem["loc"]
    path = _path(location)
    if problem["type"] == "extra_forbidden":
        return f"{path} is not a known key: {_suggestion(model, location)}"
    if problem["type"] == "value_error":
        return shortened(f"{path} {problem['ctx']['error']}".lstrip(), _MOST_CHARACTERS)
    field = _field(model, location)
    what = field.description if field else "what the documentation says"
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
    return shortened(text)


def _shown(value: object, key: str) -> str:
    endings = [ending for ending in _UNITS if key.endswith(ending)]
    if isinstance(value, int | float) and not isinstance(value, bool) and endings:
        return f"{value!r} {_UNITS[max(endings, key=len)]}"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    return quoted(value) if isinstance(value, bool | int | float | str | dict) else shortened(str(value))


def _suggestion(model: type[BaseModel], location: tuple[int | str, ...]) -> str:
    for part in location[:-1]:
        if isinstance(part, str):
            nested = _nested(_fields(model)[part].annotation)
            assert nested is not None
            model = nested
    return suggestion(location[-1], _fields(model))


def _field(model: type[BaseModel], location: tuple[int | str, ...]) -> FieldInfo | None:
    field, table = None, model
    for part in location:
        if isinstance(part, str):
            field = _fields(table).get(part)
            if field is None:
                return None
            table = _nested(field.annotation) or table
    return field


def _fields(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """Fields by the key a document uses for them."""
    return {str(field.validation_alias or name): field for name, field in model.model_fields.items()}


def _nested(annotation: object) -> type[BaseModel] | None:
    """Return the model inside an annotation such as ``tuple[PatchConfiguration, ...]`` or ``Guess | None``."""
    if isclass(annotation) and issubclass(annotation, BaseModel):
        return annotation
    return next((model for part in get_args(annotation) if (model := _nested(part))), None)
