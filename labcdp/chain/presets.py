"""Chains that ship with labcdp, and loading one by name or from a file."""

from __future__ import annotations

from difflib import get_close_matches
from importlib.resources import files
from pathlib import Path

from ..errors import ConfigurationError
from .chain import Chain
from .chain_file import chain_from_toml


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
        close = get_close_matches(name, names, n=1)
        hint = f"did you mean {close[0]}?" if close else f"give a .toml file, or one of {', '.join(names)}"
        raise ConfigurationError(f"there is no preset {name!r}: {hint}")
    return (_folder() / f"{name}.toml").read_text(encoding="utf-8")


def load(name_or_path: str | Path) -> Chain:
    """Load a chain.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a preset, or a chain file (``.toml``).

    Raises
    ------
    ConfigurationError
        If there is no such preset or file, or its content cannot be used.
    """
    path = Path(name_or_path)
    if path.suffix != ".toml" and not path.is_file():
        return chain_from_toml(preset_text(str(name_or_path)), str(name_or_path))
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise ConfigurationError(f"{path} cannot be read ({reason}): give a chain file or a preset") from error
    return chain_from_toml(text, str(path), path.parent)


def _folder() -> Path:
    return Path(str(files("labcdp"))) / "data" / "chains"
