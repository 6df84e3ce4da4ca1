"""Which class a table of a chain file stands for.

A new stage, sensor model or scene is one small class and one call of `register`.
"""

from __future__ import annotations

from dataclasses import is_dataclass
from difflib import get_close_matches
from importlib.metadata import entry_points

from ..errors import ConfigurationError, InputError

#: Entry points of installed packages under this name are loaded when a chain file names something unknown.
ENTRY_POINT_GROUP = "labcdp.chain"

_CLASSES: dict[str, dict[str, type]] = {}
# What else a chain file has at its top; only to be suggested.
_OTHER_NAMES = ("exposure", "hdr", "name", "description", "spectrum")


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
    """
    if not is_dataclass(cls):
        raise InputError(f"{cls.__name__} is no dataclass: its fields are to be the keys of the table {table}")
    types = _CLASSES.setdefault(table, {})
    if types.get(type_name, cls) is not cls:
        raise InputError(f"the type {type_name!r} of {table} is {types[type_name].__name__} already: give another name")
    types[type_name] = cls


def class_of(table: str, type_name: str | None) -> type:
    """Return the class of a table.

    Raises
    ------
    ConfigurationError
        If table or type are unknown; the text begins after the table's name.
    """
    if table not in _CLASSES:
        _load_entry_points("is not known")
    elif type_name is not None and type_name not in _CLASSES[table]:
        _load_entry_points(f".type is {type_name!r}, which is not known")
    if table not in _CLASSES:
        raise ConfigurationError(f"is not known: {_instead(table, [*_CLASSES, *_OTHER_NAMES])}")
    types = _CLASSES[table]
    if type_name is None:
        if table == "scene":
            raise ConfigurationError(f".type is missing: give one of {', '.join(types)}")
        type_name = next(iter(types))
    if type_name not in types:
        raise ConfigurationError(f".type is {type_name!r}, which is not known: {_instead(type_name, list(types))}")
    return types[type_name]


def _load_entry_points(reason: str) -> None:
    for point in entry_points(group=ENTRY_POINT_GROUP):
        try:
            point.load()
        except Exception as error:
            # Whatever happens while a foreign package is imported.
            raise ConfigurationError(
                f"{reason}, and the entry point {point.value!r} of {ENTRY_POINT_GROUP} cannot be loaded ({error}): "
                "mend or remove its package"
            ) from error


def _instead(name: str, known: list[str]) -> str:
    close = get_close_matches(str(name), known, n=1)
    return f"did you mean {close[0]}?" if close else f"give one of {', '.join(known)}"
