"""NumPy arrays as images, without unpickling anything."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...core.disk import quoted
from ...core.disk.arrays import npy_header, parse_npy
from ...core.errors import InputError
from ...core.pixel_format import pixel_format
from .stored_image import StoredImage, real_numbers, require_size, whole_numbers

NPY = b"\x93NUMPY"


def read_npy(data: bytes, path: Path, max_pixels: int) -> StoredImage:
    """Read a 2-D array of whole or real numbers.

    Raises
    ------
    InputError
        If it is truncated or damaged, has another number of dimensions, holds something else than real numbers, or is
        larger than `max_pixels`.
    """
    try:
        header = npy_header(data)
        shape, dtype = header.shape, header.dtype
        if len(shape) != 2:
            raise InputError(
                f"it is an array of shape {quoted(shape)}: give a 2-D array, one value a pixel; of colours, or of "
                "several pictures, save one"
            )
        if dtype.kind not in "buif" or dtype.itemsize > 8:
            raise InputError(f"it holds {dtype}: give an array of whole numbers (DN) or floats")
        require_size(path, shape[1], shape[0], max_pixels)
        values = parse_npy(data)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    if dtype.kind == "f":
        return StoredImage(real_numbers(values, path), None)
    dn, bits, changes = whole_numbers(values, path)
    return StoredImage(np.ascontiguousarray(dn), bits, changes=changes)


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
