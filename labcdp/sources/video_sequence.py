"""Numbered images of a folder as a video."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from ..errors import InputError
from ..frame import Frame
from .picture import PictureOptions, picture_paths, read_picture
from .video import Entry, require_frames


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
        The images; frame n is the n-th.
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
    shape: tuple[int, int]
    options: PictureOptions
    exposure_stated: bool
    notes: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def frame_count(self) -> int:
        """Number of images."""
        return len(self.images)

    @property
    def frame_rate(self) -> float:
        """One a second: the images do not say it, so that time is their number."""
        return 1.0

    def entries(self) -> Iterator[Entry]:
        """Go through all images."""
        for number, image in enumerate(self.images):
            yield Entry(number, float(number), "", partial(_load, image, number, self.options))


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
        notes = [f"{len(images)} images, one a frame and, as they do not say it, one a second", *picture.notes]
        return ImageSequence(
            folder, digest.hexdigest(), images, shape, options, picture.exposure_stated, tuple(notes), ()
        )
    require_frames(False, folder)
    raise AssertionError


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
