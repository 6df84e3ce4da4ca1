"""The folder of a session: its names, a new one, whether a folder is one, and whether it is sound."""

from __future__ import annotations

import errno
import os
import platform
import re
import secrets
import shutil
from collections.abc import Iterable, Sequence
from contextlib import ExitStack, suppress
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path

from ..core.clock import Clock
from ..core.disk.files import SESSION_JOURNAL
from ..core.errors import SessionError
from ..output.file import fsync_folder, is_temporary, lock, write_several
from .configuration import SessionConfiguration
from .frames import FRAMES, read_checked, reported
from .journal import FORMER_END, Entry, Journal, read_journal
from .records import SUPERSEDED, event_record

CONFIGURATION = "session.toml"
README = "README.txt"
#: File systems have names of at most 255 bytes.
_MOST_BYTES_OF_NAME = 200


#: Format of the sessions this labcdp writes; it reads earlier ones too.
FORMAT = 2


def require_session(path: Path) -> None:
    """Raise SessionError if a folder is no session."""
    with reported(path, "read"):
        try:
            names = os.listdir(path)
        except (FileNotFoundError, NotADirectoryError):
            names = []
    if SESSION_JOURNAL not in names and CONFIGURATION not in names:
        raise SessionError(f"{path} is not a session: it has no {SESSION_JOURNAL}; give the folder of a session")


def read_configuration(path: Path, entries: Sequence[Entry]) -> SessionConfiguration:
    """Read the configuration of the session whose journal has these entries; raises SessionError."""
    first = entries[0] if entries else None
    if first is None or first.kind != "session" or first.file is None:
        raise SessionError(f"{path / SESSION_JOURNAL} does not begin with a session: restore it from a copy")
    event_record(first)
    if first.content["format"] > FORMAT:
        raise SessionError(
            f"{path} has format {first.content['format']}, this labcdp knows up to {FORMAT}: update labcdp"
        )
    text = read_checked(path, first.file).decode(errors="replace")
    return SessionConfiguration.from_toml(text, str(path / first.file.name))


def create_folder(path: Path, configuration: SessionConfiguration, compress: bool, clock: Clock) -> Journal:
    """Make a session without records and return its journal, open for writing.

    Of several processes that begin the same session at once, one gets it: it is locked before it has its name.

    Raises
    ------
    SessionError
        If there is something already, or it cannot be written.
    """
    if path.resolve() == Path.cwd():
        raise SessionError("the current folder cannot become a session: give the name of a new folder inside it")
    with reported(path, "written"), ExitStack() as end:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists() and not (path.is_dir() and not any(path.iterdir())):
            raise _exists(path)
        _remove_unfinished(path)
        # Made under a temporary name, so that a session is there with all it needs or not at all.
        making = _temporary_folder(path, end)
        journal = _make(making, configuration, compress, clock)
        with ExitStack() as undo:
            undo.callback(journal.close)
            try:
                os.rename(making, path)
            except OSError as error:
                if error.errno in (errno.ENOTEMPTY, errno.EEXIST):
                    raise _exists(path) from error
                raise
            journal.moved_to(path)
            fsync_folder(path.parent)
            undo.pop_all()
    return journal


def _exists(path: Path) -> SessionError:
    return SessionError(f"{path} exists already: choose a new folder, or open the session in it")


def _temporary_folder(path: Path, end: ExitStack) -> Path:
    """Make a locked folder beside `path`, whatever is left of which is removed at the end."""
    while True:
        making = _part(path)
        making.mkdir()
        end.callback(shutil.rmtree, making, ignore_errors=True)
        # Another process may have removed it before it was locked, as an unfinished one.
        with suppress(FileNotFoundError, BlockingIOError):
            _lock_folder(making, end)
            if making.exists():
                return making


def _part(path: Path) -> Path:
    """Return the name for a session that is being made or removed, beside its folder."""
    return path.parent / f"{_hidden(path)}{secrets.token_hex(4)}.part"


def _hidden(path: Path) -> str:
    """Return the start of such names: the session's name, cut where the whole would be too long."""
    return os.fsdecode(os.fsencode(f".{path.name}")[:_MOST_BYTES_OF_NAME] + b".")


def _remove_unfinished(path: Path) -> None:
    """Remove what processes left that were killed while they made or removed it; what a process holds is kept."""
    name = re.compile(re.escape(_hidden(path)) + "[0-9a-f]{8}[.]part")
    for unfinished in [candidate for candidate in path.parent.iterdir() if name.fullmatch(candidate.name)]:
        with suppress(OSError), ExitStack() as end:
            if _lock_folder(unfinished, end):
                shutil.rmtree(unfinished, ignore_errors=True)


def _lock_folder(folder: Path, end: ExitStack) -> bool:
    """Lock a folder until the end; False where there are no such locks; raises OSError, BlockingIOError if locked."""
    if not hasattr(os, "O_DIRECTORY"):  # Windows
        return False
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    end.callback(os.close, descriptor)
    return lock(descriptor)


def _make(folder: Path, configuration: SessionConfiguration, compress: bool, clock: Clock) -> Journal:
    (folder / FRAMES).mkdir()
    text = files("labcdp").joinpath("data/session-readme.txt").read_bytes()
    toml, readme = write_several(folder, [(CONFIGURATION, (configuration.to_toml().encode(),)), (README, (text,))])
    versions = {"labcdp": version("labcdp"), "numpy": version("numpy"), "python": platform.python_version()}
    journal = Journal.create(folder, clock)
    try:
        journal.append("session", {"format": FORMAT, "compress": compress, "versions": versions}, toml)
        journal.append("readme", {}, readme)
    except BaseException:
        journal.close()
        raise
    return journal


def remove_session(folder: Path, recorded: Iterable[str]) -> None:
    """Remove a session with its folder; raises SessionError, and removes nothing, if the folder holds anything else."""
    session_names, folder = {SESSION_JOURNAL, FORMER_END, FRAMES, *recorded}, folder.resolve()
    with reported(folder, "removed"):
        others = {path.relative_to(folder).as_posix() for path in folder.rglob("*")} - session_names
        if others:
            raise SessionError(
                f"{folder} holds {min(others)}, which does not belong to the session: choose a new folder"
            )
        # First of all it loses its name: what a kill leaves is no session in part.
        removed = _part(folder)
        os.rename(folder, removed)
        fsync_folder(folder.parent)
        shutil.rmtree(removed)


def unrecorded(folder: Path, entries: Sequence[Entry]) -> list[str]:
    """Files in a session's folder that its journal does not know, as names inside it."""
    known = {entry.file.name for entry in entries if entry.file} | {SESSION_JOURNAL, FORMER_END}
    with reported(folder, "read"):
        files = [path for path in folder.rglob("*") if path.is_file() and not is_temporary(path)]
    return sorted({path.relative_to(folder).as_posix() for path in files} - known)


def given_up(entries: Sequence[Entry]) -> frozenset[int]:
    """Lines of the frames whose damaged files were superseded."""
    events = [entry.content for entry in entries if entry.kind == SUPERSEDED]
    return frozenset(line for content in events if content.get("damaged") for line in content["lines"])


def problems(folder: Path, entries: Sequence[Entry]) -> list[str]:
    """Check a session's journal on the disk and every file in it.

    Parameters
    ----------
    folder : Path
        The session's folder.
    entries : sequence of Entry
        The journal's lines as they were read.

    Returns
    -------
    list of str
        One line for each fault, none if all is sound.
    """
    texts: list[str] = []
    try:
        on_disk, _, torn = read_journal(folder)
        if torn:
            texts.append(
                f"{folder / SESSION_JOURNAL} ends with an incomplete line: open the session for writing once to set it "
                "aside"
            )
        if [entry.check for entry in on_disk[: len(entries)]] != [e.check for e in entries]:
            texts.append(f"{folder / SESSION_JOURNAL} was replaced since it was opened: open the session again")
    except SessionError as error:
        texts.append(str(error))
    lost = given_up(entries)
    for entry in entries:
        if entry.file is not None and entry.sequence not in lost:
            try:
                read_checked(folder, entry.file)
            except SessionError as error:
                texts.append(str(error))
    return texts
