"""TIFF files whose pixels lie within bytes: 2, 4, 10, 12 or 14 bits one after the other."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .png_picture import decoded

#: Depths that are packed; 1 bit tifffile unpacks itself.
PACKED_DEPTHS = (2, 4, 10, 12, 14)


def unpacked(page: Any, data: bytes) -> NDArray[Any]:
    """DN of a grey page, shape (height, width).

    Parameters
    ----------
    page : tifffile.TiffPage
        The page.
    data : bytes
        The whole file.

    Raises
    ------
    ValueError
        If it is compressed in a way that OpenCV does not undo either, or of a rare layout.
    """
    if page.compression != 1:
        return _by_opencv(page, data)
    if page.is_tiled or page.fillorder != 1 or page.samplesperpixel != 1:
        raise ValueError(f"{page.bitspersample} bits in tiles, colours, or from the lowest bit on")
    height, width, bits = page.imagelength, page.imagewidth, page.bitspersample
    row_bytes = (width * bits + 7) // 8
    strips = [data[start : start + n] for start, n in zip(page.dataoffsets, page.databytecounts, strict=True)]
    rows = np.frombuffer(b"".join(strips), np.uint8)[: height * row_bytes].reshape(height, row_bytes)
    # Highest bit first (TIFF 6.0, tag FillOrder); each row starts with a byte of its own.
    weights = 1 << np.arange(bits)[::-1]
    dn = np.empty((height, width), np.uint8 if bits < 8 else np.uint16)
    for row in range(height):
        dn[row] = np.unpackbits(rows[row], count=width * bits).reshape(width, bits) @ weights
    return dn


def _by_opencv(page: Any, data: bytes) -> NDArray[Any]:
    """OpenCV puts the bits into the upper ones of 16."""
    spare = 16 - page.bitspersample
    values, _ = decoded(data)
    if values.dtype != np.uint16 or np.bitwise_or.reduce(values, axis=None) & (2**spare - 1):
        raise ValueError(f"{page.bitspersample} bits that decode to {values.dtype}")
    dn: NDArray[np.uint16] = values >> spare
    return dn
