"""JSON and TOML: parsed within limits on size, depth and numbers, and validated by pydantic."""

from __future__ import annotations

import json
import re
import tomllib
from dataclasses import MISSING, fields
from datetime import datetime
from functools import cache
from itertools import accumulate
from math import isfinite
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, cast, get_type_hints

from ..errors import ConfigurationError, InputError, naming
from .files import MOST_DIGITS, AnyPath, quoted, read_bytes, read_text, reason

if TYPE_CHECKING:
    from pydantic import TypeAdapter

_T = TypeVar("_T")

#: Size of a document from which it is refused, unless a reader allows another.
MOST_BYTES = 64 * 2**20
#: Values in a document: each takes up to 100 bytes of memory.
MOST_VALUES = 4_000_000
#: Tables and lists within each other.
MOST_LEVELS = 64
#: Parts of a dotted key of TOML; the parser's time grows with their square.
_MOST_PARTS = 16
#: Configurations are written by people, and their parser takes a second for a megabyte.
MOST_BYTES_OF_TOML = 4 * 2**20

_NO_BRACKETS = bytes(set(range(256)) - set(b"[]{}"))
_STRING = re.compile(rb'"(?:[^"\\]|\\.)*+"', re.DOTALL)
_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+"""
_LONG_KEY = re.compile(rf"(?<![\w-]){_PART}(?:\.[ \t]*+{_PART}){{{_MOST_PARTS}}}", re.ASCII)
#: Where a syntax error is, as tomllib says it, and a line with a decimal comma outside a list.
_TOML_POSITION = re.compile(r"at line (\d+), column")
_DECIMAL_COMMA = re.compile(r"[^=#\"'\[]*=\s*([+-]?\d{1,20}),(\d{1,20})\b")


def parse_json(text: str | bytes, allow_nan: bool = False) -> Any:
    """Read JSON.

    Parameters
    ----------
    text : str or bytes
        The document; bytes are UTF-8.
    allow_nan : bool
        Whether NaN, Infinity and -Infinity, which JSON has not, are numbers.

    Raises
    ------
    InputError
        If it is no JSON, a key stands twice in a table, a number is not finite or has more than 40 digits, there are
        too many values, or they are nested too deep.
    """
    data = text.encode("utf-8", "surrogatepass") if isinstance(text, str) else text
    _require_moderate(data)
    hooks: dict[str, Any] = {} if allow_nan else {"parse_constant": _no_number, "parse_float": _finite}
    try:
        return json.loads(data.decode("utf-8-sig"), object_pairs_hook=_table, parse_int=_whole, **hooks)
    except json.JSONDecodeError as error:
        raise InputError(f"not valid JSON: {error.msg} in line {error.lineno}, column {error.colno}") from error
    except InputError:
        raise
    except (ValueError, RecursionError) as error:
        raise InputError(f"not valid JSON: {reason(error)}") from error


def read_json(path: AnyPath, what: str, most_bytes: int = MOST_BYTES) -> Any:
    """Read a JSON file; raises InputError as `read_bytes` and `parse_json`, naming the file."""
    data = read_bytes(path, what, most_bytes)
    try:
        return parse_json(data)
    except InputError as error:
        raise InputError(f"{path}: {error}; give {what}") from error


def _require_moderate(data: bytes) -> None:
    """Refuse what would take much memory or stack, before it is parsed."""
    if data.count(b",") + data.count(b"[") + data.count(b"{") > MOST_VALUES:
        raise InputError(f"it holds more than {MOST_VALUES} values")
    if data.count(b"[") + data.count(b"{") > MOST_LEVELS:
        marks = _STRING.sub(b"", data).translate(None, _NO_BRACKETS)
        if max(accumulate(1 if mark in b"[{" else -1 for mark in marks), default=0) > MOST_LEVELS:
            raise InputError(f"its lists and tables are nested more than {MOST_LEVELS} levels deep")


def _table(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        seen: set[str] = set()
        twice = next(key for key, _ in pairs if key in seen or seen.add(key))  # type: ignore[func-returns-value]
        raise InputError(f"the key {quoted(twice)} is given twice in one table: leave one out")
    return table


def _no_number(text: str) -> float:
    raise InputError(f"{text} is not a number: give a finite number")


def _finite(text: str) -> float:
    number = float(text)
    return number if isfinite(number) else _no_number(quoted(text))


def _whole(text: str) -> int:
    digits = len(text.removeprefix("-"))
    if digits > MOST_DIGITS:
        raise InputError(f"a number has {digits} digits: give at most {MOST_DIGITS}")
    return int(text)


def number_of(value: Any) -> float:
    """Return a number that a document holds; raises TypeError for all else, also a truth value or text."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{quoted(value)} is not a number")
    return float(value)


def parse_toml(text: str) -> dict[str, Any]:
    """Read TOML.

    Raises
    ------
    InputError
        If it is no TOML (with line and column), a number has more than 40 digits, or tables and lists are nested too
        deep. TOML has nan and inf: that they are no value is for the key they belong to.
    """
    with naming("not valid TOML"):
        if long := _LONG_KEY.search(text):
            raise InputError(f"{quoted(long[0])} is a key of more than {_MOST_PARTS} parts")
        try:
            document = tomllib.loads(text)
        # Also too deep nesting, and numbers and dates that Python cannot represent.
        except (ValueError, RecursionError) as error:
            raise InputError(f"{reason(error)}: {_correction(text, str(error))}") from error
        _require_whole_numbers(document)
    return document


def _correction(text: str, message: str) -> str:
    """Return what to do about a syntax error: a decimal comma is the error of those whose language has it."""
    position = _TOML_POSITION.search(message)
    lines = text.split("\n")
    number = int(position[1]) if position else len(lines) + 1
    comma = _DECIMAL_COMMA.match(lines[number - 1]) if number <= len(lines) else None
    if comma is None:
        return "correct it there"
    return f"write {comma[1]}.{comma[2]} with a decimal point, not {comma[1]},{comma[2]}"


def _require_whole_numbers(value: Any, level: int = 0) -> None:
    if level > MOST_LEVELS:
        raise InputError(f"its lists and tables are nested more than {MOST_LEVELS} levels deep")
    if isinstance(value, dict | list):
        for one in value.values() if isinstance(value, dict) else value:
            _require_whole_numbers(one, level + 1)
    elif isinstance(value, int) and abs(value) >= 10**MOST_DIGITS:
        raise InputError(f"it holds {quoted(value)}: give at most {MOST_DIGITS}")


def read_toml(path: AnyPath, what: str) -> dict[str, Any]:
    """Read a TOML file; raises ConfigurationError as `read_text` and `parse_toml`, naming the file."""
    text = read_text(path, what, MOST_BYTES_OF_TOML, ConfigurationError)
    with naming(path, ConfigurationError):
        return parse_toml(text)


def record_of(kind: type, values: Any, *left_out: str) -> dict[str, Any]:
    """Return a dataclass's fields as values, of those JSON has of them; times are ISO text with a time zone.

    Raises
    ------
    InputError
        If a field is missing, unknown or of another type; but for those that are left out.
    """
    made = validated_as(_record_model(kind, *left_out), values)
    return {name: getattr(made, name) for name in type(made).model_fields}


@cache
def _record_model(kind: type, *left_out: str) -> Any:
    from pydantic import BeforeValidator, ConfigDict, create_model

    hints = get_type_hints(kind)
    used = [one for one in fields(kind) if one.name not in left_out]
    return create_model(  # type: ignore[call-overload]
        kind.__name__,
        __config__=ConfigDict(extra="forbid"),
        **{
            one.name: (
                Annotated[datetime, BeforeValidator(_time)] if hints[one.name] is datetime else hints[one.name],
                ... if one.default is MISSING else one.default,
            )
            for one in used
        },
    )


def _time(text: Any) -> datetime:
    time = datetime.fromisoformat(text) if isinstance(text, str) else None
    if time is None or time.tzinfo is None:
        raise ValueError("it is not an ISO time with a time zone")
    return time


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    from pydantic import TypeAdapter

    return TypeAdapter(kind)


def validated_as(kind: type[_T], values: Any, **context: Any) -> _T:
    """Make a pydantic model, a dataclass or a type of values as JSON has them; the types must fit exactly.

    Raises
    ------
    InputError
        Naming the first key that is wrong, and what is wrong with it.
    """
    from pydantic import ValidationError

    try:
        made: _T = _adapter(cast("Any", kind)).validate_json(json.dumps(values), strict=True, context=context or None)
        return made
    except ValidationError as error:
        # Of a field with several types, keys that the others have are missing too.
        errors = error.errors(include_url=False, include_input=False)
        first = next((one for one in errors if one["type"] != "missing"), errors[0])
        place = quoted(".".join(map(str, first["loc"]))).strip("'\"")
        raise InputError(f"key {place or 'of the whole'}: {first['msg'][:200]}") from error
