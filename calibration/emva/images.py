"""Images of a data set, read bit for bit."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError

#: How files begin: PNG (ISO/IEC 15948), and JPEG, whose compression loses values.
_PNG, _LOSSY = b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff"
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
    try:
        dn = _tiff(path) if path.suffix.lower() in (".tif", ".tiff") else _png(path)
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror or error}): copy it again") from error
    if dn is None or dn.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path} is no grey image of 8 or 16 bits: give PNG or TIFF files as the camera sent them")
    if dn.ndim != 2:
        raise InputError(f"{path} is a coloured image: give grey ones, as the camera sent them")
    if dn.shape != shape:
        raise InputError(
            f"{path} has {dn.shape[1]} x {dn.shape[0]} pixels, the index says {shape[1]} x {shape[0]}: give images of "
            "one size, or correct the line n"
        )
    largest = int(dn.max())
    if largest >= 2**bits:
        raise InputError(
            f"{path} holds {largest} DN, more than the {bits} bits of the index can: give images of one depth, or "
            "correct the line n"
        )
    return dn


def _png(path: Path) -> NDArray[Any] | None:
    import cv2

    data = path.read_bytes()
    if data.startswith(_LOSSY) or data[8:12] == b"WEBP":
        raise InputError(f"{path} is compressed with loss, which alters the noise: give PNG or TIFF files")
    if not data or (data.startswith(_PNG[:4]) and not _whole_png(data)):
        raise _damaged(path)
    image: NDArray[Any] | None = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    return image


def _whole_png(data: bytes) -> bool:
    """Whether all chunks up to the last are there with their checksums (ISO/IEC 15948, section 5.3).

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


def _tiff(path: Path) -> NDArray[Any] | None:
    import tifffile

    if path.stat().st_size == 0:
        raise _damaged(path)
    try:
        with tifffile.TiffFile(path) as file:
            if not file.pages:
                raise _damaged(path)
            page = file.pages.first
            if int(page.compression) in _LOSSY_TIFF:
                raise InputError(f"{path} is compressed with loss, which alters the noise: give PNG or TIFF files")
            ends = [a + n for a, n in zip(page.dataoffsets, page.databytecounts, strict=True)]
            if max(ends, default=0) > path.stat().st_size:
                raise _damaged(path)
            image: NDArray[Any] = file.asarray()
    except (tifffile.TiffFileError, ValueError, IndexError, KeyError, RuntimeError, struct.error) as error:
        if "imagecodecs" in str(error):
            raise InputError(f"{path} has a compression that cannot be read ({error}): write it without one") from error
        raise _damaged(path) from error
    return image.astype(image.dtype.newbyteorder("="), copy=False)


def _damaged(path: Path) -> InputError:
    return InputError(f"{path} is truncated or damaged: copy it again")
