"""Numbered images of a folder as a video."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path

from ..errors import InputError
from ..frame import Frame
from .picture import PictureOptions, picture_paths, read_picture
from .video import Entry, require_frames

#: Larger numbers are times or serial numbers, and none of frames.
_MOST_NUMBER = 2**31


@dataclass(frozen=True, eq=False)
class ImageSequence:
    """Images of a folder, one a frame, in natural order; made by `open_sequence`.

    Parameters
    ----------
    path : Path
        The folder.
    sha256 : str
        Hash of the names and the contents of the images.
    images : tuple of Path
        The images.
    numbers : tuple of int
        Number of the frame of each: that in its name, so that what is missing in between is a gap.
    shape : (int, int)
        Height and width of the first one that can be read.
    options : PictureOptions
        What the images do not say.
    exposure_stated : bool
        Whether that one says its exposure.
    notes, warnings : tuple of str
        What was done to the pixels, and what to mind.
    """

    path: Path
    sha256: str
    images: tuple[Path, ...]
    numbers: tuple[int, ...]
    shape: tuple[int, int]
    options: PictureOptions
    exposure_stated: bool
    notes: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def frame_count(self) -> int:
        """Number of frames up to the last image, gaps included."""
        return self.numbers[-1] + 1

    @property
    def frame_rate(self) -> float:
        """One a second: the images do not say it, so that time is their number."""
        return 1.0

    def entries(self) -> Iterator[Entry]:
        """Go through all images."""
        for number, image in zip(self.numbers, self.images, strict=True):
            yield Entry(number, float(number - self.numbers[0]), "", partial(_load, image, number, self.options))


def open_sequence(folder: Path, options: PictureOptions) -> ImageSequence:
    """Open a folder of images as a video.

    Parameters
    ----------
    folder : Path
        With images that `read_picture` reads; other files are left out. They follow each other by the numbers in their
        names.
    options : PictureOptions
        What they do not say.

    Raises
    ------
    InputError
        If it holds no image, or none that can be read.
    """
    images = tuple(picture_paths([folder]))
    digest = hashlib.sha256()
    for image in images:
        digest.update(image.name.encode() + b"\0" + _digest(image))
    for image in images:
        try:
            picture = read_picture(image, options)
            shape = _load(image, 0, options).shape
        except InputError:
            continue
        numbers = _numbers(images)
        notes = [
            f"{len(images)} images, one a frame and, as they do not say it, one a second",
            "frames are numbered as in the names of the images"
            if numbers
            else "frames are numbered from 0 in the order of the images, as their names hold no number that counts up",
            *picture.notes,
        ]
        return ImageSequence(
            path=folder,
            sha256=digest.hexdigest(),
            images=images,
            numbers=numbers or tuple(range(len(images))),
            shape=shape,
            options=options,
            exposure_stated=picture.exposure_stated,
            notes=tuple(notes),
            warnings=picture.warnings,
        )
    require_frames(False, folder)
    raise AssertionError


def _numbers(images: Sequence[Path]) -> tuple[int, ...]:
    """Numbers in the names that count up from image to image, the last such ones; nothing if there are none."""
    found = [[int(digits) for digits in reversed(re.findall("[0-9]+", image.stem))] for image in images]
    for numbers in zip(*found, strict=False):
        if all(a < b for a, b in pairwise(numbers)) and numbers[-1] < _MOST_NUMBER:
            return numbers
    return ()


def _load(path: Path, number: int, options: PictureOptions) -> Frame:
    picture = read_picture(path, options)
    if picture.frame is None:
        raise InputError(f"{path.name} holds floats: a video is evaluated from the values of a camera")
    return replace(picture.frame, frame_id=number)


def _digest(path: Path) -> bytes:
    """Hash of a file; of one that cannot be read nothing, as it is a broken frame."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").digest()
    except OSError:
        return b""
