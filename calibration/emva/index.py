"""The index of a data set after EMVA 1288: which images were taken at which exposure and with how many photons."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from math import isfinite
from os import PathLike
from pathlib import Path
from typing import Literal

from ...core.disk import is_file, quoted, read_text
from ...core.disk.files import shortened
from ...core.errors import InputError

#: Name of the index in the folder of a data set.
INDEX_NAME = "EMVA1288_Data.txt"

#: How many numbers follow each letter, and what they are.
_LETTERS = {
    "v": (1, "the release, for example v 3.1"),
    "n": (3, "bits, width and height, for example n 12 640 480"),
    "b": (2, "exposure in ns and photons per pixel, for example b 40000.0 120.0"),
    "d": (1, "exposure in ns, for example d 40000.0"),
}
#: Largest size of an index.
_MOST_BYTES = 16 * 2**20
#: Longest plausible exposure, in ns: one day.
_LONGEST_NS = 8.64e13


@dataclass(frozen=True)
class IndexBlock:
    """Images of one condition.

    Parameters
    ----------
    kind : {'bright', 'dark'}
        With light or without.
    exposure_ns : float
        Exposure time in nanoseconds, as the index gives it.
    photons : float
        Mean photons a pixel received during the exposure; 0 in dark signal.
    images : tuple of Path
        Paths of the images.
    line : int
        Line of the index.
    image_lines : tuple of int
        Lines of the images.
    """

    kind: Literal["bright", "dark"]
    exposure_ns: float
    photons: float
    images: tuple[Path, ...]
    line: int
    image_lines: tuple[int, ...]

    @property
    def exposure_s(self) -> float:
        """Exposure time in seconds."""
        return self.exposure_ns * 1e-9


@dataclass(frozen=True)
class DataSetIndex:
    """A data set.

    Parameters
    ----------
    path : Path
        The index file.
    release : str
        Release of the standard it was recorded for.
    bits : int
        Bits of the DN scale, 1 to 16.
    width, height : int
        Size of the images in pixels.
    blocks : tuple of IndexBlock
        In the order of the file.
    """

    path: Path
    release: str
    bits: int
    width: int
    height: int
    blocks: tuple[IndexBlock, ...]


def index_path(path: str | PathLike[str]) -> Path | None:
    """Index file that a path stands for: itself, or the one in a folder; None if a folder has none."""
    given = Path(path)
    if not given.is_dir():
        return given
    file = given / INDEX_NAME
    return file if is_file(file) else None


def load_index(path: str | PathLike[str]) -> DataSetIndex:
    """Read the index of a data set, and check that its images exist.

    Lines begin with a letter: ``v`` release, ``n`` bits, width and height, ``b`` exposure in ns and photons, ``d``
    exposure in ns, ``i`` path of an image relative to the index, with slashes of either kind, quoted or not. ``#``
    begins a comment.

    Parameters
    ----------
    path : path
        The index, or a folder that has one called `INDEX_NAME`.

    Raises
    ------
    InputError
        If the file cannot be read, a line cannot be understood, a value is out of range, images are missing, or
        there is only one exposure; the message names file and line.
    """
    file = index_path(path)
    if file is None:
        raise InputError(f"{path} has no {INDEX_NAME}: give the index of a data set")
    index = parse_index(read_text(file, "the index of a data set, a text file", _MOST_BYTES), file)
    _require_images(index)
    return index


def parse_index(text: str, path: Path) -> DataSetIndex:
    """Read the text of an index; messages and image paths take its `path`. Errors as `load_index`."""
    release, size = "", None
    blocks: list[IndexBlock] = []
    for number, raw in enumerate(text.splitlines(), start=1):
        line = raw.strip()
        if not line or line.startswith("#"):
            continue
        where = f"{path}, line {number}"
        letter, rest = line[0], line[1:].strip()
        if len(line.split()[0]) != 1 or letter not in (*_LETTERS, "i"):
            raise InputError(f"{where}: {quoted(line)} starts with none of the letters v, n, b, d, i and #: correct it")
        if letter == "i":
            if not blocks:
                raise InputError(f"{where}: an image comes before the first line b or d: say at which exposure it is")
            if not rest:
                raise InputError(f"{where}: the image has no path: give it after the i")
            last, image = blocks[-1], path.parent / _unquoted(rest).replace("\\", "/")
            blocks[-1] = replace(last, images=(*last.images, image), image_lines=(*last.image_lines, number))
            continue
        values = _numbers(letter, rest, where)
        if letter == "v":
            release = rest
        elif letter == "n":
            if size is not None:
                raise InputError(f"{where}: a second line n, a data set has images of one size and depth: split it")
            size = _size(values, where)
        else:
            blocks.append(_block(letter, values, number, where))
    if size is None:
        raise InputError(f"{path}: there is no line n: give {_LETTERS['n'][1]}")
    _check_blocks(blocks, path)
    return DataSetIndex(path, release, *size, tuple(blocks))


def _unquoted(name: str) -> str:
    quoted_ = len(name) > 2 and name[0] == name[-1] and name[0] in "\"'"
    return name[1:-1].strip() if quoted_ else name


def _numbers(letter: str, rest: str, where: str) -> list[float]:
    count, meaning = _LETTERS[letter]
    try:
        values = [float(word) for word in rest.split()]
    except ValueError:
        values = []
    if len(values) != count or not all(map(isfinite, values)):
        raise InputError(f"{where}: {letter} is followed by {quoted(rest)}: give {meaning}")
    return values


def _size(values: list[float], where: str) -> tuple[int, int, int]:
    bits, width, height = values
    if bits != int(bits) or not 1 <= bits <= 16:
        raise InputError(f"{where}: the images have {bits:g} bits: give a whole number from 1 to 16")
    if width != int(width) or height != int(height) or min(width, height) < 2:
        raise InputError(f"{where}: the images have {width:g} x {height:g} pixels: give whole numbers of at least 2")
    return int(bits), int(width), int(height)


def _block(letter: str, values: list[float], number: int, where: str) -> IndexBlock:
    exposure_ns, photons = values[0], values[1] if letter == "b" else 0.0
    if not 0 <= exposure_ns <= _LONGEST_NS:
        raise InputError(f"{where}: the exposure is {exposure_ns:g} ns: give a time from 0 ns to a day")
    if photons < 0:
        raise InputError(f"{where}: there are {photons:g} photons: give a number of at least 0")
    return IndexBlock("bright" if letter == "b" else "dark", exposure_ns, photons, (), number, ())


def _check_blocks(blocks: list[IndexBlock], path: Path) -> None:
    seen: dict[tuple[object, ...], int] = {}
    for block in blocks:
        where = f"{path}, line {block.line}"
        if len(block.images) < 2:
            raise InputError(
                f"{where}: there are {len(block.images)} images: give at least 2, noise is measured from their "
                "difference"
            )
        key = (block.kind, block.exposure_ns, block.photons, len(block.images) > 2)
        if key in seen:
            raise InputError(f"{where}: the same exposure as in line {seen[key]}: keep one of the two")
        seen[key] = block.line
    for kind in ("bright", "dark"):
        if not any(block.kind == kind for block in blocks):
            raise InputError(f"{path}: there are no {kind} images, no line begins with {kind[0]}: record them")
    levels = {(block.exposure_ns, block.photons) for block in blocks if block.kind == "bright"}
    if len(levels) < 2:
        raise InputError(f"{path}: the bright images have one exposure only: record a series of at least 3, better 50")


def _require_images(index: DataSetIndex) -> None:
    images = [(image, block.line) for block in index.blocks for image in block.images]
    missing = [(image, line) for image, line in images if not is_file(image)]
    if missing:
        image, line = missing[0]
        file = _same_name(index.path.parent, image.name)
        advice = (
            "copy them there, or take them out of the index"
            if file is None
            else f"a file of that name is in {file}, correct the paths of the index, capital letters too"
        )
        raise InputError(
            f"{index.path}, block of line {line}: {len(missing)} of {len(images)} images are missing, the first is "
            f"{shortened(str(image), 300)}: {advice}"
        )


def _same_name(folder: Path, name: str) -> Path | None:
    """Folder that holds a file of this name, in letters of either case: this one, or one directly in it."""
    with suppress(OSError):
        folders = [folder, *sorted(child for child in folder.iterdir() if child.is_dir())]
        return next(
            (folder for folder in folders if any(c.name.lower() == name.lower() for c in folder.iterdir())), None
        )
    return None
