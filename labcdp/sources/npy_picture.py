"""NumPy arrays as images, without unpickling anything."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
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
    shape, dtype, offset = _header(data, path)
    if len(shape) != 2:
        raise InputError(
            f"{path} is an array of shape {shape}: give a 2-D array, one value a pixel; of colours, or of several "
            "pictures, save one"
        )
    if dtype.kind not in "buif" or dtype.itemsize > 8:
        raise InputError(f"{path} holds {dtype}: give an array of whole numbers (DN) or floats")
    require_size(path, shape[1], shape[0], max_pixels)
    needed = offset + dtype.itemsize * shape[0] * shape[1]
    if len(data) < needed:
        raise InputError(f"{path} is truncated: its pixels reach to byte {needed}, it has {len(data)}: copy it again")
    values = _array(data, path)
    if dtype.kind == "f":
        return StoredImage(real_numbers(values, path), None)
    dn, bits, notes = whole_numbers(values, path)
    return StoredImage(np.ascontiguousarray(dn), bits, notes=notes)


def _header(data: bytes, path: Path) -> tuple[tuple[int, ...], np.dtype[Any], int]:
    file = BytesIO(data)
    try:
        shape, dtype = npy_header(file)
    # A damaged header makes NumPy's parser of Python literals raise what it likes.
    except Exception as error:
        raise InputError(f"{path} is no NumPy array ({_first_line(error)}): save it again") from error
    return shape, dtype, file.tell()


def npy_header(file: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Shape and type of an array in NumPy's format, without its values; raises what NumPy does if it is none."""
    version = np.lib.format.read_magic(file)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(file)
    return shape, dtype


def _array(data: bytes, path: Path) -> NDArray[Any]:
    try:
        values: NDArray[Any] = np.lib.format.read_array(BytesIO(data), allow_pickle=False)
    except (ValueError, OSError) as error:
        raise InputError(f"{path} is no NumPy array ({_first_line(error)}): save it again") from error
    return values


def _first_line(error: Exception) -> str:
    return str(error).partition("\n")[0] or type(error).__name__
