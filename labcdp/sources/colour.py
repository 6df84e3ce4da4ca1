"""From the red, green and blue of an image file to linear light."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .stored_image import Encoding

#: Weights of linear red, green and blue in luminance (ITU-R BT.709-6, item 3.2; sRGB has the same primaries).
BT709_LUMINANCE = (0.2126, 0.7152, 0.0722)


def srgb_decoded(values: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
    """Linear light of sRGB values, both from 0 to 1 (IEC 61966-2-1:1999, 5.2)."""
    low = values / 12.92
    high = ((values + 0.055) / 1.055) ** 2.4
    return np.where(values <= 0.04045, low, high)


def decoded_table(bits: int, encoding: Encoding) -> NDArray[np.float64]:
    """Linear light, from 0 to 1, of each DN of a scale of `bits` bits; shape (2**bits,)."""
    values = np.arange(2**bits) / (2**bits - 1)
    return values if encoding == "linear" else np.asarray(srgb_decoded(values), dtype=np.float64)


def luminance_dn(rgb: NDArray[Any], bits: int, encoding: Encoding) -> NDArray[np.uint16]:
    """Luminance of an image in 65535ths of its white, by the weights of ITU-R BT.709.

    Parameters
    ----------
    rgb : ndarray of uint8 or uint16, shape (height, width, 3)
        Red, green and blue.
    bits : int
        Bits of their scale.
    encoding : {'linear', 'srgb'}
        How they follow light.

    Returns
    -------
    ndarray of uint16, shape (height, width)
    """
    linear = 65535 * decoded_table(bits, encoding)
    tables = [(weight * linear).astype(np.float32) for weight in BT709_LUMINANCE]
    luminance = np.empty(rgb.shape[:2], np.uint16)
    # Row by row, what is looked up stays in the processor's cache.
    for row, colours in zip(luminance, rgb, strict=True):
        total = sum(table.take(colours[:, channel], mode="clip") for channel, table in enumerate(tables))
        row[:] = np.minimum(np.rint(total), 65535)
    return luminance
