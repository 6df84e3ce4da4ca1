"""A folder of results: all files of a run, or none, and nothing that labcdp did not write is touched.

A list in the folder names the files that labcdp wrote there.
"""

from __future__ import annotations

import json
import os
import re
import secrets
import shutil
import stat
from collections.abc import Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext, suppress
from dataclasses import asdict, dataclass, field, replace
from importlib.metadata import version
from os import PathLike
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeAlias

from ..core.disk import read_json, reading, validated_as
from ..core.errors import InputError
from .file import (
    Buffer,
    StoredFile,
    file_exists,
    fsync_folder,
    is_inside,
    lock_folder,
    make_folder,
    put_in_place,
    require_replaceable,
    write_file,
    writing,
)

if TYPE_CHECKING:
    from ..core.disk.journal import LineJournal

#: Name of the list in its folder.
LIST_FILE = "labcdp-files.json"

_HEAD = {"format": "labcdp-files", "version": 1}
#: A list of a million files is smaller.
_MOST_BYTES = 2**28


@dataclass(frozen=True)
class FileList:
    """The list of the files that labcdp wrote into a folder.

    Parameters
    ----------
    command : str
        Command the results are of.
    finished : bool
        Whether the results are complete.
    files : tuple of StoredFile
        The files; while results are replaced, a name may be listed as it was and as it will be.
    journal : str or None
        File to which an unfinished command adds, and with which it resumes.
    labcdp : str
        Version that wrote them.

    Raises
    ------
    InputError
        If a name is none of a file in the folder.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    command: str
    finished: bool
    files: tuple[StoredFile, ...]
    journal: str | None
    labcdp: str = field(default_factory=lambda: version("labcdp"))

    def __post_init__(self) -> None:
        for name in (*(file.name for file in self.files), *([] if self.journal is None else [self.journal])):
            path = PurePosixPath(name)
            if not name or path.is_absolute() or ".." in path.parts or name == LIST_FILE or "\0" in name:
                raise InputError(f"{name!r} does not name a file in the folder")

    def encode(self) -> bytes:
        """Return the content of the list's file."""
        return (json.dumps(_HEAD | asdict(self), indent=1) + "\n").encode("ascii")

    @property
    def by_name(self) -> dict[str, list[StoredFile]]:
        """Descriptions of each file by its name."""
        by_name: dict[str, list[StoredFile]] = {}
        for file in self.files:
            by_name.setdefault(file.name, []).append(file)
        return by_name


def read_list(folder: Path) -> FileList | None:
    """Read the list of a folder; None if it has none.

    Raises
    ------
    InputError
        If there is one that cannot be read, is damaged, or was written by a newer version.

    Examples
    --------
    >>> from pathlib import Path
    >>> from labcdp.output import ResultsFolder, read_list
    >>> with ResultsFolder("listed", "image") as results:
    ...     added = results.add({"note.txt": b"measured at noon"})
    >>> [file.name for file in read_list(Path("listed")).files]
    ['note.txt']
    """
    path = folder / LIST_FILE
    remedy = "choose another folder"
    with reading(path, "another folder"):
        try:
            state = path.lstat()
        except FileNotFoundError:
            return None
    if not stat.S_ISREG(state.st_mode) or state.st_size > _MOST_BYTES:
        raise InputError(f"{path} is not a file list of labcdp: {remedy}")
    values = read_json(path, "another folder", _MOST_BYTES)
    if isinstance(values, dict):
        head = {key: values.pop(key, None) for key in _HEAD}
        if head["version"] not in (None, _HEAD["version"]):
            raise InputError(f"{path} was written by another version of labcdp: {remedy}")
        values |= {} if head == _HEAD else head
    try:
        return validated_as(FileList, values)
    except InputError as error:
        raise InputError(f"{path} is not as labcdp wrote it ({error}): {remedy}") from error


class ResultsFolder:
    """Context in which a command writes its results; they are in their folder when it ends without an error.

    Files wait in a hidden subfolder until all are made. Then they get their places, and last the folder gets a list of
    them (`LIST_FILE`). After an error the folder is left as it was.

    Parameters
    ----------
    folder : path-like
        A new folder, an empty one, or one with unfinished results of the same command.
    command : str
        Command whose results these are.
    force : bool
        Whether finished results of the same command are replaced: unmodified files of the list.
    resume : bool
        Whether finished results of the same command are completed.
    inputs : iterable of Path
        Files and folders that are never replaced.

    Raises
    ------
    InputError
        On entering, if the folder holds anything else, a listed file was changed or is an input, or the folder cannot
        be written to.

    Examples
    --------
    >>> from labcdp.output import ResultsFolder
    >>> with ResultsFolder("results", "image") as results:
    ...     added = results.add({"note.txt": b"measured at noon"})
    >>> (results.folder / "note.txt").read_text()
    'measured at noon'
    """

    def __init__(
        self,
        folder: str | PathLike[str],
        command: str,
        *,
        force: bool = False,
        resume: bool = False,
        inputs: Iterable[Path] = (),
    ) -> None:
        self.folder = Path(folder)
        #: Whether the results will be complete; unfinished ones are resumed without `force`.
        self.complete = True
        self._command, self._force, self._resume, self._inputs = command, force, resume, tuple(inputs)
        self._before: FileList | None = None
        self._journal: str | None = None
        self._begun = False
        self._staging = Path()
        self._end = ExitStack()

    def __enter__(self) -> Self:
        """Check the folder and make it."""
        with ExitStack() as end:
            make_folder(self.folder, end)
            is_locked = lock_folder(self.folder, end)
            stale = [path for path in self._entries() if is_staging(path)]
            for path in stale if is_locked else ():
                _remove_staging(path)
            self._before = self._checked(stale)
            self._staging = self.folder / f".labcdp-{secrets.token_hex(8)}.unfinished"
            end.callback(self._tidy)
            with writing(self.folder):
                self._staging.mkdir()
                # The mark of a subfolder that may be removed after a kill.
                (self._staging / LIST_FILE).touch()
            self._end = end.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Put the files in their places; after an error, remove them."""
        with self._end:
            if kind is None and self.names:
                with writing(self.folder):
                    self._finish()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the files so far, relative to the folder."""
        files = (path.relative_to(self._staging) for path in self._staging.rglob("*") if path.is_file())
        return tuple(sorted(name.as_posix() for name in files if name != Path(LIST_FILE)))

    def add(self, files: Mapping[str, Buffer]) -> list[Path]:
        """Keep files, by names relative to the folder, and return the paths they will have.

        Raises
        ------
        InputError
            If they cannot be written.
        """
        for name, data in files.items():
            with writing(self.folder / name), open(self.path(name), "xb") as file:
                file.write(data)
        return [self.folder / name for name in files]

    def path(self, name: str) -> Path:
        """Temporary path of a file, for libraries that write to a path."""
        path = self._staging / name
        with writing(self.folder / name):
            path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def journal(self, name: str) -> Path:
        """Return the path of a file that is written at its place at once, with which the command resumes.

        With `force` one of an earlier run is removed.

        Raises
        ------
        InputError
            If a file of that name is not labcdp's.
        """
        path = self.folder / name
        is_ours = self._before is not None and name in (self._before.journal, *self._before.by_name)
        if os.path.lexists(path):
            if not is_ours or path.is_symlink() or not path.is_file():
                raise _foreign(path)
            if self._force:
                path.unlink()
        self._journal = name
        self.keep()
        return path

    def keep(self) -> None:
        """Let the same command resume what is in the folder if it is interrupted from now on."""
        self._begun = True
        self._write_list(self._files_before, self._journal)

    @property
    def _files_before(self) -> tuple[StoredFile, ...]:
        return tuple(stored for stored in self._before.files if stored.name != self._journal) if self._before else ()

    def _entries(self) -> list[Path]:
        with reading(self.folder, "another folder"):
            return [path for path in self.folder.iterdir() if path.name != LIST_FILE]

    def _checked(self, stale: list[Path]) -> FileList | None:
        """Read the list of the folder, and refuse what must not be written to."""
        folder, before = self.folder, read_list(self.folder)
        if before is None:
            foreign = [path for path in self._entries() if path not in stale]
            if foreign:
                raise InputError(
                    f"{folder} contains files but no {LIST_FILE}, so labcdp does not write there: choose another folder"
                )
            return None
        if before.command != self._command:
            raise InputError(f"{folder} has results of labcdp {before.command}: choose another folder")
        if before.finished and not (self._force or self._resume):
            raise InputError(
                f"{folder} already has results: choose another folder with --output, or add --force (force=True in "
                "Python)"
            )
        listed = before.by_name
        for path in {folder, *((folder / name).parent for name in listed), *(folder / name for name in listed)}:
            if any(is_same_file(path, source) for source in self._inputs):
                raise InputError(f"{path} is an input of this command: choose another folder")
        for name, known in listed.items():
            if os.path.lexists(folder / name) and not any(stored.is_unchanged(folder) for stored in known):
                raise _changed(folder / name)
        return before

    def _finish(self) -> None:
        new = [StoredFile.of(self._staging, name) for name in self.names]
        journal = self._journal or (self._before.journal if self._before else None)
        older = self._files_before
        before = FileList(self._command, False, older, journal).by_name
        for made in new:
            self._require_place(made.name, before)
            with (self._staging / made.name).open("rb") as file:
                os.fsync(file.fileno())
        self._write_list((*older, *new), journal)
        self._begun = True
        for made in new:
            target = self.folder / made.name
            target.parent.mkdir(parents=True, exist_ok=True)
            try:
                put_in_place(self._staging / made.name, target, force=made.name in before)
            except FileExistsError as error:
                raise _foreign(target) from error
        names = {stored.name for stored in new}
        for name, known in before.items():
            if name not in names and any(stored.is_unchanged(self.folder) for stored in known):
                self._remove(name)
        for parent in {(self.folder / stored.name).parent for stored in new}:
            fsync_folder(parent)
        if journal is not None and (self.folder / journal).is_file():
            new.append(StoredFile.of(self.folder, journal))
        self._write_list(tuple(new), None if self.complete else journal, self.complete)
        self._before = None
        self._begun = False

    def _require_place(self, name: str, before: Mapping[str, list[StoredFile]]) -> None:
        target = self.folder / name
        if not is_inside(self.folder, name):
            raise InputError(f"{target.parent} was not created by labcdp: move it away, or choose another folder")
        if os.path.lexists(target):
            if name not in before:
                raise _foreign(target)
            if not any(stored.is_unchanged(self.folder) for stored in before[name]):
                raise _changed(target)

    def _remove(self, name: str) -> None:
        """Remove a file of an earlier run, and the folders it leaves empty."""
        (self.folder / name).unlink()
        with suppress(OSError):
            for parent in PurePosixPath(name).parents[:-1]:
                (self.folder / parent).rmdir()

    def _write_list(self, files: tuple[StoredFile, ...], journal: str | None, finished: bool = False) -> None:
        self._put_list(FileList(self._command, finished, files, journal))

    def _put_list(self, listed: FileList) -> None:
        # It waits in the subfolder too, so that a kill leaves no temporary file outside it.
        waiting = self._staging / f"new-{LIST_FILE}"
        write_file(waiting, listed.encode(), force=True)
        with writing(self.folder / LIST_FILE):
            put_in_place(waiting, self.folder / LIST_FILE, force=True)
            fsync_folder(self.folder)

    def _tidy(self) -> None:
        """Remove what is not in its place, and the list if there is nothing to resume."""
        if self._begun:
            with suppress(OSError, InputError):
                self._tidy_list()
        _remove_staging(self._staging)

    def _tidy_list(self) -> None:
        if self._journal is not None and not (self.folder / self._journal).exists() and self._before is not None:
            self._put_list(replace(self._before, files=self._files_before, journal=None))
        elif self._before is None and self._entries() == [self._staging]:
            (self.folder / LIST_FILE).unlink()


#: Where results may go: a path, or a folder of results that is open already.
Destination: TypeAlias = str | PathLike[str] | ResultsFolder


def open_results(destination: Destination, command: str) -> AbstractContextManager[ResultsFolder]:
    """Return the context of a folder of results; that of one that is open already does nothing.

    Examples
    --------
    >>> from labcdp.output import open_results
    >>> with open_results("opened", "image") as results, open_results(results, "image") as same:
    ...     print(same is results)
    True
    """
    if isinstance(destination, ResultsFolder):
        return nullcontext(destination)
    return ResultsFolder(destination, command)


def is_staging(path: Path) -> bool:
    """Whether this is a subfolder in which files wait, or waited until a kill: by its name, and empty or marked."""
    if re.fullmatch(r"\.labcdp-[0-9a-f]{16}\.unfinished", path.name) is None or path.is_symlink() or not path.is_dir():
        return False
    return (path / LIST_FILE).is_file() or not any(path.iterdir())


def _remove_staging(folder: Path) -> None:
    """Remove a subfolder, its mark last: what a kill leaves of it is still known to be one."""
    with suppress(OSError):
        for path in folder.iterdir():
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path, ignore_errors=True)
            elif path.name != LIST_FILE:
                path.unlink()
        (folder / LIST_FILE).unlink(missing_ok=True)
        folder.rmdir()


def _foreign(path: Path) -> InputError:
    return InputError(f"{path} was not written by labcdp: move it away, or choose another folder")


def _changed(path: Path) -> InputError:
    return InputError(f"{path} was changed since labcdp wrote it: move it away, or choose another folder")


@contextmanager
def results_journal(
    destination: Destination | None, command: str, name: str, head: Mapping[str, Any], what: str
) -> Iterator[LineJournal]:
    """Open the journal of results, or begin one; without a result it goes, and other settings may have the folder.

    Parameters
    ----------
    destination : path, ResultsFolder or None
        Folder of the results; None for one that goes.
    command : str
        Command whose results these are.
    name : str
        Name of the journal in the folder.
    head, what
        As for `LineJournal.open`.

    Raises
    ------
    InputError
        As `LineJournal.open`, or if the folder cannot be used.

    Examples
    --------
    >>> from labcdp.output import results_journal
    >>> with results_journal(None, "sweep", "cells.jsonl", {"chain": "manta-g505"}, "sweep") as journal:
    ...     print(len(journal))
    0
    """
    from ..core.disk.journal import LineJournal

    with ExitStack() as stack:
        if destination is None:
            path = Path(stack.enter_context(TemporaryDirectory(prefix="labcdp-"))) / name
        else:
            path = stack.enter_context(open_results(destination, command)).journal(name)
        journal = LineJournal.open(path, head, what)
        stack.callback(lambda: journal.close() if len(journal) else journal.discard())
        yield journal


def check_file(
    path: str | PathLike[str], *, force: bool = False, inputs: Iterable[Path] = (), option: str = ""
) -> Path:
    """Check that a file can be written, before the work whose result it will hold.

    Parameters
    ----------
    path : path-like
        File to be written.
    force : bool
        Whether an existing file may be replaced.
    inputs : iterable of Path
        Files that are never replaced, and folders in which none is.
    option : str
        Option of the command line that names the file, for messages; empty in Python.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        If it exists and may not be replaced, is a folder, an input, or one of the results in a folder of labcdp, or its
        folder is missing or not writable.

    Examples
    --------
    >>> from labcdp.output import check_file
    >>> check_file("map.exr").name
    'map.exr'
    """
    path = Path(path)
    name = f"{option} {path}".lstrip()
    with writing(path):  # as of a name that is too long
        is_folder, has_folder = path.is_dir(), path.parent.is_dir()
    if is_folder:
        raise InputError(f"{name} is a folder: give the name of a file")
    if any(_is_input(path, source) for source in inputs):
        raise InputError(f"{name} is an input of this command: choose another name")
    if os.path.lexists(path):
        require_replaceable(path, name)
        if not force:
            raise file_exists(path, option)
        _require_no_result(path, name)
    if not has_folder:
        raise InputError(f"{name} cannot be written: {path.parent} is not a folder; give one that exists")
    if not os.access(path.parent, os.W_OK):
        raise InputError(f"{name} cannot be written: you may not write to {path.parent}; choose another folder")
    return path


def is_same_file(first: Path, other: Path) -> bool:
    """Whether two paths lead to one file; False if one of them leads nowhere."""
    try:
        return os.path.samefile(first, other)
    except OSError:
        return False


def _is_input(path: Path, source: Path) -> bool:
    """Whether a file is an input, or exists already in an input folder."""
    inside = source.is_dir() and os.path.lexists(path) and path.parent.resolve().is_relative_to(source.resolve())
    return inside or is_same_file(path, source)


def _require_no_result(path: Path, name: str) -> None:
    """Refuse a file that the list of a results folder names, or the list itself."""
    file = path.parent.resolve() / path.name
    for folder in file.parents:
        listed = read_list(folder)
        if listed and file.relative_to(folder).as_posix() in (LIST_FILE, *listed.by_name):
            raise InputError(f"{name} belongs to the results of labcdp {listed.command}: choose another name")
