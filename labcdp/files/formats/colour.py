"""From the encoded values of pictures and videos to linear light."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

#: How values are encoded: in proportion to light, or by the curve of IEC 61966-2-1 (sRGB) or of ITU-R BT.709.
Encoding = Literal["linear", "srgb", "bt709"]
#: What findings call them.
ENCODING_NAMES: dict[Encoding, str] = {"linear": "linear", "srgb": "sRGB", "bt709": "BT.709"}
#: Pixels that are looked up at a time: few enough to stay in the processor's cache.
_BLOCK = 2**15
#: Weights of linear red, green and blue in luminance (ITU-R BT.709-6, item 3.2; sRGB has the same primaries).
BT709_LUMINANCE = (0.2126, 0.7152, 0.0722)


def decoded_table(bits: int, encoding: Encoding) -> NDArray[np.float64]:
    """Linear light, from 0 to 1, of each DN of a scale of `bits` bits; shape (2**bits,).

    IEC 61966-2-1:1999, 5.2, for sRGB; the inverse of ITU-R BT.709-6, item 1.2, for BT.709.
    """
    values: NDArray[np.float64] = np.arange(2**bits) / (2**bits - 1)
    if encoding == "srgb":
        values = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    elif encoding == "bt709":
        values = np.where(values < 0.081, values / 4.5, ((values + 0.099) / 1.099) ** (1 / 0.45))
    return values


def luminance_dn(rgb: NDArray[Any], bits: int, encoding: Encoding) -> NDArray[np.uint16]:
    """Luminance of an image in 65535ths of its white, by the weights of ITU-R BT.709.

    Parameters
    ----------
    rgb : ndarray of uint8 or uint16, shape (height, width, 3)
        Red, green and blue.
    bits : int
        Bits of their scale.
    encoding : {'linear', 'srgb', 'bt709'}
        How they are encoded.

    Returns
    -------
    ndarray of uint16, shape (height, width)
    """
    tables = light_tables(bits, encoding)
    luminance = np.empty(rgb.shape[:2], np.uint16)
    # Row by row, what is looked up stays in the processor's cache.
    for row, colours in zip(luminance, rgb, strict=True):
        total = sum(table.take(colours[:, channel], mode="clip") for channel, table in enumerate(tables))
        row[:] = np.minimum(np.rint(total), 65535)
    return luminance


@lru_cache(maxsize=4)
def light_tables(bits: int, encoding: Encoding) -> NDArray[np.float32]:
    """Part of each DN of red, green and blue in the luminance, in 65535ths of white; shape (3, 2**bits)."""
    return np.outer(BT709_LUMINANCE, 65535 * decoded_table(bits, encoding)).astype(np.float32)


def looked_up(table: NDArray[Any], dn: NDArray[np.unsignedinteger[Any]]) -> NDArray[Any]:
    """Values of a table at the DN; DN beyond it get its last value."""
    if dn.dtype == np.uint8 and table.size == 256 and dn.strides[1] == 1:
        import cv2

        return np.asarray(cv2.LUT(dn, table))
    values = np.empty(dn.shape, table.dtype)
    rows = max(_BLOCK // dn.shape[1], 1) if dn.size else 1
    for start in range(0, dn.shape[0], rows):
        block = slice(start, start + rows)
        np.take(table, dn[block], out=values[block], mode="clip")
    return values
