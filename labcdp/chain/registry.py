"""Classes of the tables of chain files, and the chain files that ship with labcdp.

A new stage, sensor model or scene is one small class and one call of `register`.
"""

from __future__ import annotations

import os
from dataclasses import is_dataclass
from importlib.metadata import entry_points
from importlib.resources import files
from pathlib import Path

from ..core.disk import is_file, read_text
from ..core.disk.documents import MOST_BYTES_OF_TOML
from ..core.disk.files import shown, suggestion
from ..core.errors import ConfigurationError, InputError

#: Entry points of installed packages under this name are loaded when a chain file names something unknown.
ENTRY_POINT_GROUP = "labcdp.chain"

_CLASSES: dict[str, dict[str, type]] = {}
# What else a chain file has at its top; only to be suggested.
_TEXTS = ("name", "description", "spectrum")


def register(table: str, cls: type, type_name: str = "standard") -> None:
    """Make a class known to chain files.

    Parameters
    ----------
    table : str
        Name of the table: ``scene``, ``sensor`` or any name of a stage.
    cls : type
        A frozen dataclass whose fields are the keys of the table: a `Scene`, `SensorModel` or `Stage`.
    type_name : str
        Value of the table's key ``type``. The first type of a table is the one meant without this key; a scene
        always needs it.

    Raises
    ------
    InputError
        If the class is no dataclass, or the table has another class under this type already.

    Examples
    --------
    >>> from dataclasses import dataclass, replace
    >>> from labcdp.chain import Context, Signal, register
    >>> @dataclass(frozen=True)
    ... class Filter:
    ...     takes = gives = "luminance"
    ...     transmittance: float
    ...     def process(self, signal: Signal, context: Context) -> Signal:
    ...         def inverse(values):
    ...             return signal.to_luminance(values / self.transmittance)
    ...         return replace(signal, values=self.transmittance * signal.values, to_luminance=inverse)
    >>> register("example-filter", Filter)
    """
    if not is_dataclass(cls):
        raise InputError(f"{cls.__name__} is not a dataclass: its fields become the keys of the table {table}")
    types = _CLASSES.setdefault(table, {})
    if types.get(type_name, cls) is not cls:
        raise InputError(
            f"the type {type_name!r} of {table} is {types[type_name].__name__} already: choose another name"
        )
    types[type_name] = cls


def class_of(table: str, type_name: str | None) -> type:
    """Return the class of a table.

    Raises
    ------
    ConfigurationError
        If table or type are unknown.
    """
    if _unknown(table, type_name):
        _load_entry_points(_unknown(table, type_name))
    if problem := _unknown(table, type_name):
        name, known = (type_name, _CLASSES[table]) if table in _CLASSES else (table, [*_CLASSES, *_TEXTS])
        raise ConfigurationError(f"{problem}: {suggestion(name, known, 'give one of')}")
    types = _CLASSES[table]
    if type_name is None and table == "scene":
        raise ConfigurationError(f"{table}.type is missing: give one of {', '.join(types)}")
    return types[type_name or next(iter(types))]


def _unknown(table: str, type_name: str | None) -> str:
    """Return which name is not known; empty if all are."""
    if table not in _CLASSES:
        return f"{table} is not known"
    unknown = type_name is not None and type_name not in _CLASSES[table]
    return f"{table}.type is {shown(type_name)}, which is not known" if unknown else ""


def type_of(table: str, cls: type) -> str | None:
    """Return the ``type`` of a class in a chain file, None where the table does not need one.

    Raises
    ------
    ConfigurationError
        If the class is not registered for the table.
    """
    types = _CLASSES.get(table, {})
    for number, (type_name, known) in enumerate(types.items()):
        if known is cls:
            return None if number == 0 and table not in ("scene", "sensor") else type_name
    raise ConfigurationError(
        f"{cls.__name__} is not registered for the table {table}, so no chain file can hold it: call "
        f"labcdp.chain.register({table!r}, {cls.__name__}, ...)"
    )


def _load_entry_points(reason: str) -> None:
    for point in entry_points(group=ENTRY_POINT_GROUP):
        try:
            point.load()
        except Exception as error:
            # Whatever happens while a foreign package is imported.
            raise ConfigurationError(
                f"{reason}, and the entry point {point.value!r} of {ENTRY_POINT_GROUP} cannot be loaded ({error}): "
                "repair or remove its package"
            ) from error


def preset_names() -> tuple[str, ...]:
    """Names of the chains that ship with labcdp.

    Examples
    --------
    >>> from labcdp.chain import preset_names
    >>> "manta-g505" in preset_names()
    True
    """
    return tuple(sorted(path.stem for path in _folder().glob("*.toml")))


def preset_text(name: str) -> str:
    """Return the chain file of a preset, with comments.

    Raises
    ------
    ConfigurationError
        If there is no such preset; the message lists the names.

    Examples
    --------
    >>> from labcdp.chain import preset_text
    >>> "[sensor]" in preset_text("manta-g505")
    True
    """
    names = preset_names()
    if name not in names:
        raise ConfigurationError(
            f"there is no preset {shown(name)}: {suggestion(name, names, 'give a .toml file, or one of')}"
        )
    return (_folder() / f"{name}.toml").read_text(encoding="utf-8")


def chain_text(name_or_path: str | Path) -> tuple[str, str, Path]:
    """Read a chain file.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a preset, or a chain file (``.toml``).

    Returns
    -------
    (str, str, Path)
        Its text, what messages call it, and the folder that paths in it are relative to.

    Raises
    ------
    ConfigurationError
        If there is no such preset or file, or the file cannot be read.
    """
    if not isinstance(name_or_path, str | Path):
        raise ConfigurationError(
            f"{shown(name_or_path)} is not a chain: give the name of a preset or the path of a .toml file"
        )
    path = Path(name_or_path)
    name = str(name_or_path)
    # Any other existing path is read, so that pipes and devices are refused with a specific message.
    is_name = name in preset_names() or not os.path.lexists(path)
    if path.suffix != ".toml" and is_name and not is_file(path):
        return preset_text(name), name, Path()
    return read_text(path, "a chain file or a preset", MOST_BYTES_OF_TOML, ConfigurationError), str(path), path.parent


def _folder() -> Path:
    return Path(str(files("labcdp"))) / "data" / "chains"
