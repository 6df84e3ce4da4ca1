"""Values of an image file before anything is made of them: their encoding, their size, their way up."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryFile
from threading import Lock
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.dn import look_up
from ..core.errors import InputError
from ..core.result import Finding, info, warning
from .statements import FileStatements
from .transfer import BT709_LUMINANCE, Encoding, Weights, light_tables

#: Most bits of grey values that may be made for screens as well as by a camera, where a file does not say it.
SCREEN_BITS = 8


def luminance_dn(
    rgb: NDArray[Any], bits: int, encoding: Encoding, weights: Weights = BT709_LUMINANCE
) -> NDArray[np.uint16]:
    """Luminance of an image in 65535ths of its white.

    Parameters
    ----------
    rgb : ndarray of uint8 or uint16, shape (height, width, 3)
        Red, green and blue.
    bits : int
        Bits of their scale.
    encoding : str
        How they are encoded.
    weights : (float, float, float)
        Of linear red, green and blue; those of ITU-R BT.709 by default.

    Returns
    -------
    ndarray of uint16, shape (height, width)
    """
    return weighted(rgb, light_tables(bits, encoding, weights))


def weighted(rgb: NDArray[Any], tables: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Sum of what tables, shape (3, n), have for red, green and blue, from 0 to 65535."""
    luminance = np.empty(rgb.shape[:2], np.uint16)
    # Row by row, what is looked up stays in the processor's cache.
    for row, colours in zip(luminance, rgb, strict=True):
        total = sum(table.take(colours[:, channel], mode="clip") for channel, table in enumerate(tables))
        row[:] = np.clip(np.rint(total), 0, 65535)
    return luminance


#: Pixels from which an image is refused before it is decoded, unless a caller allows more.
MAX_PIXELS = 250_000_000


#: Bits of linear values: float32 holds them without rounding.
MOST_BITS = 24
#: Code of what is said of values of up to 16 bits in a wider type.
INTEGERS = "integers-as-dn"


#: Values of an image file, uint8, uint16, uint32 or float32, shape (height, width) or (height, width, 3); and what the
#: file states.
Stored: TypeAlias = tuple[NDArray[Any], FileStatements]


def as_seen(values: NDArray[Any], statements: FileStatements) -> Stored:
    """Turn values as their EXIF says, and leave out colours if all of them are grey.

    Values of a sensor whose pixels have black levels of their own stay as they are, as in camera RAW.
    """
    black, orientation = statements.black, statements.orientation
    if orientation != 1 and (black is None or black[1] is None):
        values = upright(values, orientation)
        statements = replace(statements, changes=(*statements.changes, info("turned", orientation=orientation)))
    return grey_if_colourless(values), statements


def decoded_by_table(
    values: NDArray[Any], bits: int, tables: NDArray[np.uint16], weights: Weights
) -> NDArray[np.uint16]:
    """Light of values on a scale of `bits` bits by the table that their file states, as linear values of 16 bits."""
    if tables.shape[1] != 2**bits:
        steps = np.linspace(0, tables.shape[1] - 1, 2**bits)
        of_scale = [np.interp(steps, np.arange(tables.shape[1]), table) for table in tables]
        tables = np.rint(of_scale).astype(np.uint16)
    if values.ndim == 2:
        # Of grey in three channels, the luminance is the sum of theirs.
        grey = np.rint(np.array(weights) @ tables).astype(np.uint16) if len(tables) == 3 else tables[0]
        return look_up(grey, values)
    channels = (tables[at] if len(tables) == 3 else tables[0] for at in range(3))
    return np.dstack([look_up(table, values[..., at]) for at, table in enumerate(channels)])


def grey_finding(encoding: Encoding, weights: Weights) -> Finding:
    """Return the finding that colours became luminance, and how."""
    if weights != BT709_LUMINANCE:
        return info("colour-to-grey-by-file")
    return info("srgb-colour-to-grey" if encoding == "srgb" else "colour-to-grey")


def require_size(path: Path, width: int, height: int, max_pixels: int) -> None:
    """Refuse an image by the size its header announces, before memory is allocated for it.

    Raises
    ------
    InputError
        If it has no pixel, or more than `max_pixels`.
    """
    if width < 1 or height < 1:
        raise InputError(f"{path} announces {width} x {height} pixels: use a picture that has some")
    if width * height > max_pixels:
        raise InputError(
            f"{path} announces {width} x {height} pixels, more than the limit of {max_pixels / 1e6:g} megapixels: "
            "give a smaller part of it, or raise the limit if it is really that large"
        )


def whole_numbers(values: NDArray[Any], path: Path) -> tuple[NDArray[Any], int, tuple[Finding, ...]]:
    """Integers of any type as uint8, uint16 or, up to 24 bits, uint32; the bits of that type; what was done to them.

    Raises
    ------
    InputError
        If a value is negative, or has more than `MOST_BITS` bits.
    """
    if values.dtype == np.bool_:
        return values.astype(np.uint8), 1, ()
    if values.dtype.kind == "u" and values.dtype.itemsize <= 2:
        return values.astype(values.dtype.newbyteorder("="), copy=False), 8 * values.dtype.itemsize, ()
    low, high = int(values.min()), int(values.max())
    if low < 0 or high >= 2**MOST_BITS:
        raise InputError(
            f"{path} has values from {low} to {high}: DN are whole numbers from 0 to {2**MOST_BITS - 1}; save "
            "luminance and the like as floats"
        )
    if high > 65535:
        return values.astype(np.uint32), 32, ()
    return values.astype(np.uint16), 16, (info(INTEGERS, type=values.dtype.name),)


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
