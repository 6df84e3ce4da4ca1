"""Values of an image file before anything is made of them: their encoding, their size, their way up."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryFile
from threading import Lock
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.frame import BlackPattern
from ..core.result import Finding, info, warning
from .exif import ExifFacts

#: How values are encoded: in proportion to light, or by the curve of IEC 61966-2-1 (sRGB) or of ITU-R BT.709.
Encoding = Literal["linear", "srgb", "bt709"]
#: What findings call them.
ENCODING_NAMES: dict[Encoding, str] = {"linear": "linear", "srgb": "sRGB", "bt709": "BT.709"}
#: Most bits of grey values that may be made for screens as well as by a camera, where a file does not say it.
SCREEN_BITS = 8
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


#: Pixels from which an image is refused before it is decoded, unless a caller allows more.
MAX_PIXELS = 250_000_000


@dataclass(frozen=True, eq=False)
class StoredImage:
    """Values of an image file.

    Parameters
    ----------
    values : ndarray of uint8, uint16 or float32, shape (height, width) or (height, width, 3)
        Grey, or red, green and blue.
    bits : int or None
        Bits of the scale of integers as the file states it; None for floats.
    encoding : {'linear', 'srgb'}
        How values are encoded, as the file or its kind suggests.
    facts : ExifFacts
        What the file says about how it was taken.
    changes : tuple of Finding
        What was done to the values.
    doubts : tuple of Finding
        What is not certain about the values, such as how they are encoded.
    cd_m2_per_value : float or None
        Luminance of the value 1, of float files that state it.
    black : (float, BlackPattern or None) or None
        Black level that the file states, and the pattern of the pixels around it.
    white_dn : float or None
        DN that the file states to be saturated.
    """

    values: NDArray[Any]
    bits: int | None
    encoding: Encoding = "linear"
    facts: ExifFacts = field(default_factory=ExifFacts)
    changes: tuple[Finding, ...] = ()
    doubts: tuple[Finding, ...] = ()
    cd_m2_per_value: float | None = None
    black: tuple[float, BlackPattern | None] | None = None
    white_dn: float | None = None

    def upright(self) -> StoredImage:
        """Turn the picture as its EXIF says, and without colours if all of them are grey.

        Values of a sensor whose pixels have black levels of their own stay as they are, as in camera RAW.
        """
        values, changes = self.values, self.changes
        orientation = 1 if self.black is not None and self.black[1] is not None else self.facts.orientation
        if orientation != 1:
            values, changes = upright(values, orientation), (*changes, info("turned", orientation=orientation))
        return replace(self, values=grey_if_colourless(values), changes=changes)

    @property
    def coloured(self) -> bool:
        """Whether there are three values a pixel."""
        return self.values.ndim == 3


def require_size(path: Path, width: int, height: int, max_pixels: int) -> None:
    """Refuse an image by the size its header announces, before memory is allocated for it.

    Raises
    ------
    InputError
        If it has no pixel, or more than `max_pixels`.
    """
    if width < 1 or height < 1:
        raise InputError(f"{path} announces {width} x {height} pixels: give a picture with some")
    if width * height > max_pixels:
        raise InputError(
            f"{path} announces {width} x {height} pixels, more than the limit of {max_pixels / 1e6:g} megapixels: "
            "give a smaller part of it, or raise the limit if it is really that large"
        )


def whole_numbers(values: NDArray[Any], path: Path) -> tuple[NDArray[Any], int, tuple[Finding, ...]]:
    """Integers of any type as uint8 or uint16, the bits of their type, and what was done to them.

    Raises
    ------
    InputError
        If a value is negative or above 65535, which no DN is.
    """
    if values.dtype == np.bool_:
        return values.astype(np.uint8), 1, ()
    if values.dtype.kind == "u" and values.dtype.itemsize <= 2:
        return values.astype(values.dtype.newbyteorder("="), copy=False), 8 * values.dtype.itemsize, ()
    low, high = int(values.min()), int(values.max())
    if low < 0 or high > 65535:
        raise InputError(
            f"{path} has values from {low} to {high}: DN are whole numbers from 0 to 65535; save luminance and the "
            "like as floats"
        )
    return values.astype(np.uint16), 16, (info("integers-as-dn", type=values.dtype.name),)


def real_numbers(values: NDArray[Any], path: Path) -> NDArray[np.float32]:
    """Floats of any type as float32.

    Raises
    ------
    InputError
        If a finite value is too large for it.
    """
    with np.errstate(over="ignore"):
        result: NDArray[np.float32] = values.astype(np.float32)
    if values.dtype.itemsize > 4 and not (np.isfinite(result) == np.isfinite(values)).all():
        raise InputError(f"{path} has values beyond {np.finfo(np.float32).max:.3g}: give them in a larger unit")
    return result


def without_alpha(values: NDArray[Any], opaque: float) -> tuple[NDArray[Any], Finding]:
    """Colours or grey of an image whose last channel is opacity, and the finding that it was ignored."""
    share = float(np.mean(values[..., -1] != opaque))
    finding = info("alpha-ignored") if share == 0 else warning("alpha-not-opaque", share=share)
    colours = values[..., :-1]
    return (colours[..., 0] if colours.shape[-1] == 1 else colours), finding


def grey_if_colourless(values: NDArray[Any]) -> NDArray[Any]:
    """Grey, shape (height, width), of colours that are all grey; else the values as they are."""
    if values.ndim == 2:
        return values
    red = values[..., 0]
    colourless = np.array_equal(red, values[..., 1]) and np.array_equal(red, values[..., 2])
    return np.ascontiguousarray(red) if colourless else values


#: EXIF orientations (CIPA DC-008, tag 274) by the signs of a display matrix: what column and row add to x, and to y.
_OF_MATRIX = {
    (1, 0, 0, 1): 1, (-1, 0, 0, 1): 2, (-1, 0, 0, -1): 3, (1, 0, 0, -1): 4,
    (0, 1, 1, 0): 5, (0, 1, -1, 0): 6, (0, -1, -1, 0): 7, (0, -1, 1, 0): 8,
}  # fmt: skip


def upright(values: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Values of a picture as it is to be seen; shape (height, width) or with colours."""
    if orientation > 4:
        values = values.swapaxes(0, 1)
    if orientation in (2, 3, 6, 7):
        values = values[:, ::-1]
    if orientation in (3, 4, 7, 8):
        values = values[::-1]
    return np.ascontiguousarray(values)


def orientation_of_matrix(matrix: bytes) -> int | None:
    """EXIF orientation of FFmpeg's display matrix (nine 32-bit integers); None if it is no multiple of 90 degrees."""
    a, b, _, c, d = np.sign(np.frombuffer(matrix, np.int32, 5))
    return _OF_MATRIX.get((int(a), int(b), int(c), int(d)))


#: How the messages of libpng, libjpeg and OpenEXR look.
_OF_DECODERS = re.compile(
    rb"libpng |Corrupt JPEG|Premature end of JPEG|Invalid SOS|Invalid component|Warning: unknown JFIF|"
    rb"Inconsistent progression|Unknown Adobe|.*\(EXR_ERR_"
)
_STANDARD_ERROR = 2
#: The file descriptor belongs to the whole process.
_lock = Lock()


@contextmanager
def decoder_messages() -> Iterator[list[str]]:
    """Catch what decoders print on standard error; gives a list that is filled at the end, each message once.

    Whatever else is printed meanwhile, by another thread for example, continues to standard error afterwards.
    """
    messages: list[str] = []
    with _lock, TemporaryFile() as caught:
        try:
            kept = os.dup(_STANDARD_ERROR)
        except OSError:
            # Without a standard error nothing can be printed on it.
            yield messages
            return
        _flush()
        os.dup2(caught.fileno(), _STANDARD_ERROR)
        try:
            yield messages
        finally:
            _flush()
            os.dup2(kept, _STANDARD_ERROR)
            os.close(kept)
            caught.seek(0)
            for line in caught.read().splitlines(keepends=True):
                if _OF_DECODERS.match(line):
                    messages.append(line.decode("utf-8", "replace").strip())
                else:
                    os.write(_STANDARD_ERROR, line)
            messages[:] = dict.fromkeys(messages)


def _flush() -> None:
    if sys.stderr is not None and not sys.stderr.closed:
        sys.stderr.flush()
