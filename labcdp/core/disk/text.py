"""Text on disk: results as JSON, and TOML as a person would write it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from datetime import date
from itertools import chain, count
from math import isfinite
from typing import Any

from ..errors import encodable, printable


def results_json(values: Any) -> str:
    """Write values as JSON; see `json_values`."""
    return json.dumps(json_values(values), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def json_values(values: Any) -> Any:
    """Return what JSON can hold: no types of NumPy; infinity and nan become null, anything unknown its text.

    Texts are such as UTF-8 can encode.
    """
    if isinstance(values, Mapping):
        return {encodable(str(key)): json_values(value) for key, value in values.items()}
    if isinstance(values, list | tuple):
        return [json_values(value) for value in values]
    if hasattr(values, "tolist"):
        return json_values(values.tolist())
    if isinstance(values, float) and not isfinite(values):
        return None
    return values if isinstance(values, int | float | bool) or values is None else encodable(str(values))


_BARE_KEY = re.compile("[A-Za-z0-9_-]+")


def toml_text(document: Mapping[str, Any], comments: Mapping[tuple[str, str], str] | None = None) -> str:
    """Write nested tables of text, numbers, truth values, dates and lists as TOML.

    tomli_w puts each number of a list on a line of its own and short tables in braces, which makes a session's
    configuration hard to read; hence this writer.

    Parameters
    ----------
    document : mapping
        The tables.
    comments : mapping of (str, str) to str
        Comments behind values, by the path of their table and their key.

    Raises
    ------
    TypeError
        For a value of another type.
    """
    return "\n".join(_table(document, "", comments or {})).lstrip("\n") + "\n"


def _table(document: Mapping[str, Any], path: str, comments: Mapping[tuple[str, str], str]) -> list[str]:
    """Return the lines of a table and those in it; `path` ends with a dot, or is empty."""
    lines = []
    for key, value in document.items():
        if not _is_table(value):
            comment = comments.get((path[:-1], key))
            lines.append(f"{_key(key)} = {_value(value)}" + (f"  # {printable(comment)}" if comment else ""))
    for key, value in document.items():
        if isinstance(value, Mapping):
            lines += ["", f"[{path}{_key(key)}]", *_table(value, f"{path}{_key(key)}.", comments)]
        elif _is_table(value):
            for item in value:
                lines += ["", f"[[{path}{_key(key)}]]", *_table(item, f"{path}{_key(key)}.", comments)]
    return lines


def _key(key: str) -> str:
    return key if _BARE_KEY.fullmatch(key) else _value(key)


def _is_table(value: object) -> bool:
    if isinstance(value, list | tuple):
        return bool(value) and all(isinstance(item, Mapping) for item in value)
    return isinstance(value, Mapping)


def _value(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        # JSON's escapes are TOML's too; TOML also wants DEL escaped.
        return json.dumps(encodable(value), ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, date):
        return value.isoformat()
    if isinstance(value, list | tuple):
        return f"[{', '.join(_value(item) for item in value)}]"
    raise TypeError(f"TOML has no value for {type(value).__name__}")


def numbered(pattern: str) -> Iterator[str]:
    """Yield endings that make equal names differ: none, then the pattern with 2, 3 and so on."""
    return chain([""], map(pattern.format, count(2)))
