"""GenICam pixel formats: from the bytes of a payload to DN and back.

Names and codes are those of the GenICam Pixel Format Naming Convention (PFNC) 2.1 and, for the ``Packed``
formats, of GigE Vision 1.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from .disk.files import quoted
from .errors import InputError

Packing = Literal["byte", "word", "lsb12", "gige12"]


@dataclass(frozen=True)
class PixelFormat:
    """How the pixels of a payload are laid out.

    Parameters
    ----------
    name : str
        PFNC name, for example ``Mono12p``.
    code : int
        PFNC code, as in the GVSP leader.
    bit_depth : int
        Bits of the DN scale.
    packing : {'byte', 'word', 'lsb12', 'gige12'}
        One byte a pixel; one little-endian 16-bit word a pixel; two pixels in three bytes, least significant
        bits first (``p``); two pixels in three bytes, high bytes outside (``Packed``).
    colour_filter : str or None
        First two pixels of the Bayer pattern, or None.
    """

    name: str
    code: int
    bit_depth: int
    packing: Packing
    colour_filter: str | None

    @property
    def typestr(self) -> str | None:
        """Type of a pixel, as in NumPy's array interface, where each lies in memory by itself; else None."""
        return {"byte": "|u1", "word": "<u2"}.get(self.packing)

    def payload_bytes(self, n_pixels: int) -> int:
        """Bytes that `n_pixels` take."""
        bits = {"byte": 8, "word": 16, "lsb12": 12, "gige12": 12}[self.packing]
        return (n_pixels * bits + 7) // 8

    def unpack(self, payload: NDArray[np.uint8], shape: tuple[int, int]) -> NDArray[np.unsignedinteger[Any]]:
        """Turn a payload into DN.

        Parameters
        ----------
        payload : ndarray of uint8, shape (n,)
            The bytes; more than needed are ignored.
        shape : (int, int)
            Height and width.

        Returns
        -------
        ndarray of uint8 or uint16, shape (height, width)
            A view of `payload` where the layout allows; else read-only memory of its own.

        Raises
        ------
        InputError
            If there are fewer bytes than the format needs.
        """
        n = shape[0] * shape[1]
        needed = self.payload_bytes(n)
        if payload.size < needed:
            raise InputError(
                f"the payload has {payload.size} bytes, but {shape[1]} x {shape[0]} pixels of {self.name} take "
                f"{needed}: give all bytes of the frame"
            )
        data = payload[:needed]
        if self.typestr is not None:
            return data.view(self.typestr).reshape(shape)
        return _unpack12(data, n, self.packing).reshape(shape)

    def pack(self, dn: NDArray[np.unsignedinteger[Any]]) -> NDArray[np.uint8]:
        """Turn DN of `bit_depth` bits into a payload; the inverse of `unpack`.

        Returns
        -------
        ndarray of uint8, shape (payload_bytes(dn.size),)
        """
        if self.packing == "byte":
            return dn.astype(np.uint8, copy=False).ravel()
        if self.packing == "word":
            return np.ascontiguousarray(dn, dtype="<u2").ravel().view(np.uint8)
        return _pack12(dn.ravel(), self.packing)[: self.payload_bytes(dn.size)]


def _unpack12(data: NDArray[np.uint8], n: int, packing: Packing) -> NDArray[np.uint16]:
    triples = np.zeros(-(-n // 2) * 3, dtype=np.uint8) if data.size % 3 else data
    if triples is not data:
        triples[: data.size] = data
    b0, b1, b2 = (triples[i::3].astype(np.uint16) for i in range(3))
    pixels = np.empty((b0.size, 2), dtype=np.uint16)
    if packing == "gige12":
        pixels[:, 0] = b0 << 4 | b1 & 15
        pixels[:, 1] = b2 << 4 | b1 >> 4
    else:
        pixels[:, 0] = b0 | (b1 & 15) << 8
        pixels[:, 1] = b1 >> 4 | b2 << 4
    # Read-only before a view is made, so a frame need not copy the pixels.
    flat = pixels.reshape(-1)
    pixels.flags.writeable = flat.flags.writeable = False
    return flat[:n]


def _pack12(dn: NDArray[np.unsignedinteger[Any]], packing: Packing) -> NDArray[np.uint8]:
    pixels = np.zeros(dn.size + dn.size % 2, dtype=np.uint16)
    pixels[: dn.size] = dn
    p0, p1 = pixels[0::2], pixels[1::2]
    triples = np.empty((p0.size, 3), dtype=np.uint8)
    if packing == "gige12":
        triples[:, 0] = p0 >> 4
        triples[:, 1] = p0 & 15 | (p1 & 15) << 4
        triples[:, 2] = p1 >> 4
    else:
        triples[:, 0] = p0 & 255
        triples[:, 1] = p0 >> 8 | (p1 & 15) << 4
        triples[:, 2] = p1 >> 4
    return triples.ravel()


_MONO: tuple[tuple[str, int, int, Packing], ...] = (
    ("Mono8", 0x01080001, 8, "byte"),
    ("Mono10", 0x01100003, 10, "word"),
    ("Mono12", 0x01100005, 12, "word"),
    ("Mono12Packed", 0x010C0006, 12, "gige12"),
    ("Mono12p", 0x010C0047, 12, "lsb12"),
    ("Mono16", 0x01100007, 16, "word"),
)

#: Last two hexadecimal digits of the Bayer codes, in the order GR, RG, GB, BG.
_BAYER: tuple[tuple[str, int, tuple[int, int, int, int], int, Packing], ...] = (
    ("8", 0x01080000, (0x08, 0x09, 0x0A, 0x0B), 8, "byte"),
    ("10", 0x01100000, (0x0C, 0x0D, 0x0E, 0x0F), 10, "word"),
    ("12", 0x01100000, (0x10, 0x11, 0x12, 0x13), 12, "word"),
    ("12Packed", 0x010C0000, (0x2A, 0x2B, 0x2C, 0x2D), 12, "gige12"),
    ("12p", 0x010C0000, (0x57, 0x59, 0x55, 0x53), 12, "lsb12"),
    ("16", 0x01100000, (0x2E, 0x2F, 0x30, 0x31), 16, "word"),
)

#: The supported formats by name.
PIXEL_FORMATS: dict[str, PixelFormat] = {
    name: PixelFormat(name, code, bits, packing, None) for name, code, bits, packing in _MONO
} | {
    f"Bayer{pattern}{suffix}": PixelFormat(f"Bayer{pattern}{suffix}", base | code, bits, packing, pattern)
    for suffix, base, codes, bits, packing in _BAYER
    for pattern, code in zip(("GR", "RG", "GB", "BG"), codes, strict=True)
}


def pixel_format(name: str) -> PixelFormat:
    """Return the format of that name.

    Raises
    ------
    InputError
        If it is not supported; the message lists the names.
    """
    try:
        return PIXEL_FORMATS[name]
    except KeyError:
        raise InputError(
            f"pixel format {quoted(name)} is not supported: choose one of {', '.join(sorted(PIXEL_FORMATS))}"
        ) from None
