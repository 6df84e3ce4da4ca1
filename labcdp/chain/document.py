"""Reading chain files: TOML tables to the parts of a chain, with messages that name table, key and value."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import MISSING, Field, fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ..core.disk.files import closest, shortened, shown
from ..core.errors import ConfigurationError, InputError
from .hdr import Hdr
from .registry import class_of, type_of
from .scene.scenes import Scene
from .signal import ExposureSettings, SensorModel, Stage

_Made = TypeVar("_Made")
_Table = Mapping[str, Any]

_DEFAULT_SPECTRUM = "D65"
#: Keys at the top of a chain file that are text.
TEXTS = ("name", "description", "spectrum")


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
    texts = {}
    for key in TEXTS:
        texts[key] = document.get(key, _DEFAULT_SPECTRUM if key == "spectrum" else "")
        if not isinstance(texts[key], str):
            raise ConfigurationError(f"{key} is {shown(texts[key])}: give text in quotes")
    sensor_tables = _sensor_tables(document.get("sensor", []))
    scene = _scene(document, folder, _size(sensor_tables[:1]))
    before: list[tuple[str, Stage]] = []
    behind: list[tuple[str, Stage]] = []
    stages = before
    for name, table in document.items():
        if name == "hdr" and sensor_tables and (stages is before or behind):
            raise ConfigurationError("hdr merges the exposures of a sensor: put it right behind sensor")
        if name in ("sensor", "hdr"):
            stages = behind
        elif name not in (*TEXTS, "scene", "exposure"):
            stage = _made_of_table(class_of_table(name, table), name, table, folder, skip=("type",))
            if not isinstance(stage, Stage):
                raise ConfigurationError(f"{name} is registered as {type(stage).__name__}, which is no stage")
            stages.append((name, stage))
    size = {"width": scene.shape[1], "height": scene.shape[0]}
    sensors = []
    for name, table in sensor_tables:
        cls = class_of_table("sensor", table)
        sensor = _made_of_table(cls, "sensor", table, folder, size, skip=("type", "name"))
        if not isinstance(sensor, SensorModel):
            raise ConfigurationError(f"sensor is registered as {type(sensor).__name__}, which is no sensor model")
        sensors.append((name, sensor))
    exposure, hdr = document.get("exposure"), document.get("hdr")
    return {
        **texts,
        "scene": scene,
        "before": tuple(before),
        "sensors": tuple(sensors),
        "settings": None if exposure is None else _made_of_table(ExposureSettings, "exposure", exposure, folder),
        "hdr": None if hdr is None else _made_of_table(Hdr, "hdr", hdr, folder),
        "behind": tuple(behind),
    }


def _scene(document: _Table, folder: Path, size: _Table) -> Scene:
    if "scene" not in document:
        raise ConfigurationError("scene is missing: add a table [scene]")
    table = document["scene"]
    cls = class_of_table("scene", table)
    scene: Scene = _made_of_table(cls, "scene", table, folder, size, skip=("type",))
    try:
        is_scene = isinstance(scene, Scene)
        if is_scene:
            # A scene from a file reads it for its size.
            _ = scene.shape
    except InputError as error:
        raise _located(error, "scene", [field.name for field in fields(cls)]) from error
    if not is_scene:
        raise ConfigurationError(f"scene is registered as {cls.__name__}, which is no scene")
    return scene


def class_of_table(name: str, table: Any) -> type[Any]:
    """Return the class a table stands for; raises ConfigurationError."""
    type_name = table.get("type") if isinstance(table, Mapping) else None
    if type_name is not None and not isinstance(type_name, str):
        raise ConfigurationError(f"{name}.type is {shown(type_name)}: give text in quotes")
    try:
        return class_of(name, type_name)
    except ConfigurationError as error:
        text = str(error)
        raise ConfigurationError(f"{name}{text if text.startswith('.') else f' {text}'}") from None


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
    return list(zip(names, tables, strict=True))


def _size(sensor_tables: Sequence[tuple[str, _Table]]) -> dict[str, Any]:
    """Width and height where a sensor's table has them, for a scene that has not."""
    return {key: table[key] for _, table in sensor_tables for key in ("width", "height") if key in table}


def _made_of_table(
    cls: type[_Made], path: str, table: _Table, folder: Path, defaults: _Table | None = None, skip: Sequence[str] = ()
) -> _Made:
    """Make a dataclass of a table; `defaults` are for keys that the table leaves out, `skip` are keys not for it."""
    if not isinstance(table, Mapping):
        raise ConfigurationError(f"{path} is {shown(table)}: give a table [{path}]")
    known: dict[str, Field[Any]] = {field.name: field for field in fields(cls)}  # type: ignore[arg-type]
    given = {key: value for key, value in table.items() if key not in skip}
    for key in given:
        if key not in known:
            close = closest(key, known)
            hint = f"did you mean {close}?" if close else f"give some of {', '.join(known)}"
            raise ConfigurationError(f"{path}.{shortened(key)} is not a known key: {hint}")
    given = {key: value for key, value in (defaults or {}).items() if key in known} | given
    for key, field in known.items():
        if key not in given and field.default is MISSING and field.default_factory is MISSING:
            raise ConfigurationError(f"{path}.{key} is missing: add it to the table [{path}]")
    values = {key: _value(known[key], f"{path}.{key}", value, folder) for key, value in given.items()}
    try:
        return cls(**values)
    except InputError as error:
        raise _located(error, path, known) from error


def _located(error: InputError, path: str, keys: Iterable[str]) -> ConfigurationError:
    """Return the error with its table; what a class says of one of its parameters begins with its name."""
    separator = "." if re.split(r"[ .:]", str(error), maxsplit=1)[0] in keys else ": "
    return ConfigurationError(f"{path}{separator}{error}")


def _value(field: Field[Any], path: str, value: Any, folder: Path) -> Any:
    if "path" in field.metadata:
        if not isinstance(value, str):
            raise ConfigurationError(f"{path} is {shown(value)}: give the name of a file in quotes")
        return folder / value
    if "table" in field.metadata:
        if not isinstance(value, list):
            raise ConfigurationError(f"{path} is {shown(value)}: give tables [[{path}]]")
        cls = field.metadata["table"]
        return tuple(_made_of_table(cls, f"{path}[{index}]", item, folder) for index, item in enumerate(value))
    return value


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
