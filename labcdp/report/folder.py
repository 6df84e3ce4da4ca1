"""Results in a folder: all of a run, or all of the run before."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from errno import EISDIR
from os import fsync, strerror
from pathlib import Path
from tempfile import TemporaryFile

from ..errors import InputError


def write_files(folder: Path, files: Mapping[str, bytes], outdated: str = "") -> list[Path]:
    """Write files that are made already; those of an earlier run in the folder are replaced.

    Parameters
    ----------
    folder : Path
        Made if it does not exist, with the subfolders that the names have.
    files : mapping of str to bytes
        Content by name, relative to the folder.
    outdated : str
        Regular expression for names of files of an earlier run, in the same subfolders, that go if they are not
        among the files.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    InputError
        If the folder cannot be made or a file cannot be written.
    """
    path = folder
    try:
        parents = sorted({(folder / name).parent for name in files}, reverse=True)
        for path in parents:
            path.mkdir(parents=True, exist_ok=True)
        with ExitStack() as leftovers:
            whole: list[tuple[Path, Path]] = []
            for name, data in files.items():
                path = folder / name
                if path.is_dir():
                    raise IsADirectoryError(EISDIR, strerror(EISDIR), str(path))
                unfinished = path.with_name(f".{path.name}.unfinished")
                leftovers.callback(unfinished.unlink, missing_ok=True)
                with unfinished.open("wb") as file:
                    file.write(data)
                    file.flush()
                    fsync(file.fileno())
                whole.append((unfinished, path))
            # Only now that all are on the disk: a folder must not hold results of two runs.
            for unfinished, path in whole:
                unfinished.replace(path)
        for parent in parents:
            for path in parent.iterdir():
                if outdated and re.fullmatch(outdated, path.name) and path not in [target for _, target in whole]:
                    path.unlink()
    except OSError as error:
        raise InputError(
            f"{path} cannot be written ({error.strerror or error}): give a folder you can write to, on a disk with "
            "enough space"
        ) from error
    return [folder / name for name in files]


def prepare_folder(folder: Path) -> None:
    """Make a folder for results, so that long work does not end without a place for them.

    Raises
    ------
    InputError
        If it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder} cannot be made ({error.strerror}): give a folder you can write to") from error


@contextmanager
def place_for_results(folder: Path) -> Iterator[None]:
    """Make a folder for results and see that it can be written to; afterwards take it away if nothing came into it.

    Raises
    ------
    InputError
        If it cannot be made or written to.
    """
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        prepare_folder(folder)
        try:
            with TemporaryFile(dir=folder) as file:
                file.write(b"labcdp")
        except OSError as error:
            raise InputError(
                f"{folder} cannot be written to ({error.strerror}): give a folder you can write to, on a disk with "
                "enough space"
            ) from error
        yield
    finally:
        for path in made:
            with suppress(OSError):  # not empty: it holds the results
                path.rmdir()
