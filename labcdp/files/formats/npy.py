"""NumPy arrays as images, without unpickling anything."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...core.disk import quoted
from ...core.disk.arrays import npy_header, parse_npy
from ...core.errors import InputError
from .stored_image import StoredImage, real_numbers, require_size, whole_numbers

SIGNATURE = b"\x93NUMPY"


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
