"""The folder of a session: its names, a new one, and whether a folder is one."""

from __future__ import annotations

import os
import platform
import secrets
import shutil
from collections.abc import Iterable, Sequence
from importlib.metadata import version
from pathlib import Path

from ..core.clock import Clock
from ..core.errors import SessionError
from ..output.file import fsync_folder
from .configuration import SessionConfiguration
from .files import FRAMES, read_checked, reported, write_whole
from .journal import Journal
from .journal_text import FORMER_END, JOURNAL, Entry
from .readme import README, README_TEXT
from .records import event_record

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


def read_configuration(path: Path, entries: Sequence[Entry]) -> SessionConfiguration:
    """Read the configuration of the session whose journal has these entries; raises SessionError."""
    first = entries[0] if entries else None
    if first is None or first.kind != "session" or first.file is None:
        raise SessionError(f"{path / JOURNAL} does not begin with a session: restore it from a copy")
    event_record(first)
    if first.content["format"] > FORMAT:
        raise SessionError(
            f"{path} has format {first.content['format']}, this labcdp knows up to {FORMAT}: update labcdp"
        )
    text = read_checked(path, first.file).decode(errors="replace")
    return SessionConfiguration.from_toml(text, str(path / first.file.name))


def create_folder(path: Path, configuration: SessionConfiguration, compress: bool, clock: Clock) -> None:
    """Make a session without records; raises SessionError if there is something already, or it cannot be written."""
    if path.resolve() == Path.cwd():
        raise SessionError("the current folder cannot become a session: give the name of a new folder in it")
    # Made under a temporary name, so that a session is there with all it needs or not at all.
    making = path.parent / f".{path.name}.{secrets.token_hex(4)}.part"
    try:
        with reported(path, "written"):
            path.parent.mkdir(parents=True, exist_ok=True)
            if path.exists() and not (path.is_dir() and not any(path.iterdir())):
                raise SessionError(f"{path} exists already: give a new folder, or open the session in it")
            _make(making, configuration, compress, clock)
            os.rename(making, path)
            fsync_folder(path.parent)
    finally:
        shutil.rmtree(making, ignore_errors=True)


def _make(folder: Path, configuration: SessionConfiguration, compress: bool, clock: Clock) -> None:
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
