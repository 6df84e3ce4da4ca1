"""Chain files that ship with labcdp, and reading one by name or path."""

from __future__ import annotations

import os
from importlib.resources import files
from pathlib import Path

from ..core.disk import is_file, read_text
from ..core.disk.documents import MOST_BYTES_OF_TOML
from ..core.disk.quoting import closest, shown
from ..core.errors import ConfigurationError


def preset_names() -> tuple[str, ...]:
    """Names of the chains that ship with labcdp."""
    return tuple(sorted(path.stem for path in _folder().glob("*.toml")))


def preset_text(name: str) -> str:
    """Return the chain file of a preset, with comments.

    Raises
    ------
    ConfigurationError
        If there is no such preset; the message lists the names.
    """
    names = preset_names()
    if name not in names:
        close = closest(name, names)
        hint = f"did you mean {close}?" if close else f"give a .toml file, or one of {', '.join(names)}"
        raise ConfigurationError(f"there is no preset {shown(name)}: {hint}")
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
            f"{shown(name_or_path)} is no chain: give the name of a preset or the path of a .toml file"
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
