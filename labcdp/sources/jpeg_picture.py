"""JPEG files: values as decoded, with what their EXIF says."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import InputError
from .exif import ExifFacts, read_exif
from .png_picture import decoded
from .stored_image import StoredImage, require_size

SIGNATURE = b"\xff\xd8\xff"
#: Markers that start a frame (ITU-T T.81, table B.1): all of C0 to CF but tables and the reserved one.
_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
#: Of these libjpeg decodes baseline, extended and progressive ones with Huffman or arithmetic coding.
_DECODED_FRAMES = frozenset((0xC0, 0xC1, 0xC2, 0xC9, 0xCA))
_SCAN, _END, _APP1 = 0xDA, 0xD9, 0xE1
_EXIF = b"Exif\0\0"
#: A marker within coded data: not a stuffed byte, not one that restarts the decoder, not a fill byte.
_NEXT_MARKER = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")


@dataclass(frozen=True)
class _Header:
    width: int
    height: int
    components: int
    exif: bytes


def read_jpeg(data: bytes, path: Path, max_pixels: int) -> StoredImage:
    """Read a JPEG of 8 bits, grey or coloured, as its pixels are stored: not turned.

    Raises
    ------
    InputError
        If it is truncated, damaged, larger than `max_pixels`, or of a kind with more than 8 bits or four colours.
    """
    header = _header(data, path)
    require_size(path, header.width, header.height, max_pixels)
    if header.components not in (1, 3):
        raise InputError(f"{path} has {header.components} colours, as for print: save it as grey or RGB")
    try:
        values, messages = decoded(data)
    except ValueError as error:
        raise InputError(f"{path} cannot be read as JPEG ({error}): copy it again from the camera") from error
    if values.shape[:2] != (header.height, header.width) or values.dtype != np.uint8:
        raise InputError(f"{path} cannot be read as JPEG (its data do not fit its header): copy it again")
    facts = read_exif(header.exif, path) if header.exif else ExifFacts()
    values = values if values.ndim == 2 else np.ascontiguousarray(values[..., ::-1])
    return StoredImage(values, 8, "srgb", facts, ("JPEG: compression has changed the pixels",), tuple(messages))


def _header(data: bytes, path: Path) -> _Header:
    """Walk all segments to the end mark; libjpeg itself fills what is missing with grey."""
    at, frame, exif = 2, None, b""
    while True:
        if at + 2 > len(data):
            raise InputError(f"{path} is truncated: it has no end mark in {len(data)} bytes: copy it again")
        if data[at] != 0xFF:
            raise InputError(f"{path} is damaged: byte {at} is no JPEG marker: copy it again from the camera")
        marker = data[at + 1]
        if marker == 0xFF:
            at += 1
            continue
        if marker == _END:
            break
        (length,) = struct.unpack_from(">H", data, at + 2) if at + 4 <= len(data) else (0,)
        body = data[at + 4 : at + 2 + length]
        if len(body) != max(length - 2, 0) or length < 2:
            raise InputError(f"{path} is truncated: the part at byte {at} is not whole: copy it again")
        if marker in _FRAMES:
            frame = _frame(marker, body, path)
        elif marker == _APP1 and body.startswith(_EXIF):
            exif = exif or body[len(_EXIF) :]
        at += 2 + length
        if marker == _SCAN:
            found = _NEXT_MARKER.search(data, at)
            at = found.start() if found else len(data)
    if frame is None:
        raise InputError(f"{path} is damaged: it ends without a picture: copy it again from the camera")
    height, width, components = frame
    return _Header(width, height, components, exif)


def _frame(marker: int, body: bytes, path: Path) -> tuple[int, int, int]:
    """Height, width and number of components (ITU-T T.81, B.2.2)."""
    if len(body) < 6:
        raise InputError(f"{path} is damaged: its header has {len(body)} bytes: copy it again from the camera")
    precision, height, width, components = struct.unpack_from(">BHHB", body)
    if marker not in _DECODED_FRAMES or precision != 8:
        raise InputError(
            f"{path} is a JPEG of {precision} bits coded as SOF{marker - 0xC0}, which is not read: save it as TIFF or "
            "PNG"
        )
    return height, width, components
