"""The list of the files that labcdp wrote into a folder of results, and what must not be replaced."""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from os import PathLike
from pathlib import Path, PurePosixPath
from typing import Any, ClassVar

from ..core.disk import read_json, reading, validated_as
from ..core.errors import InputError
from .file import StoredFile, file_exists, require_replaceable, writing

#: Name of the list in its folder.
LIST_FILE = "labcdp-files.json"

_HEAD = {"format": "labcdp-files", "version": 1}
#: A list of a million files is smaller.
_MOST_BYTES = 2**28


@dataclass(frozen=True)
class FileList:
    """What labcdp wrote into a folder.

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
        for name in (*(one.name for one in self.files), *([] if self.journal is None else [self.journal])):
            path = PurePosixPath(name)
            if not name or path.is_absolute() or ".." in path.parts or name == LIST_FILE or "\0" in name:
                raise InputError(f"{name!r} does not name a file in the folder")

    def encode(self) -> bytes:
        """Return the content of the list's file."""
        return (json.dumps(_HEAD | asdict(self), indent=1) + "\n").encode("ascii")

    @property
    def by_name(self) -> dict[str, list[StoredFile]]:
        """Descriptions of each file by its name."""
        found: dict[str, list[StoredFile]] = {}
        for one in self.files:
            found.setdefault(one.name, []).append(one)
        return found


def read_list(folder: Path) -> FileList | None:
    """Read the list of a folder; None if it has none.

    Raises
    ------
    InputError
        If there is one that cannot be read, is damaged, or was written by a newer version.
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
    """
    path = Path(path)
    name = f"{option} {path}".lstrip()
    with writing(path):  # as of a name that is too long
        is_folder, has_folder = path.is_dir(), path.parent.is_dir()
    if is_folder:
        raise InputError(f"{name} is a folder: give the name of a file")
    if any(_is_input(path, one) for one in inputs):
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


def is_same_file(one: Path, other: Path) -> bool:
    """Whether two paths lead to one file; False if one of them leads nowhere."""
    try:
        return os.path.samefile(one, other)
    except OSError:
        return False


def _is_input(path: Path, one: Path) -> bool:
    """Whether a file is an input, or exists already in an input folder."""
    inside = one.is_dir() and os.path.lexists(path) and path.parent.resolve().is_relative_to(one.resolve())
    return inside or is_same_file(path, one)


def _require_no_result(path: Path, name: str) -> None:
    """Refuse a file that the list of a results folder names, or the list itself."""
    place = path.parent.resolve() / path.name
    for folder in place.parents:
        listed = read_list(folder)
        if listed and place.relative_to(folder).as_posix() in (LIST_FILE, *listed.by_name):
            raise InputError(f"{name} belongs to the results of labcdp {listed.command}: choose another name")
