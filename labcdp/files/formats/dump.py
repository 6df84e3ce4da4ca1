"""Raw dumps: the bytes of a camera's payload, whose size and pixel format only the user knows."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...core.errors import InputError
from ...core.pixel_format import pixel_format
from .stored_image import StoredImage, require_size


def read_dump(data: bytes, path: Path, size: tuple[int, int], format_name: str, max_pixels: int) -> StoredImage:
    """Read pixels that fill a file from its first byte to its last.

    Parameters
    ----------
    data : bytes
        The file.
    path : Path
        For messages.
    size : (int, int)
        Width and height in pixels.
    format_name : str
        GenICam pixel format, for example ``Mono12Packed``.
    max_pixels : int
        Limit.

    Raises
    ------
    InputError
        If the pixel format is not known, or the file has another length than such an image.
    """
    width, height = size
    require_size(path, width, height, max_pixels)
    layout = pixel_format(format_name)
    needed = layout.payload_bytes(width * height)
    if len(data) != needed:
        raise InputError(
            f"{path} has {len(data)} bytes, {width} x {height} pixels of {layout.name} take {needed}: give the size "
            "and the pixel format it was written with"
        )
    dn = layout.unpack(np.frombuffer(data, np.uint8), (height, width))
    dn = dn.astype(dn.dtype.newbyteorder("="), copy=False)
    if int(dn.max()) >= 2**layout.bit_depth:
        raise InputError(
            f"{path} has values up to {dn.max()}, {layout.name} ends at {2**layout.bit_depth - 1}: give the pixel "
            "format it was written with"
        )
    return StoredImage(dn, layout.bit_depth)
