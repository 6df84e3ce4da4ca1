"""DN: GenICam pixel formats, from the bytes of a payload to DN and back, and how the DN grow with the light.

Names and codes of pixel formats are those of the GenICam Pixel Format Naming Convention (PFNC) 2.1 and, for the
``Packed`` formats, of GigE Vision 1.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .disk.files import quoted
from .errors import InputError

Packing = Literal["byte", "word", "dword", "lsb12", "gige12"]
#: Pixels that are looked up at a time: few enough to stay in the processor's cache.
_BLOCK = 2**15
#: Steps between DN from which a response is inverted.
_INVERSE_STEPS = 4096


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
    packing : {'byte', 'word', 'dword', 'lsb12', 'gige12'}
        One byte a pixel; one little-endian word of 16 or 32 bits a pixel; two pixels in three bytes, least significant
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
        return {"byte": "|u1", "word": "<u2", "dword": "<u4"}.get(self.packing)

    def payload_bytes(self, n_pixels: int) -> int:
        """Bytes that `n_pixels` take."""
        bits = {"byte": 8, "word": 16, "dword": 32, "lsb12": 12, "gige12": 12}[self.packing]
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
        ndarray of uint8, uint16 or uint32, shape (height, width)
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
        if self.packing in ("word", "dword"):
            return np.ascontiguousarray(dn, dtype=self.typestr).ravel().view(np.uint8)
        return _pack12(dn.ravel(), self.packing)[: self.payload_bytes(dn.size)]


def _unpack12(data: NDArray[np.uint8], n: int, packing: Packing) -> NDArray[np.uint16]:
    triples = np.zeros(-(-n // 2) * 3, dtype=np.uint8) if data.size % 3 else data
    if triples is not data:
        triples[: data.size] = data
    b0, b1, b2 = (triples[i::3].astype(np.uint16) for i in range(3))
    pixels = np.empty((b0.size, 2), dtype=np.uint16)
    pixels[:, 0] = b0 << 4 | b1 & 15 if packing == "gige12" else b0 | (b1 & 15) << 8
    pixels[:, 1] = b2 << 4 | b1 >> 4
    # Read-only before a view is made, so a frame need not copy the pixels.
    flat = pixels.reshape(-1)
    pixels.flags.writeable = flat.flags.writeable = False
    return flat[:n]


def _pack12(dn: NDArray[np.unsignedinteger[Any]], packing: Packing) -> NDArray[np.uint8]:
    pixels = np.zeros(dn.size + dn.size % 2, dtype=np.uint16)
    pixels[: dn.size] = dn
    p0, p1 = pixels[0::2], pixels[1::2]
    # Eight bits of the first pixel stand alone, four share a byte with the second one.
    alone, shared = (p0 >> 4, p0 & 15) if packing == "gige12" else (p0 & 255, p0 >> 8)
    triples = np.empty((p0.size, 3), dtype=np.uint8)
    triples[:, 0], triples[:, 1], triples[:, 2] = alone, shared | (p1 & 15) << 4, p1 >> 4
    return triples.ravel()


#: What names end in, bits, packing, and the codes of Mono and of the Bayer patterns GR, RG, GB and BG.
_LAYOUTS: tuple[tuple[str, int, Packing, tuple[int, ...]], ...] = (
    ("8", 8, "byte", (0x01080001, 0x01080008, 0x01080009, 0x0108000A, 0x0108000B)),
    ("10", 10, "word", (0x01100003, 0x0110000C, 0x0110000D, 0x0110000E, 0x0110000F)),
    ("12", 12, "word", (0x01100005, 0x01100010, 0x01100011, 0x01100012, 0x01100013)),
    ("12Packed", 12, "gige12", (0x010C0006, 0x010C002A, 0x010C002B, 0x010C002C, 0x010C002D)),
    ("12p", 12, "lsb12", (0x010C0047, 0x010C0057, 0x010C0059, 0x010C0055, 0x010C0053)),
    ("16", 16, "word", (0x01100007, 0x0110002E, 0x0110002F, 0x01100030, 0x01100031)),
)

#: The supported formats by name.
PIXEL_FORMATS: dict[str, PixelFormat] = {
    f"{kind}{ending}": PixelFormat(f"{kind}{ending}", codes[at], bits, packing, kind[5:] or None)
    for at, kind in enumerate(("Mono", "BayerGR", "BayerRG", "BayerGB", "BayerBG"))
    for ending, bits, packing, codes in _LAYOUTS
}


#: Formats of files beside them, in the way of the PFNC: linear values of merged exposures in words of 32 bits.
FILE_FORMATS: dict[str, PixelFormat] = {
    f"{kind}{bits}": PixelFormat(f"{kind}{bits}", 0, bits, "dword", kind[5:] or None)
    for kind in ("Mono", "BayerGR", "BayerRG", "BayerGB", "BayerBG")
    for bits in (20, 24)
}


def pixel_format(name: str) -> PixelFormat:
    """Return the format of that name, of cameras or of files.

    Raises
    ------
    InputError
        If it is not supported; the message lists the names.
    """
    known = PIXEL_FORMATS | FILE_FORMATS
    if name not in known:
        raise InputError(f"pixel format {quoted(name)} is not supported: choose one of {', '.join(sorted(known))}")
    return known[name]


def look_up(
    table: NDArray[Any], dn: NDArray[np.unsignedinteger[Any]], factor: NDArray[Any] | None = None
) -> NDArray[Any]:
    """Values of a table at DN.

    Parameters
    ----------
    table : ndarray, shape (n,)
        Value by DN; DN beyond it get the last value.
    dn : ndarray of unsigned integers, shape (height, width)
        The DN, or other indices.
    factor : ndarray, shape (height, width), or None
        What values are multiplied by.

    Returns
    -------
    ndarray, shape (height, width)
        Of the type of the table.

    Examples
    --------
    >>> look_up(np.array([0.0, 0.5, 1.0]), np.array([[2, 1, 7]], np.uint16))
    array([[1. , 0.5, 1. ]])
    """
    if dn.dtype == np.uint8 and table.size == 256 and dn.strides[1] == 1:
        import cv2

        values = np.asarray(cv2.LUT(dn, table))
        return values if factor is None else np.multiply(values, factor, out=values)
    values = np.empty(dn.shape, table.dtype)
    rows = max(_BLOCK // max(dn.shape[1], 1), 1)
    for start in range(0, dn.shape[0], rows):
        block = slice(start, start + rows)
        np.take(table, dn[block], out=values[block], mode="clip")
        if factor is not None:
            values[block] *= factor[block]
    return values


ResponseKind = Literal["linear", "quadratic", "cubic", "gamma", "knees", "pchip", "table"]


@dataclass(frozen=True)
class Response:
    """Linearised DN h(n) of a DN n above dark: h is proportional to the exposure (luminance times time) of a pixel.

    h rises strictly and h(0) = 0. A fitted response is normalised at small signals: the slope of a quadratic one is 1
    at zero, and the others have h = n at their first knot, so that R is the responsivity at small signals. Below zero,
    where noise leads, h is continued with its slope at zero.

    Parameters
    ----------
    kind : {'linear', 'quadratic', 'cubic', 'gamma', 'knees', 'pchip', 'table'}
        linear: h(n) = n. quadratic: h(n) = n (1 + q n / n_max). pchip: monotone cubic interpolation (F. N. Fritsch and
        R. E. Carlson, SIAM J. Numer. Anal. 17 (1980) 238) of the knots; cubic and gamma, too, with many knots of such
        a curve. table and knees: straight lines between the knots.
    net_dn : tuple of float
        Knots, rising from 0; empty for linear, (0, n_max) for quadratic.
    linear_dn : tuple of float
        h at the knots; empty for linear, (0, h(n_max)) for quadratic.

    Raises
    ------
    InputError
        If the knots do not start at 0, or do not rise.
    """

    kind: ResponseKind = "linear"
    net_dn: tuple[float, ...] = ()
    linear_dn: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.kind == "linear":
            if self.net_dn or self.linear_dn:
                raise InputError("a linear response has no knots: leave net_dn and linear_dn empty")
            return
        least = 2
        if len(self.net_dn) != len(self.linear_dn) or len(self.net_dn) < least:
            raise InputError(
                f"a {self.kind} response has {len(self.net_dn)} and {len(self.linear_dn)} knots: give at least {least} "
                "pairs of net_dn and linear_dn"
            )
        for name in ("net_dn", "linear_dn"):
            values = np.array(getattr(self, name))
            if not (np.isfinite(values).all() and values[0] == 0 and (np.diff(values) > 0).all()):
                raise InputError(f"{name} of the response does not rise from 0: give rising values")
        if self.kind == "quadratic" and not (len(self.net_dn) == 2 and self.linear_dn[1] > self.net_dn[1] / 2):
            raise InputError("a quadratic response that rises has two knots, and its h(n_max) is above n_max / 2")

    def linearise(self, net_dn: ArrayLike) -> NDArray[np.float64]:
        """h(n), any shape; beyond the last knot with the slope there."""
        return self._evaluate(net_dn)[0]

    def slope(self, net_dn: ArrayLike) -> NDArray[np.float64]:
        """dh/dn, any shape."""
        return self._evaluate(net_dn)[1]

    def inverse(self, linear_dn: ArrayLike) -> NDArray[np.float64]:
        """DN n above dark with a linearised h(n), any shape, by Newton's method."""
        h = np.asarray(linear_dn, dtype=float)
        if self.kind == "linear":
            return h.copy()
        grid = np.linspace(0, self.net_dn[-1], _INVERSE_STEPS)
        n: NDArray[np.float64] = np.interp(h, self.linearise(grid), grid)
        for _ in range(3):
            n = n + (h - self.linearise(n)) / self.slope(n)
        return n

    def _evaluate(self, net_dn: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        n = np.asarray(net_dn, dtype=float)
        if self.kind == "linear":
            return n.copy(), np.ones_like(n)
        knots, values = np.array(self.net_dn), np.array(self.linear_dn)
        inside = np.clip(n, 0, knots[-1])
        if self.kind == "quadratic":
            bend = (values[1] / knots[1] - 1) / knots[1]
            value, slope = inside * (1 + bend * inside), 1 + 2 * bend * inside
        elif self.kind not in ("knees", "table"):
            from scipy.interpolate import PchipInterpolator

            curve = PchipInterpolator(knots, values)
            value, slope = curve(inside), curve(inside, 1)
        else:
            value = np.interp(inside, knots, values)
            steps = np.diff(values) / np.diff(knots)
            slope = steps[np.clip(np.searchsorted(knots, inside, side="right") - 1, 0, steps.size - 1)]
        return value + slope * (n - inside), slope
