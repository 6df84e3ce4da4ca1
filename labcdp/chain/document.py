"""Chain files: tables are the fields of the chain's dataclasses; messages name table, key and value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, fields
from pathlib import Path
from typing import Any

import numpy as np

from ..core.disk.files import shortened, shown, suggestion
from ..core.errors import ConfigurationError, InputError
from .registry import class_of, type_of
from .scene.scene import Scene
from .signal import SensorModel, Stage

_Table = Mapping[str, Any]

#: Keys at the top of a chain file that are text, with their defaults.
TEXTS = {"name": "", "description": "", "spectrum": "D65"}
#: Keys of the size, which scene and sensors have in common; a chain file states it once, in the scene if that has it.
_SIZE = ("width", "height")
#: What the class of a table must be; of all other tables, a stage.
_KINDS: dict[str, tuple[Any, str]] = {
    "scene": (Scene, "scene"),
    "sensor": (SensorModel, "sensor model"),
    **dict.fromkeys(("exposure", "hdr"), (object, "")),
}


def parts_of_document(document: _Table, folder: Path = Path()) -> dict[str, Any]:
    """Return the fields of a chain from the tables of a chain file.

    Parameters
    ----------
    document : mapping
        The tables; those between scene and sensor, and those behind, are stages in their order.
    folder : Path
        Folder that paths in it are relative to.

    Raises
    ------
    InputError
        Naming table and key of the first thing that cannot be used.
    """
    parts: dict[str, Any] = {key: document.get(key, default) for key, default in TEXTS.items()}
    sensors = _sensor_tables(document.get("sensor", []))
    if "scene" not in document:
        raise ConfigurationError("scene is missing: add a table [scene]")
    first = sensors[0][1] if sensors else {}
    scene = _part("scene", document["scene"], folder, {key: first[key] for key in _SIZE if key in first})
    parts |= {"scene": scene, "before": (), "behind": (), "settings": None, "hdr": None}
    stages = "before"
    for name, table in document.items():
        if name == "hdr" and sensors and (stages == "before" or parts["behind"]):
            raise ConfigurationError("hdr merges the exposures of a sensor: put it directly after the sensor")
        if name in ("sensor", "hdr"):
            stages = "behind"
        if name in ("exposure", "hdr"):
            parts["settings" if name == "exposure" else name] = _part(name, table, folder)
        elif name not in (*TEXTS, "scene", "sensor"):
            parts[stages] += ((name, _part(name, table, folder)),)
    size = {"width": scene.shape[1], "height": scene.shape[0]}
    return parts | {"sensors": tuple((name, _part("sensor", table, folder, size)) for name, table in sensors)}


def document_of_parts(chain: Any, folder: Path) -> dict[str, Any]:
    """Return the tables of a chain file for a chain; paths are relative to `folder` where they lie in it."""
    sensors: Any = [{"name": name, **_table("sensor", sensor, folder, *_SIZE)} for name, sensor in chain.sensors]
    if len(sensors) == 1:
        (sensors,) = sensors
        if sensors["name"] == "sensor":
            del sensors["name"]
    tables = {"scene": chain.scene, **dict(chain.before), "exposure": chain.settings, "sensor": sensors or None}
    tables |= {"hdr": chain.hdr, **dict(chain.behind)}
    texts: dict[str, Any] = {key: getattr(chain, key) for key in TEXTS if getattr(chain, key)}
    return texts | {
        name: part if name == "sensor" else _table(name, part, folder)
        for name, part in tables.items()
        if part is not None
    }


def changed(document: dict[str, Any], values: _Table) -> dict[str, Any]:
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
    for name, given in values.items():
        path, value = name if "." in name else name.replace("__", "."), _plain(given)
        table, _, key = path.partition(".")
        field = key.rpartition(".")[2]
        if table in ("scene", "sensor") and field in _SIZE and field in document["scene"]:
            if sizes.setdefault(field, value) != value:
                raise ConfigurationError(f"{field} is {sizes[field]!r} and {value!r}: scene and sensor have one size")
            path = f"scene.{field}"
        for target, last in _tables_at(document, path):
            # None means the default, as in a file that leaves the key out.
            target.pop(last, None)
            if value is not None:
                target[last] = value
    return document


def _tables_at(document: dict[str, Any], path: str) -> list[tuple[dict[str, Any], str]]:
    """Return the tables that a path such as ``sensor.bits`` refers to, and the key in them."""
    table, _, key = path.partition(".")
    if not key and table in TEXTS:
        return [(document, table)]
    tables = [name for name in document if name not in TEXTS]
    if not key and table in tables:
        raise ConfigurationError(f"{path!r} is a table: give one of its keys too, such as scene.luminance_cd_m2")
    if not key or table not in tables:
        raise ConfigurationError(
            f"{path!r} is not a parameter of this chain: give spectrum, or a table and a key, such as "
            f"scene.luminance_cd_m2; {suggestion(table, tables, 'it has')}"
        )
    held = document[table] if isinstance(document[table], list) else [document[table]]
    chosen, _, own_key = key.partition(".")
    named = [item for item in held if own_key and item.get("name") == chosen]
    if own_key and "name" in held[0] and not named:
        names = ", ".join(item["name"] for item in held)
        raise ConfigurationError(f"{path!r}: there is no {table} {chosen!r}, give one of {names}")
    return [_part_at(item, own_key if named else key, path) for item in named or held]


def _part_at(table: dict[str, Any], key: str, path: str) -> tuple[dict[str, Any], str]:
    """Return the table and the key in it of ``captures.NAME.key``, or of a key of the table itself."""
    parts, _, rest = key.partition(".")
    name, _, own_key = rest.rpartition(".")
    if not name:
        return table, key
    items = table.get(parts, [])
    named = [item for item in items if name in (item.get("name"), item.get("region"))]
    if parts == "spectra" and not named:
        # A region without a spectrum gets one.
        named = [{"region": name}]
        table[parts] = [*items, *named]
    if not named:
        names = ", ".join(str(item.get("name")) for item in items)
        raise ConfigurationError(f"{path!r}: there is no {name!r} in {parts}, give one of {names or 'none'}")
    return named[0], own_key


def _sensor_tables(tables: Any) -> list[tuple[str, _Table]]:
    if isinstance(tables, Mapping):
        tables = [tables]
    if not isinstance(tables, Sequence) or not all(isinstance(table, Mapping) for table in tables):
        raise ConfigurationError(f"sensor is {shown(tables)}: give a table [sensor], or several tables [[sensor]]")
    names = [table.get("name", "sensor") for table in tables]
    for name in names:
        if not isinstance(name, str):
            raise ConfigurationError(f"sensor.name is {shown(name)}: give text in quotes")
    if len(set(names)) < len(names):
        raise ConfigurationError(
            f"sensor has the names {shortened(', '.join(names))}: give each sensor a name of its own"
        )
    return [
        (name, {key: table[key] for key in table if key != "name"}) for name, table in zip(names, tables, strict=True)
    ]


def _part(name: str, table: Any, folder: Path, defaults: _Table | None = None) -> Any:
    """Make the part that a table stands for; `defaults` are for keys that the table leaves out."""
    type_name = table.get("type") if isinstance(table, Mapping) else None
    if type_name is not None and not isinstance(type_name, str):
        raise ConfigurationError(f"{name}.type is {shown(type_name)}: give text in quotes")
    cls = class_of(name, type_name)
    if isinstance(table, Mapping):
        table = {key: value for key, value in table.items() if key != "type"}
    part = _made_of_table(cls, name, table, folder, defaults or {})
    protocol, kind = _KINDS.get(name, (Stage, "stage"))
    try:
        # A scene from a file reads it for its size, of which it has no attribute without.
        fits = isinstance(part, protocol)
    except InputError as error:
        raise _located(error, name) from error
    if not fits:
        raise ConfigurationError(f"{name} is registered as {cls.__name__}, which is not a {kind}")
    return part


def _made_of_table(cls: type[Any], path: str, table: Any, folder: Path, defaults: _Table) -> Any:
    if not isinstance(table, Mapping):
        raise ConfigurationError(f"{path} is {shown(table)}: give a table [{path}]")
    known: dict[str, Field[Any]] = {field.name: field for field in fields(cls)}
    for key in table:
        if key not in known:
            raise ConfigurationError(
                f"{path}.{shortened(key)} is not a known key: {suggestion(key, known, 'give some of')}"
            )
    given = {key: value for key, value in defaults.items() if key in known} | dict(table)
    for key, field in known.items():
        if key not in given and field.default is MISSING and field.default_factory is MISSING:
            raise ConfigurationError(f"{path}.{key} is missing: add it to the table [{path}]")
    values = {key: _value(known[key], f"{path}.{key}", value, folder) for key, value in given.items()}
    try:
        return cls(**values)
    except InputError as error:
        raise _located(error, path) from error


def _located(error: InputError, path: str) -> ConfigurationError:
    """Return the error with its table."""
    return ConfigurationError(f"{path}{'.' if error.key else ': '}{error}")


def _value(field: Field[Any], path: str, value: Any, folder: Path) -> Any:
    if "path" in field.metadata:
        if not isinstance(value, str):
            raise ConfigurationError(f"{path} is {shown(value)}: give the name of a file in quotes")
        return folder / value
    if "table" in field.metadata:
        if not isinstance(value, list):
            raise ConfigurationError(f"{path} is {shown(value)}: give tables [[{path}]]")
        cls = field.metadata["table"]
        return tuple(_made_of_table(cls, f"{path}[{index}]", item, folder, {}) for index, item in enumerate(value))
    return value


def _table(name: str, part: Any, folder: Path, *left_out: str) -> dict[str, Any]:
    type_name = type_of(name, type(part))
    values = {key: value for key, value in _values(part, folder).items() if key not in left_out}
    return ({} if type_name is None else {"type": type_name}) | values


def _values(part: Any, folder: Path) -> dict[str, Any]:
    """Fields of a part; what TOML cannot hold, None and no tables at all, is left to the default."""
    values = {}
    for field in fields(part):
        value = getattr(part, field.name)
        if "path" in field.metadata and value is not None and value.is_relative_to(folder):
            value = value.relative_to(folder)
        elif "table" in field.metadata:
            value = [_values(item, folder) for item in value]
        elif "single" in field.metadata and len(value) == 1:
            value = value[0]
        if value is not None and not (isinstance(value, Mapping | list | tuple) and not value):
            values[field.name] = _plain(value)
    return values


def _plain(value: Any) -> Any:
    """Return NumPy's numbers and arrays, tuples and paths as what TOML has."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Path):
        return value.as_posix()
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value
