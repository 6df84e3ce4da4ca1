"""Grey TIFF and PNG files as frames."""

from __future__ import annotations

import struct
import zlib
from datetime import UTC, datetime
from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..frame import Frame
from .exif import ExifFacts, read_exif
from .file_frame import FileDefaults, FileFrame, camera_of, exposure_of, read_bytes

_PNG = b"\x89PNG\r\n\x1a\n"
_TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
#: TIFF compressions that tifffile undoes without a package of codecs: none, and the two codes of Deflate.
_OWN_CODECS = (1, 8, 32946)
_MIN_IS_BLACK = 1
#: Endings of the names of the files this module reads.
IMAGE_SUFFIXES = (".tif", ".tiff", ".png")


class Layout(Protocol):
    """What an image file's numbers are; a GenICam pixel format says it."""

    @property
    def name(self) -> str:
        """PFNC name."""

    @property
    def bit_depth(self) -> int:
        """Bits of the DN scale."""

    @property
    def colour_filter(self) -> str | None:
        """Bayer pattern, or None."""


def read_image(path: str | PathLike[str], layout: Layout, defaults: FileDefaults) -> FileFrame:
    """Read a grey TIFF or PNG of 8 or 16 bits whose values are the DN of a sensor.

    Parameters
    ----------
    path : path
        The file.
    layout : Layout
        Bit depth, which a file of 16 bits does not tell, and colour filter. A pixel is saturated at the highest DN.
    defaults : FileDefaults
        What counts where the file does not say.

    Raises
    ------
    InputError
        If the file cannot be read, is damaged, coloured or of another depth, has DN beyond `layout`, or does not say
        its exposure.
    """
    path = Path(path)
    data, sha256 = read_bytes(path)
    if data.startswith(_PNG):
        dn, facts = _read_png(data, path)
    elif data.startswith(_TIFF):
        dn, facts = _read_tiff(data, path)
    else:
        raise InputError(f"{path} is neither a TIFF nor a PNG file: give one of these, or a camera RAW file")
    if dn.ndim != 2 or dn.dtype not in (np.uint8, np.uint16):
        raise InputError(
            f"{path} is of {dn.dtype} and shape {dn.shape}: give a grey image of 8 or 16 bits, one number a pixel"
        )
    largest = 2**layout.bit_depth - 1
    if dn.max() > largest:
        raise InputError(
            f"{path} has values up to {dn.max()}, the pixel format {layout.name} ends at {largest}: correct "
            "plan.pixel_format, which says how many bits the values have"
        )
    dn.flags.writeable = False
    gain_db = facts.gain_db
    frame = Frame(
        dn=dn,
        exposure_s=exposure_of(path, facts.exposure_s, defaults),
        gain_db=defaults.gain_db if gain_db is None else gain_db,
        bit_depth=layout.bit_depth,
        saturation_dn=float(largest),
        black_level_dn=0.0,
        pixel_format=layout.name,
        colour_filter=layout.colour_filter,
        temperature_c=None,
        timestamp=facts.taken or datetime.fromtimestamp(path.stat().st_mtime, UTC),
        camera_timestamp_ns=0,
        frame_id=0,
        camera=camera_of(facts.vendor, facts.model, facts.serial, defaults),
    )
    return FileFrame(path, frame, facts.f_number, facts.focal_length_m, sha256)


def _read_tiff(data: bytes, path: Path) -> tuple[NDArray[Any], ExifFacts]:
    import tifffile

    facts = read_exif(data, path)
    try:
        with tifffile.TiffFile(BytesIO(data)) as tiff:
            pages = len(tiff.pages)
            if pages != 1:
                raise InputError(f"{path} holds {pages} pictures: give files of one picture each")
            page = tiff.pages.first.aspage()
            known = page.compression in _OWN_CODECS or page.photometric != _MIN_IS_BLACK
            dn = page.asarray() if known else _decoded(data)
    except InputError:
        raise
    # Codecs and damaged directories raise what their libraries do.
    except Exception as error:
        raise InputError(f"{path} cannot be read as TIFF ({error}): save it again, without compression") from error
    return np.array(dn, dtype=dn.dtype.newbyteorder("=")), facts


def _decoded(data: bytes) -> NDArray[Any]:
    import cv2

    dn = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    if dn is None:
        raise ValueError("its compression is not known, or its data are damaged")
    return np.array(dn)


def _read_png(data: bytes, path: Path) -> tuple[NDArray[Any], ExifFacts]:
    chunks = _png_chunks(data, path)
    depth, colour = chunks[b"IHDR"][8], chunks[b"IHDR"][9]
    if colour != 0 or depth not in (8, 16):
        kind = {0: "grey", 2: "coloured", 3: "with a palette", 4: "grey with transparency", 6: "coloured"}.get(colour)
        raise InputError(f"{path} is {kind or 'unknown'}, {depth} bits: give a grey image of 8 or 16 bits")
    try:
        dn = _decoded(data)
    except ValueError as error:
        raise InputError(f"{path} cannot be read as PNG ({error}): save it again") from error
    return dn, read_exif(chunks[b"eXIf"], path) if b"eXIf" in chunks else ExifFacts()


def _png_chunks(data: bytes, path: Path) -> dict[bytes, bytes]:
    """First chunk of each kind; a PNG says with a check whether each is whole (ISO/IEC 15948, 5.3)."""
    chunks: dict[bytes, bytes] = {}
    at = len(_PNG)
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
