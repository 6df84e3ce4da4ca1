"""Files of a session: checked when read; frames are TIFF files that any image program opens."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import re
import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from ..core.companding import Companding
from ..core.disk import open_regular, parse_json, reason
from ..core.disk.files import shell_word
from ..core.disk.tiff import open_tiff, pixels_of
from ..core.errors import InputError, SessionError
from ..core.frame import Frame
from ..output.file import Buffer, StoredFile, is_temporary, write_several

#: Folder of the frames in a session.
FRAMES = "frames"


def read_checked(folder: Path, stored: StoredFile) -> bytes:
    """Read a recorded file and check it against its record.

    Raises
    ------
    SessionError
        If it is missing, shorter or longer than recorded, altered, or cannot be read.
    """
    path = folder / stored.name
    # Not Path.exists, which raises for a name that is too long.
    if not os.path.exists(path):
        raise SessionError(f"{path} is missing: {_again(folder, stored)}")
    with reported(path, "read"), open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size
        data = file.read() if size == stored.size else b""
    if size < stored.size:
        fault = f"is truncated: {size} of {stored.size} bytes are left"
    elif size > stored.size:
        fault = f"was altered: it has {size} bytes, {stored.size} were recorded"
    elif hashlib.sha256(data).hexdigest() != stored.sha256:
        fault = "was altered: its SHA-256 is not the recorded one"
    else:
        return data
    raise SessionError(f"{path} {fault}; {_again(folder, stored)}")


def require_sizes(folder: Path, files: Sequence[StoredFile]) -> None:
    """Raise SessionError unless all recorded files are there with the recorded sizes; their content is not read."""
    wrong = [stored for stored in files if not _has_its_size(folder, stored)]
    if wrong:
        several = f" (file 1 of {len(wrong)})" if len(wrong) > 1 else ""
        raise SessionError(
            f"{folder / wrong[0].name} is missing or was altered since it was recorded{several}: "
            + _again(folder, wrong[0])
        )


def _has_its_size(folder: Path, stored: StoredFile) -> bool:
    try:
        return os.stat(folder / stored.name).st_size == stored.size
    except OSError:
        return False


def _again(folder: Path, stored: StoredFile) -> str:
    remedy = "restore it from a copy of the session"
    if not stored.name.startswith(f"{FRAMES}/"):
        return remedy
    command = f"labcdp acquire {shell_word(folder / 'session.toml')} {shell_word(folder)} --replace-damaged"
    return f"{remedy}, or record it again, with the options of its devices: {command}"


@contextmanager
def reported(path: Path, done: str) -> Iterator[None]:
    """Turn an OSError into a SessionError that names the file and the remedy; `done` is "read" or "written"."""
    try:
        yield
    except FileNotFoundError as error:
        # A file to be written cannot be missing, but its folder can.
        what = path if done == "read" or path.parent.is_dir() else path.parent
        raise SessionError(f"{what} is missing: restore it from a copy of the session") from error
    except OSError as error:
        remedies = {
            errno.EACCES: f"give yourself the permission to have it {done}",
            errno.EPERM: f"give yourself the permission to have it {done}",
            errno.EROFS: "use a folder on a disk you may write to",
            errno.ENOSPC: "free some space on the disk and record it again",
            errno.EDQUOT: "free some of your disk quota and record it again",
            errno.EFBIG: "raise the limit of the file size and record it again",
        }
        remedy = remedies.get(error.errno or 0, "check the path and the disk")
        raise SessionError(f"{path} cannot be {done} ({reason(error)}): {remedy}") from error


#: What messages call the file, which the session names itself.
_IT = Path("it")
#: Types of a TIFF's values (TIFF 6.0, section 2), and the value that stands for where the pixels begin.
_ASCII, _SHORT, _LONG, _PIXELS = 2, 3, 4, -1


def frame_to_tiff(frame: Frame, compress: bool, features: Mapping[str, Any] | None = None) -> bytes:
    """Make the bytes of a one-page grey TIFF; as `tiff_parts`."""
    return b"".join(tiff_parts(frame, compress, features))


def tiff_parts(frame: Frame, compress: bool, features: Mapping[str, Any] | None = None) -> tuple[bytes, Buffer]:
    """Make a one-page grey TIFF with the frame's own depth, 8, 16 or 32 bit: its head, and its pixels without a copy.

    Parameters
    ----------
    frame : Frame
        The frame; its ``metadata()`` goes into the tag ImageDescription as JSON.
    compress : bool
        Whether to compress without loss (zlib, TIFF compression 8), about half the size and 15 times the time.
    features : mapping or None
        The camera's GenICam features, written beside the metadata under the key ``features``; readers leave them out.

    Raises
    ------
    InputError
        If the metadata has a value JSON does not have.
    """
    try:
        beside = {} if features is None else {"features": dict(features)}
        description = json.dumps(frame.metadata() | beside, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"the metadata of frame {frame.frame_id} cannot be written as JSON ({error}): give text and finite numbers"
        ) from error
    little_endian = frame.dn.dtype.newbyteorder("<")
    dn = np.ascontiguousarray(frame.dn, little_endian)
    pixels: Buffer = dn.data.cast("B")
    if compress:
        import imagecodecs

        pixels = bytes(imagecodecs.deflate_encode(dn.tobytes(), level=1))
    height, width = frame.shape
    tags = (
        (256, _LONG, width),
        (257, _LONG, height),
        (258, _SHORT, 8 * little_endian.itemsize),
        (259, _SHORT, 8 if compress else 1),
        (262, _SHORT, 1),  # 0 is black
        (270, _ASCII, description.encode("ascii") + b"\0"),
        (273, _LONG, _PIXELS),
        (277, _SHORT, 1),
        (278, _LONG, height),
        (279, _LONG, memoryview(pixels).nbytes),
        (305, _ASCII, b"labcdp\0"),
    )
    return _head(tags), pixels


def _head(tags: Sequence[tuple[int, int, int | bytes]]) -> bytes:
    """Return header and directory of a little-endian TIFF (TIFF 6.0, section 2); pixels follow at once."""
    texts_at = 8 + 2 + 12 * len(tags) + 4
    texts = b"".join(value + bytes(-len(value) % 4) for _, _, value in tags if isinstance(value, bytes))
    entries, text_at, pixels_at = b"", texts_at, texts_at + len(texts)
    for tag, kind, value in tags:
        if isinstance(value, bytes):
            entries += struct.pack("<HHII", tag, kind, len(value), text_at)
            text_at += len(value) + -len(value) % 4
        else:
            entries += struct.pack("<HHII", tag, kind, 1, pixels_at if value == _PIXELS else value)
    return struct.pack("<2sHIH", b"II", 42, 8, len(tags)) + entries + bytes(4) + texts


def frame_from_tiff(data: bytes, source: str, curve: Companding | None = None) -> Frame:
    """Make the frame of what `frame_to_tiff` made, bit for bit; messages call it `source`.

    Parameters
    ----------
    data : bytes
        The file.
    source : str
        What messages call it.
    curve : Companding or None
        The curve that its session states, None for none.

    Raises
    ------
    SessionError
        If it is a TIFF, but not one of labcdp's frames.
    """
    try:
        with open_tiff(data, _IT) as tiff:
            page = tiff.pages.first
            dn = pixels_of(page, _IT)
            metadata = parse_json(page.description)
        return Frame.from_metadata(dn.astype(dn.dtype.newbyteorder("="), copy=False), metadata, curve)
    except InputError as error:
        raise SessionError(f"{source} is not a frame recorded by labcdp ({reason(error)})") from error


class FrameFolder:
    """Writes the frames of a session: numbered files, written together or not at all.

    Parameters
    ----------
    session : Path
        The session's folder.
    compress : bool
        Whether frames are compressed.
    """

    def __init__(self, session: Path, compress: bool) -> None:
        self._session = session
        self._compress = compress
        self.next_number = 1

    def recover(self, recorded: Iterable[str]) -> None:
        """Remove what a killed writer left half done, and find the number after those of recorded and other files."""
        frames = self._session / FRAMES
        with reported(frames, "written"):
            # Programs that copy or pack folders may leave out an empty one.
            frames.mkdir(exist_ok=True)
            for path in (*self._session.iterdir(), *frames.iterdir()):
                if is_temporary(path) and path.is_file():
                    path.unlink()
        names = [*(path.name for path in frames.iterdir()), *recorded]
        numbers = [int(match[1]) for name in names if (match := re.match(rf"(?:{FRAMES}/)?(\d+)_", name))]
        self.next_number = max(numbers, default=0) + 1

    def write(self, frames: Sequence[tuple[Frame, str]]) -> list[StoredFile]:
        """Write frames of a role with the next numbers; raises SessionError, and then none is there."""
        if not frames:
            return []
        first = self.next_number
        names = [
            f"{FRAMES}/{_file_name(number, role, frame.exposure_s)}"
            for number, (frame, role) in enumerate(frames, start=first)
        ]
        parts = (tiff_parts(frame, self._compress) for frame, _ in frames)
        # Counted first: a number is used again only if its file is surely gone.
        self.next_number += len(frames)
        try:
            with reported(self._session / names[0], "written"):
                return write_several(self._session, zip(names, parts, strict=True))
        except BaseException:
            self.take_back(first, names)
            raise

    def take_back(self, first: int, names: Sequence[str]) -> None:
        """Remove files that the journal does not know; their numbers are free again if all are surely gone."""
        with suppress(OSError):
            for name in names:
                (self._session / name).unlink(missing_ok=True)
            self.next_number = first


def _file_name(number: int, role: str, exposure_s: float) -> str:
    """Name of a frame's file, for example ``0001_light_5ms.tif``."""
    unit, scale = next(
        (unit, scale)
        for unit, scale in (("s", 1.0), ("ms", 1e3), ("us", 1e6))
        if exposure_s * scale >= 1 or unit == "us"
    )
    return f"{number:04d}_{role}_{exposure_s * scale:.6g}{unit}.tif"
