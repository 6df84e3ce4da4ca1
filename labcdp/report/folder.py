"""Results in a folder: all of them, each whole or not at all."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from ..errors import InputError
from ..session.files import write_whole


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
        for parent in sorted({(folder / name).parent for name in files}, reverse=True):
            path = parent
            parent.mkdir(parents=True, exist_ok=True)
            for old in parent.iterdir():
                if outdated and re.fullmatch(outdated, old.name) and str(old.relative_to(folder)) not in files:
                    old.unlink()
        for name, data in files.items():
            path = folder / name
            write_whole(path.parent, path.name, data)
    except OSError as error:
        raise InputError(
            f"{path} cannot be written ({error.strerror or error}): give a folder you can write to, on a disk with "
            "enough space"
        ) from error
    return [folder / name for name in files]
