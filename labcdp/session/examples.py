"""What ships with labcdp: a configuration to start from, and a small recorded session."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

_DATA = Path(str(files("labcdp"))) / "data"


def example_configuration() -> str:
    """Return the configuration of the demonstration as TOML, with comments."""
    return (_DATA / "bench.toml").read_text(encoding="utf-8")


def example_simulated_bench() -> str:
    """Return the description of the standard simulated bench as TOML, with comments."""
    return (_DATA / "simulated-bench.toml").read_text(encoding="utf-8")


def example_session() -> Path:
    """Return the folder of a small session recorded on the simulated bench."""
    return _DATA / "example-session"


def example_camera() -> str:
    """Return a camera specification as TOML, with comments: that of the 2018 thesis' camera."""
    return (_DATA / "cameras" / "thesis-2018.toml").read_text(encoding="utf-8")
