"""The list of the files that labcdp wrote into a folder of results."""

from __future__ import annotations

import hashlib
import json
import os
import stat
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path, PurePosixPath
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from ..core.disk import open_regular, read_json, reason, validated_as
from ..core.errors import InputError

#: Name of the list in its folder.
LIST_FILE = "labcdp-files.json"

_FORMAT, _VERSION = "labcdp-files", 1
#: A list of a million files is smaller.
_MOST_BYTES = 2**28


@dataclass(frozen=True)
class ListedFile:
    """A file as it was written.

    Parameters
    ----------
    name : str
        Path inside the folder, with forward slashes.
    size : int
        Length in bytes.
    sha256 : str
        SHA-256 of its bytes, in hexadecimal.
    """

    name: str
    size: int
    sha256: str

    @classmethod
    def of(cls, folder: Path, name: str) -> ListedFile:
        """Describe a file; raises OSError if it cannot be read."""
        with open_regular(folder / name) as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
            return cls(name, os.fstat(file.fileno()).st_size, digest)

    def is_unchanged(self, folder: Path) -> bool:
        """Whether the file is there, in real folders, with the content it was written with."""
        if not is_inside(folder, self.name):
            return False
        try:
            state = (folder / self.name).lstat()
            return stat.S_ISREG(state.st_mode) and state.st_size == self.size and self.of(folder, self.name) == self
        except OSError:
            return False


@dataclass(frozen=True)
class FileList:
    """What labcdp wrote into a folder.

    Parameters
    ----------
    command : str
        Command the results are of.
    finished : bool
        Whether the results are complete.
    files : tuple of ListedFile
        The files; while results are replaced, a name may be listed as it was and as it will be.
    journal : str or None
        File to which an unfinished command adds, and with which it resumes.
    labcdp : str
        Version that wrote them.
    """

    command: str
    finished: bool
    files: tuple[ListedFile, ...] = ()
    journal: str | None = None
    labcdp: str = field(default_factory=lambda: version("labcdp"))

    def encode(self) -> bytes:
        """Return the content of the list's file."""
        return (json.dumps({"format": _FORMAT, "version": _VERSION, **asdict(self)}, indent=1) + "\n").encode("ascii")


def read_list(folder: Path) -> FileList | None:
    """Read the list of a folder; None if it has none.

    Raises
    ------
    InputError
        If there is one that cannot be read, is damaged, or was written by a newer version.
    """
    path = folder / LIST_FILE
    remedy = "give another --output"
    try:
        state = path.lstat()
        if not stat.S_ISREG(state.st_mode) or state.st_size > _MOST_BYTES:
            raise InputError(f"{path} is not a file list of labcdp: {remedy}")
        values = read_json(path, "another --output", _MOST_BYTES)
        if isinstance(values, dict) and values.get("version", _VERSION) != _VERSION:
            raise InputError(f"{path} was written by another version of labcdp: {remedy}")
        try:
            listed = validated_as(_Document, values)
        except InputError as error:
            raise InputError(f"{path} is damaged ({error}): {remedy}") from error
        files = tuple(ListedFile(one.name, one.size, one.sha256) for one in listed.files)
        return FileList(listed.command, listed.finished, files, listed.journal, listed.labcdp)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise InputError(f"{path} cannot be read ({reason(error)}): {remedy}") from error


def by_name(files: tuple[ListedFile, ...]) -> Mapping[str, list[ListedFile]]:
    """Descriptions of each file by its name."""
    found: dict[str, list[ListedFile]] = {}
    for one in files:
        found.setdefault(one.name, []).append(one)
    return found


def is_inside(folder: Path, name: str) -> bool:
    """Whether the subfolders of a name are folders, and no links to elsewhere."""
    parents = [folder / parent for parent in PurePosixPath(name).parents if parent != PurePosixPath(".")]
    return not any(os.path.lexists(one) and (one.is_symlink() or not one.is_dir()) for one in parents)


def _name(name: str) -> str:
    path = PurePosixPath(name)
    if not name or path.is_absolute() or ".." in path.parts or name == LIST_FILE or "\0" in name:
        raise ValueError("it is no name of a file in the folder")
    return name


_Name = Annotated[str, AfterValidator(_name)]


class _DocumentFile(BaseModel):
    model_config = ConfigDict(extra="forbid")
    name: _Name
    size: int = Field(ge=0)
    sha256: str


class _Document(BaseModel):
    model_config = ConfigDict(extra="forbid")
    format: Literal["labcdp-files"]
    version: int
    command: str
    finished: bool
    files: list[_DocumentFile]
    journal: _Name | None
    labcdp: str
