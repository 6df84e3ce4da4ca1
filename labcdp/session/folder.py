"""The folder of a session: its names, a new one, and whether a folder is one."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path

from ..core.clock import Clock
from ..core.errors import SessionError
from .configuration import SessionConfiguration
from .files import FRAMES, reported, write_whole
from .journal import Journal
from .journal_text import FORMER_END, JOURNAL
from .readme import README, README_TEXT

CONFIGURATION = "session.toml"

#: Format of the sessions this labcdp writes; it reads earlier ones too.
FORMAT = 2


def require_session(path: Path) -> None:
    """Raise SessionError if a folder is no session."""
    with reported(path, "read"):
        try:
            names = os.listdir(path)
        except (FileNotFoundError, NotADirectoryError):
            names = []
    if JOURNAL not in names and CONFIGURATION not in names:
        raise SessionError(f"{path} is not a session: it has no {JOURNAL}; give the folder of a session")


def make_folder(folder: Path, configuration: SessionConfiguration, compress: bool, clock: Clock) -> None:
    """Write a whole session without records."""
    (folder / FRAMES).mkdir(parents=True)
    toml = write_whole(folder, CONFIGURATION, configuration.to_toml().encode())
    readme = write_whole(folder, README, README_TEXT.encode())
    versions = {"labcdp": version("labcdp"), "numpy": version("numpy"), "python": platform.python_version()}
    journal = Journal.create(folder, clock)
    try:
        journal.append("session", {"format": FORMAT, "compress": compress, "versions": versions}, toml)
        journal.append("readme", {}, readme)
    finally:
        journal.close()


def remove_session(folder: Path, recorded: Iterable[str]) -> None:
    """Remove a session with its folder; raises SessionError, and removes nothing, if the folder holds anything else."""
    own = {JOURNAL, FORMER_END, FRAMES, *recorded}
    with reported(folder, "removed"):
        others = {path.relative_to(folder).as_posix() for path in folder.rglob("*")} - own
        if others:
            raise SessionError(f"{folder} holds {min(others)}, which is not of the session: give a new folder")
        for name in own - {FRAMES}:
            (folder / name).unlink(missing_ok=True)
        (folder / FRAMES).rmdir()
        folder.rmdir()
