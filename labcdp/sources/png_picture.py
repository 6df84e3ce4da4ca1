"""PNG files: values as stored, whatever their depth."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .decoder_messages import decoder_messages
from .exif import ExifFacts, read_exif
from .stored_image import Encoding, StoredImage, grey_if_colourless, require_size, without_alpha

SIGNATURE = b"\x89PNG\r\n\x1a\n"
#: Colour types and the depths each may have (ISO/IEC 15948:2004, table 11.1).
_GREY, _RGB, _PALETTE, _GREY_ALPHA, _RGB_ALPHA = 0, 2, 3, 4, 6
_DEPTHS = {
    _GREY: (1, 2, 4, 8, 16),
    _RGB: (8, 16),
    _PALETTE: (1, 2, 4, 8),
    _GREY_ALPHA: (8, 16),
    _RGB_ALPHA: (8, 16),
}
#: gAMA of values in proportion to light, and of sRGB ones (ISO/IEC 15948:2004, 11.3.3.5), which some write as 45454.
_GAMMA_LINEAR, _GAMMA_SRGB = 100_000, range(45_000, 46_001)


def read_png(data: bytes, path: Path, max_pixels: int) -> StoredImage:
    """Read a PNG of any kind, without its transparency.

    Raises
    ------
    InputError
        If it is truncated, damaged, larger than `max_pixels`, or holds several pictures.
    """
    chunks = png_chunks(data, path)
    width, height, depth, colour_type = struct.unpack_from(">IIBB", chunks[b"IHDR"])
    if depth not in _DEPTHS.get(colour_type, ()):
        raise InputError(f"{path} has a depth of {depth} bits and colour type {colour_type}, which PNG does not know")
    require_size(path, width, height, max_pixels)
    if len(chunks.get(b"acTL", b"")) == 8 and struct.unpack_from(">I", chunks[b"acTL"])[0] > 1:
        raise InputError(f"{path} holds several pictures: give files of one picture each")
    try:
        values, messages = decoded(data)
    except ValueError as error:
        raise InputError(f"{path} cannot be read as PNG ({error}): save it again") from error
    bits = 8 if colour_type == _PALETTE else depth
    if values.shape[:2] != (height, width) or values.dtype != (np.uint16 if bits == 16 else np.uint8):
        raise InputError(f"{path} cannot be read as PNG (its data do not fit its header): save it again")
    values, notes = _resolved(values, bits, colour_type)
    facts = read_exif(chunks[b"eXIf"], path) if b"eXIf" in chunks else ExifFacts()
    return StoredImage(
        values, bits, _encoding(chunks, values.ndim == 3), facts, notes, (*messages, *_doubts(chunks, values))
    )


def _resolved(values: NDArray[Any], bits: int, colour_type: int) -> tuple[NDArray[Any], tuple[str, ...]]:
    """Values as the file means them, of what OpenCV returns: fewer than 8 bits spread over 8, colours blue first."""
    notes: list[str] = []
    if values.ndim == 3 and values.shape[2] == 4:
        values, note = without_alpha(values, 2**bits - 1)
        notes.append(note)
    if values.ndim == 3:
        values = values[..., 0] if colour_type == _GREY_ALPHA else values[..., ::-1]
    if colour_type == _PALETTE:
        notes.append("palette resolved")
        values = grey_if_colourless(values) if values.ndim == 3 else values
    if bits < 8:
        values = values // (255 // (2**bits - 1))
    return np.ascontiguousarray(values), tuple(notes)


def _encoding(chunks: dict[bytes, bytes], coloured: bool) -> Encoding:
    """Tell it by what the file says (sRGB, gAMA), else sRGB for colours and DN of a sensor for grey."""
    if b"sRGB" in chunks:
        return "srgb"
    gamma = _gamma(chunks)
    if gamma is not None:
        return "linear" if gamma == _GAMMA_LINEAR else "srgb"
    return "srgb" if coloured else "linear"


def _gamma(chunks: dict[bytes, bytes]) -> int | None:
    """Exponent of the values, in 100000ths, as the file states it."""
    return struct.unpack(">I", chunks[b"gAMA"])[0] if len(chunks.get(b"gAMA", b"")) == 4 else None


def _doubts(chunks: dict[bytes, bytes], values: NDArray[Any]) -> list[str]:
    """Tell what the file says about its values that is not used."""
    if b"sRGB" in chunks:
        return []
    taken = "sRGB" if _encoding(chunks, values.ndim == 3) == "srgb" else "linear"
    unless = f"the values are taken as {taken} unless an encoding is given"
    doubts = []
    gamma = _gamma(chunks)
    if gamma is not None and gamma != _GAMMA_LINEAR and gamma not in _GAMMA_SRGB:
        doubts.append(f"the file states a gamma of {gamma / 1e5:g}, neither linear (1) nor sRGB (0.45455): {unless}")
    if b"iCCP" in chunks and (gamma is None or values.ndim == 3):
        doubts.append(f"the file's ICC profile is not read: {unless}")
    return doubts


def decoded(data: bytes) -> tuple[NDArray[Any], list[str]]:
    """Decode an image with OpenCV, neither turned nor changed in depth; also what the decoder had to say.

    Raises
    ------
    ValueError
        If it cannot.
    """
    import cv2

    # What it has to say of damage goes into the error and not to the terminal.
    log_level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        with decoder_messages() as messages:
            values = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise ValueError("its data are damaged") from error
    finally:
        cv2.utils.logging.setLogLevel(log_level)
    if values is None:
        raise ValueError("its compression is not known, or its data are damaged")
    return np.array(values), [f"the decoder says: {message}" for message in messages]


def png_chunks(data: bytes, path: Path) -> dict[bytes, bytes]:
    """First chunk of each kind; a PNG says with a check whether each is whole (ISO/IEC 15948:2004, 5.3).

    Raises
    ------
    InputError
        If one is not whole, or there is no header or no end.
    """
    chunks: dict[bytes, bytes] = {}
    at = len(SIGNATURE)
    while b"IEND" not in chunks:
        if at + 12 > len(data):
            raise InputError(f"{path} is truncated: it has no end mark in {len(data)} bytes: copy or save it again")
        (length,) = struct.unpack_from(">I", data, at)
        body = data[at + 4 : at + 8 + length]
        if at + 12 + length > len(data):
            raise InputError(f"{path} is truncated: {at + 12 + length} of its bytes are announced, it has {len(data)}")
        if zlib.crc32(body) != struct.unpack_from(">I", data, at + 8 + length)[0]:
            raise InputError(f"{path} is damaged: the check of its part at byte {at} is wrong: copy or save it again")
        chunks.setdefault(body[:4], body[4:])
        at += 12 + length
    if len(chunks.get(b"IHDR", b"")) != 13:
        raise InputError(f"{path} has no PNG header: save it again")
    return chunks
