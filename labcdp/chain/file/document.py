"""Tables of a chain file from the parts of a chain, and changes of single values in them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from ...core.disk.quoting import closest
from ...core.errors import ConfigurationError
from .parts_of_document import TEXTS
from .registry import type_of

#: Keys of the size, which scene and sensors have in common; a chain file states it once, in the scene if that has it.
_SIZE = ("width", "height")


def scene_table(scene: object, folder: Path) -> dict[str, Any]:
    """Return the table of a scene; paths are relative to `folder` where they lie in it."""
    return {"type": type_of("scene", type(scene)), **_values(scene, folder)}


def stage_table(name: str, stage: object, folder: Path) -> dict[str, Any]:
    """Return the table of a stage that has this name in the chain."""
    type_name = type_of(name, type(stage))
    return ({} if type_name is None else {"type": type_name}) | _values(stage, folder)


def settings_table(settings: object, folder: Path) -> dict[str, Any]:
    """Return the table of exposure settings or of a merge."""
    table = _values(settings, folder)
    times = table.get("exposure_s")
    if isinstance(times, list) and len(times) == 1:
        table["exposure_s"] = times[0]
    return table


def sensor_tables(sensors: Sequence[tuple[str, object]], folder: Path) -> dict[str, Any] | list[dict[str, Any]]:
    """Return the table of a sensor, or the tables of several with their names; without their size."""
    tables = []
    for name, sensor in sensors:
        values = {key: value for key, value in _values(sensor, folder).items() if key not in _SIZE}
        tables.append({"name": name, "type": type_of("sensor", type(sensor)), **values})
    if len(tables) == 1 and tables[0]["name"] == "sensor":
        del tables[0]["name"]
        return tables[0]
    return tables[0] if len(tables) == 1 else tables


def plain(value: Any) -> Any:
    """Return NumPy's numbers and arrays, tuples and paths as what TOML has."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Path):
        return value.as_posix()
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    return [plain(item) for item in value] if isinstance(value, list | tuple) else value


def _values(part: Any, folder: Path) -> dict[str, Any]:
    """Fields of a part; what TOML cannot hold, None and no tables at all, is left to the default."""
    found = {}
    for field in fields(part):
        value = getattr(part, field.name)
        if "path" in field.metadata and value.is_relative_to(folder):
            value = value.relative_to(folder)
        elif "table" in field.metadata:
            value = [_values(item, folder) for item in value]
        if value is not None and not (isinstance(value, Mapping | list | tuple) and not value):
            found[field.name] = plain(value)
    return found


def changed(document: dict[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Change values in the tables of a chain file, in place, and return them.

    Parameters
    ----------
    document : dict
        As `Chain.document`: the size is in the scene.
    values : mapping of str to object
        Values by table and key, see `Chain.with_`.

    Raises
    ------
    ConfigurationError
        If there is no such table, or the size is given twice.
    """
    sizes: dict[str, Any] = {}
    for name, value in values.items():
        path = name if "." in name else name.replace("__", ".")
        table, _, key = path.partition(".")
        own = key.rpartition(".")[2]
        if table in ("scene", "sensor") and own in _SIZE and own in document["scene"]:
            if sizes.setdefault(own, value) != value:
                raise ConfigurationError(f"{own} is {sizes[own]!r} and {value!r}: scene and sensor have one size")
            path = f"scene.{own}"
        _change(document, path, plain(value))
    return document


def _change(document: dict[str, Any], path: str, value: Any) -> None:
    table, _, key = path.partition(".")
    tables = [name for name in document if name not in TEXTS]
    if not key and table in TEXTS:
        document[table] = value
        return
    if not key and table in tables:
        raise ConfigurationError(f"{path!r} is a table: give one of its keys too, such as scene.luminance_cd_m2")
    if not key or table not in tables:
        raise ConfigurationError(
            f"{path!r} is no parameter of this chain: give spectrum, or a table and a key, such as "
            f"scene.luminance_cd_m2; {_hint(table, tables)}"
        )
    held = document[table]
    held = [held] if isinstance(held, dict) else held
    chosen, _, own_key = key.partition(".")
    named = [item for item in held if own_key and item.get("name") == chosen]
    if own_key and "name" in held[0] and not named:
        names = ", ".join(item["name"] for item in held)
        raise ConfigurationError(f"{path!r}: there is no {table} {chosen!r}, give one of {names}")
    for item in named or held:
        _put(item, own_key if named else key, value)


def _put(table: dict[str, Any], key: str, value: Any) -> None:
    """Set a value; None means the default, as in a file that leaves the key out."""
    if value is None:
        table.pop(key, None)
    else:
        table[key] = value


def _hint(name: str, known: Iterable[str]) -> str:
    known = list(known)
    close = closest(name, known)
    return f"did you mean {close}?" if close else f"it has {', '.join(known)}"
