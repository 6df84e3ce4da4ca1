"""TOML text as a person would write it: lists on one line, one ``[[table]]`` for each of several."""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import date
from typing import Any


def toml_text(document: Mapping[str, Any]) -> str:
    """Write nested tables of text, numbers, truth values, dates and lists as TOML.

    tomli_w puts each number of a list on a line of its own and short tables in braces, which makes a session's
    configuration hard to read; hence this writer.

    Parameters
    ----------
    document : mapping
        The tables; every key is a bare TOML key (letters, digits, underscore, hyphen).

    Raises
    ------
    TypeError
        For a value of another type.
    """
    return "\n".join(_table(document, "")).lstrip("\n") + "\n"


def _table(document: Mapping[str, Any], path: str) -> list[str]:
    lines = [f"{key} = {_value(value)}" for key, value in document.items() if not _is_table(value)]
    for key, value in document.items():
        if isinstance(value, Mapping):
            lines += ["", f"[{path}{key}]", *_table(value, f"{path}{key}.")]
        elif _is_table(value):
            for item in value:
                lines += ["", f"[[{path}{key}]]", *_table(item, f"{path}{key}.")]
    return lines


def _is_table(value: object) -> bool:
    if isinstance(value, list | tuple):
        return bool(value) and all(isinstance(item, Mapping) for item in value)
    return isinstance(value, Mapping)


def _value(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        # JSON's escapes are TOML's too; TOML also wants DEL escaped.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, date):
        return value.isoformat()
    if isinstance(value, list | tuple):
        return f"[{', '.join(_value(item) for item in value)}]"
    raise TypeError(f"TOML has no value for {type(value).__name__}")
