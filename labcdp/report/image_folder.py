"""Results that are made one after the other: gathered beside their place, and put there when all are made."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from pathlib import Path, PurePosixPath
from types import TracebackType
from typing import Self

from ..errors import InputError
from .folder import place_for_results, write_files

#: Where results wait, inside the folder they will be in.
_WAITING = ".labcdp-unfinished"
#: File that lists what a run wrote, under the key "written".
LIST_FILE = "results.json"


class ResultFolder:
    """Context in which files of results are gathered.

    They are put in their place by `finish`. Without it, as after an error, the folder is left as it was.

    Parameters
    ----------
    folder : Path
        Where results go; made if it does not exist.

    Raises
    ------
    InputError
        On entering, if the folder cannot be made or written to.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._waiting = folder, folder / _WAITING
        self._names: list[str] = []
        self._end = ExitStack()

    def __enter__(self) -> Self:
        """Make the folder and see that it can be written to."""
        with ExitStack() as end:
            end.enter_context(place_for_results(self._folder))
            end.callback(self._clear)
            self._clear()
            try:
                self._waiting.mkdir()
            except OSError as error:
                raise InputError(
                    f"{self._folder} cannot be written to ({error.strerror}): give a folder you can write to"
                ) from error
            self._end = end.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Remove what was not put in its place."""
        self._end.close()

    def add(self, files: Mapping[str, bytes]) -> None:
        """Keep files until all are made; names are relative to the folder.

        Raises
        ------
        InputError
            If they cannot be written.
        """
        try:
            write_files(self._waiting, files)
        except InputError as error:
            # Where they wait is nobody's business.
            reason = error.__cause__.strerror if isinstance(error.__cause__, OSError) else error
            raise InputError(
                f"results cannot be written to {self._folder} ({reason}): make room there, or give another folder for "
                "the results"
            ) from error
        self._names += files

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the files so far."""
        return tuple(self._names)

    def finish(self) -> list[Path]:
        """Put all files in their place; files that an earlier run wrote and this one did not are removed.

        Raises
        ------
        InputError
            If a place is taken by a folder, or cannot be written to.
        """
        targets = [self._folder / name for name in self._names]
        for target in targets:
            if target.is_dir():
                raise InputError(f"{target} is a folder: give another folder for the results")
        outdated = _written_before(self._folder) - set(self._names)
        try:
            for name, target in zip(self._names, targets, strict=True):
                target.parent.mkdir(parents=True, exist_ok=True)
                (self._waiting / name).replace(target)
        except OSError as error:
            raise InputError(
                f"{self._folder} cannot be written to ({error.strerror}): give a folder you can write to"
            ) from error
        for name in outdated:
            _remove(self._folder, name)
        return targets

    def _clear(self) -> None:
        shutil.rmtree(self._waiting, ignore_errors=True)


def _written_before(folder: Path) -> set[str]:
    """Names of the files that an earlier run lists as its own."""
    try:
        found = json.loads((folder / LIST_FILE).read_text(encoding="utf-8"))["written"]
    except (OSError, ValueError, TypeError, KeyError):
        return set()
    if not isinstance(found, list):
        return set()
    names = {name for name in found if isinstance(name, str)}
    # Nothing outside the folder, whatever the list says.
    return {name for name in names if ".." not in PurePosixPath(name).parts and not PurePosixPath(name).is_absolute()}


def _remove(folder: Path, name: str) -> None:
    """Remove a file, and the folders it leaves empty."""
    with suppress(OSError):
        (folder / name).unlink()
        for parent in PurePosixPath(name).parents:
            if parent != PurePosixPath("."):
                (folder / parent).rmdir()
