"""Images of a data set, read bit for bit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError


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
        If it cannot be read, has colours or another size, or holds values beyond its DN scale.
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

    data = np.frombuffer(path.read_bytes(), np.uint8)
    if data.size == 0:
        return None
    image: NDArray[Any] | None = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    return image


def _tiff(path: Path) -> NDArray[Any] | None:
    import tifffile

    try:
        image: NDArray[Any] = tifffile.imread(path)
    except (tifffile.TiffFileError, ValueError):
        return None
    return image.astype(image.dtype.newbyteorder("="), copy=False)
