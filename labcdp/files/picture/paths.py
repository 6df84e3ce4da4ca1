"""Which files are pictures: by their names, in folders."""

from __future__ import annotations

import logging
import re
from collections.abc import Sequence
from os import PathLike
from pathlib import Path

from ...core.errors import InputError

_log = logging.getLogger(__name__)

#: Endings of the names of camera RAW files that LibRaw reads.
RAW_SUFFIXES = (
    ".3fr", ".arw", ".cr2", ".cr3", ".crw", ".dcr", ".dng", ".erf", ".fff", ".iiq", ".kdc", ".mef", ".mos", ".mrw",
    ".nef", ".nrw", ".orf", ".pef", ".raf", ".rw2", ".rwl", ".sr2", ".srf", ".srw", ".x3f",
)  # fmt: skip
#: Endings of names whose bytes say what they are.
STATED_SUFFIXES = (".exr", ".jpeg", ".jpg", ".npy", ".npz", ".png", ".tif", ".tiff", *RAW_SUFFIXES)
#: Usual endings of raw dumps; with a size given, any other ending is a dump too.
DUMP_SUFFIXES = (".bin", ".dat", ".raw")


def picture_paths(paths: Sequence[str | PathLike[str]]) -> list[Path]:
    """Files to read: those given, and of folders the images they hold, by name with numbers in order.

    A file that is given itself is kept whatever it is, so that reading it says what is wrong with it.

    Raises
    ------
    InputError
        If a folder holds no image, or cannot be read.
    """
    found: list[Path] = []
    for path in map(Path, paths):
        found += _in_folder(path) if path.is_dir() else [path]
    return list(dict.fromkeys(found))


def _in_folder(folder: Path) -> list[Path]:
    try:
        files = [path for path in folder.iterdir() if path.is_file() and not path.name.startswith(".")]
    except OSError as error:
        raise InputError(f"{folder} cannot be read ({error.strerror}): give a folder you can read") from error
    images = [path for path in files if path.suffix.lower() in (*STATED_SUFFIXES, *DUMP_SUFFIXES)]
    for path in sorted(set(files) - set(images)):
        _log.info("%s is left out: its name is not that of an image", path)
    if not images:
        raise InputError(f"{folder} holds no image: give a folder with some, or files")
    return sorted(images, key=_natural)


def _natural(path: Path) -> list[tuple[int, int, str]]:
    """Key that sorts img2 before img10."""
    parts = re.split(r"(\d+)", path.name.lower())
    return [(1, int(part), part) if part.isdecimal() else (0, 0, part) for part in parts]
