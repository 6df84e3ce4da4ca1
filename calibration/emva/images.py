"""Images of a data set, read bit for bit."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from ...core.disk import read_bytes
from ...core.disk.quoting import shown
from ...core.disk.tiff import open_tiff, pixels_of
from ...core.errors import InputError

#: File signatures: PNG (ISO/IEC 15948), and JPEG, whose compression loses values.
_PNG, _LOSSY = b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff"
#: Bytes up to the end of a PNG's header chunk.
_PNG_HEADER = 33
#: Largest size of an image file.
_MOST_BYTES = 2**30
#: JPEG in TIFF, old and new (TIFF 6.0, section 22, and Technical Note 2).
_LOSSY_TIFF = (6, 7)


def read_image(path: Path, shape: tuple[int, int], bits: int) -> NDArray[np.unsignedinteger[Any]]:
    """Read a grey PNG or TIFF image of 8 or 16 bits.

    Parameters
    ----------
    path : Path
        The image.
    shape : (int, int)
        Height and width it must have.
    bits : int
        Bits of its DN scale, 1 to 16.

    Returns
    -------
    ndarray of uint8 or uint16, shape (height, width)

    Raises
    ------
    InputError
        If it cannot be read, is damaged or compressed with loss, has colours or another size, or holds values beyond
        its DN scale.
    """
    data = read_bytes(path, "the images of the index", _MOST_BYTES)
    if not data:
        raise _damaged(path)
    dn = _tiff(data, path, shape) if path.suffix.lower() in (".tif", ".tiff") else _png(data, path, shape)
    if dn is None or dn.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path} is no grey image of 8 or 16 bits: give PNG or TIFF files as the camera sent them")
    if dn.ndim != 2:
        raise InputError(f"{path} is a coloured image: give grey ones, as the camera sent them")
    _require_shape(path, dn.shape[0], dn.shape[1], shape)
    largest = int(dn.max())
    if largest >= 2**bits:
        raise InputError(
            f"{path} holds {largest} DN, more than the {bits} bits of the index can: give images of one depth, or "
            "correct the line n"
        )
    return dn


def _png(data: bytes, path: Path, shape: tuple[int, int]) -> NDArray[Any] | None:
    import cv2

    if data.startswith(_LOSSY) or data[8:12] == b"WEBP":
        raise InputError(f"{path} is compressed with loss, which alters the noise: give PNG or TIFF files")
    if not data.startswith(_PNG[:4]):
        return None
    if len(data) < _PNG_HEADER or not _whole_png(data):
        raise _damaged(path)
    width, height = struct.unpack_from(">II", data, 16)
    _require_shape(path, height, width, shape)
    image: NDArray[Any] | None = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    return image


def _require_shape(path: Path, height: int, width: int, shape: tuple[int, int]) -> None:
    if (height, width) != shape:
        raise InputError(
            f"{path} has {shown(width)} x {shown(height)} pixels, the index says {shape[1]} x {shape[0]}: give images "
            "of one size, or correct the line n"
        )


def _whole_png(data: bytes) -> bool:
    """Whether all chunks are present with valid checksums (ISO/IEC 15948, section 5.3).

    The library that decodes them would write to the terminal.
    """
    place = len(_PNG)
    while data.startswith(_PNG) and place + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, place)
        end = place + 8 + length
        if end + 4 > len(data) or struct.unpack_from(">I", data, end)[0] != crc32(data[place + 4 : end]):
            return False
        if kind == b"IEND":
            return True
        place = end + 4
    return False


def _tiff(data: bytes, path: Path, shape: tuple[int, int]) -> NDArray[Any]:
    with open_tiff(data, path) as file:
        if not file.pages:
            raise _damaged(path)
        page = file.pages.first.aspage()
        if int(page.compression) in _LOSSY_TIFF:
            raise InputError(f"{path} is compressed with loss, which alters the noise: give PNG or TIFF files")
        _require_shape(path, page.imagelength, page.imagewidth, shape)
        if any(a + n > len(data) for a, n in zip(page.dataoffsets, page.databytecounts, strict=False)):
            raise _damaged(path)
        image = pixels_of(page, path)
    return image.astype(image.dtype.newbyteorder("="), copy=False)


def _damaged(path: Path) -> InputError:
    return InputError(f"{path} is truncated or damaged: copy it again")
