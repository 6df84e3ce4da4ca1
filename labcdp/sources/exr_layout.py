"""Whether an OpenEXR file is whole and not too large, told from its header and table of chunks; nothing is decoded."""

from __future__ import annotations

import struct
from pathlib import Path

from ..errors import InputError
from .stored_image import require_size

#: Bits of the version field: tiles, deep data, several parts (OpenEXR file layout, version field).
_TILED, _DEEP, _MULTI_PART = 0x200, 0x800, 0x1000
#: Rows in a chunk by the number of the compression: none, RLE, ZIPS, ZIP, PIZ, PXR24, B44, B44A, DWAA, DWAB.
_ROWS = (1, 1, 1, 16, 32, 16, 32, 32, 32, 256)


def require_whole(data: bytes, path: Path, max_pixels: int) -> None:
    """Refuse a file of one picture in rows that ends before its pixels do; the library would say so less clearly.

    Parameters
    ----------
    data : bytes
        The file.
    path : Path
        For messages.
    max_pixels : int
        Limit.

    Raises
    ------
    InputError
        If it is truncated, was never finished, or is larger than `max_pixels`.
    """
    try:
        attributes, at = _attributes(data)
    except (struct.error, ValueError):
        raise InputError(
            f"{path} is truncated or damaged: its header has no end in {len(data)} bytes: copy it again"
        ) from None
    (version,) = struct.unpack_from("<I", data, 4)
    compression, window = attributes.get("compression", b""), attributes.get("dataWindow", b"")
    if version & (_TILED | _DEEP | _MULTI_PART) or len(compression) != 1 or len(window) != 16:
        return
    if compression[0] >= len(_ROWS):
        return
    left, top, right, bottom = struct.unpack("<4i", window)
    require_size(path, right - left + 1, bottom - top + 1, max_pixels)
    n_chunks = (bottom - top) // _ROWS[compression[0]] + 1
    end = at + 8 * n_chunks
    # Before the table is read: a damaged header may announce any number of chunks.
    if end <= len(data):
        for start in struct.unpack_from(f"<{n_chunks}Q", data, at):
            if start == 0:
                raise InputError(f"{path} was never finished: some of its rows are missing: save it again")
            (size,) = struct.unpack_from("<I", data, start + 4) if start + 8 <= len(data) else (0,)
            end = max(end, start + 8 + size)
    if end > len(data):
        raise InputError(
            f"{path} is truncated or damaged: its pixels reach to byte {end}, it has {len(data)}: copy it again"
        )


def _attributes(data: bytes) -> tuple[dict[str, bytes], int]:
    """Attributes of the first header by name, and where it ends; raises ValueError or struct.error without an end."""
    found: dict[str, bytes] = {}
    at = 8
    while data[at : at + 1] != b"\0":
        name_end = data.index(b"\0", at)
        type_end = data.index(b"\0", name_end + 1)
        (size,) = struct.unpack_from("<i", data, type_end + 1)
        start = type_end + 5
        if size < 0 or start + size >= len(data):
            raise ValueError("an attribute reaches beyond the end")
        found[data[at:name_end].decode("latin-1")] = data[start : start + size]
        at = start + size
    return found, at + 1
