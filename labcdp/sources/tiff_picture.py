"""TIFF files: grey, colours or a palette, integers or floats."""

from __future__ import annotations

import json
from io import BytesIO
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .colour import BT709_LUMINANCE
from .exif import ExifFacts, read_exif
from .packed_tiff import PACKED_DEPTHS, unpacked
from .png_picture import decoded
from .stored_image import (
    Encoding,
    StoredImage,
    grey_if_colourless,
    real_numbers,
    require_size,
    whole_numbers,
    without_alpha,
)

SIGNATURES = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
#: Compressions that tifffile undoes without a package of codecs: none, the two codes of Deflate, and PackBits.
_OWN_CODECS = (1, 8, 32946, 32773)
_WHITE_IS_ZERO, _BLACK_IS_ZERO, _RGB, _PALETTE = 0, 1, 2, 3
_ICC_PROFILE = 34675


def read_tiff(data: bytes, path: Path, max_pixels: int) -> StoredImage:
    """Read a TIFF of one picture.

    Raises
    ------
    InputError
        If it is truncated, damaged, larger than `max_pixels`, holds several pictures, or one of another kind.
    """
    import tifffile

    facts = read_exif(data, path)
    try:
        with tifffile.TiffFile(BytesIO(data)) as tiff:
            page = _only_page(tiff, path)
            require_size(path, page.imagewidth, page.imagelength, max_pixels)
            _require_kind(page, path)
            _require_data(page, path)
            return _read(page, data, path, facts)
    except InputError:
        raise
    # Codecs and damaged directories raise what their libraries do.
    except Exception as error:
        raise InputError(
            f"{path} cannot be read as TIFF ({_first_line(error)}): save it again, without compression"
        ) from error


def tiff_text(data: bytes) -> dict[str, Any] | None:
    """Return what labcdp noted in a file it wrote, None for others."""
    import tifffile

    try:
        with tifffile.TiffFile(BytesIO(data)) as tiff:
            values = json.loads(tiff.pages.first.description)
    # Others write what they like into a description, and damaged directories raise what they like.
    except Exception:
        return None
    return values if isinstance(values, dict) else None


def is_of_a_sensor(data: bytes) -> bool:
    """Whether this is camera RAW in TIFF's form: it has a DNGVersion, or lies behind a colour filter array."""
    import tifffile

    try:
        with tifffile.TiffFile(BytesIO(data)) as tiff:
            page = tiff.pages.first.aspage()
            return 50706 in page.tags or page.photometric in (32803, 34892)
    except Exception:
        return False


def _only_page(tiff: Any, path: Path) -> Any:
    # Small copies for previews are no pictures of their own.
    pages = [page for page in (page.aspage() for page in tiff.pages) if not page.subfiletype & 1]
    if not pages:
        raise InputError(
            f"{path} is truncated or damaged: it has no picture in {tiff.filehandle.size} bytes: copy it again"
        )
    if len(pages) != 1:
        raise InputError(f"{path} holds {len(pages)} pictures: give files of one picture each")
    return pages[0]


def _require_kind(page: Any, path: Path) -> None:
    samples, extra = page.samplesperpixel, len(page.extrasamples)
    colours = samples - extra
    known = {_WHITE_IS_ZERO: 1, _BLACK_IS_ZERO: 1, _PALETTE: 1, _RGB: 3}.get(page.photometric)
    if known != colours or extra > 1 or page.imagedepth != 1:
        raise InputError(
            f"{path} holds {samples} values a pixel as {getattr(page.photometric, 'name', page.photometric)}: save it "
            "as grey or RGB"
        )


def _require_data(page: Any, path: Path) -> None:
    """Refuse pixels of which the directory does not say where they are; decoders take them for 0."""
    known = [count for offset, count in zip(page.dataoffsets, page.databytecounts, strict=False) if offset and count]
    needed = page.imagewidth * page.imagelength * page.samplesperpixel * page.bitspersample // 8
    uncompressed = page.compression == 1 and not page.is_tiled
    if len(known) < prod(page.chunked) or (uncompressed and sum(known) < needed):
        raise InputError(f"{path} is damaged: it has data for a part of its pixels only: copy it again")


def _read(page: Any, data: bytes, path: Path, facts: ExifFacts) -> StoredImage:
    values = _values(page, data, path)
    notes: list[str] = []
    if page.extrasamples:
        opaque = float(np.iinfo(values.dtype).max) if values.dtype.kind in "ui" else 1.0
        values, note = without_alpha(values, opaque)
        notes.append(note)
    if values.dtype.kind == "f":
        if values.ndim == 3:
            values = values.astype(np.float64) @ BT709_LUMINANCE
            notes.append("colour to grey (ITU-R BT.709 luminance), values taken as linear")
        return StoredImage(real_numbers(values, path), None, "linear", facts, tuple(notes))
    if page.photometric == _PALETTE:
        values, bits = _resolved(values, page)
        notes.append("palette resolved")
    else:
        values, bits, more = whole_numbers(values, path)
        notes += more
        if page.bitspersample < 16:
            bits = page.bitspersample
    if page.photometric == _WHITE_IS_ZERO:
        values = (2**bits - 1 - values).astype(values.dtype)
        notes.append("white is 0 in the file: values turned round")
    return StoredImage(np.ascontiguousarray(values), bits, _encoding(page, values.ndim == 3), facts, tuple(notes))


def _values(page: Any, data: bytes, path: Path) -> NDArray[Any]:
    """Pixels, shape (height, width) or (height, width, samples), of the type the file states."""
    shape = (page.imagelength, page.imagewidth)
    if page.bitspersample in PACKED_DEPTHS:
        return unpacked(page, data)
    try:
        values = page.asarray() if page.compression in _OWN_CODECS else None
    except ValueError:
        values = None  # a predictor that tifffile leaves to a package
    if values is None:
        values, _ = decoded(data)
        if values.ndim == 3:
            values = values[..., [2, 1, 0, 3][: values.shape[2]]]
        if page.dtype is None or values.dtype != page.dtype.newbyteorder("="):
            raise InputError(
                f"{path} states {page.dtype} but decodes to {values.dtype}: save it again, without compression"
            )
    elif page.planarconfig == 2 and values.ndim == 3:
        values = np.moveaxis(values, 0, -1)
    if values.shape[:2] != shape or values.ndim not in (2, 3):
        raise ValueError(f"its data have the shape {values.shape}, not {shape}")
    return np.array(values, dtype=values.dtype.newbyteorder("="))


def _resolved(indices: NDArray[Any], page: Any) -> tuple[NDArray[Any], int]:
    """Colours of a palette, grey if all of them are, and their bits."""
    palette = np.asarray(page.colormap, dtype=np.uint16)
    high, low = palette >> 8, palette & 255
    bits = 16
    # Many programs spread 8 bits over the 16 of the format, times 257 or 256, or do not spread them.
    if not high.any():
        palette, bits = low.astype(np.uint8), 8
    elif np.array_equal(low, high) or not low.any():
        palette, bits = high.astype(np.uint8), 8
    return grey_if_colourless(np.moveaxis(palette[:, indices], 0, -1)), bits


def _encoding(page: Any, coloured: bool) -> Encoding:
    """Colours of 8 bits, and those with a profile, are made for screens."""
    eight = page.bitspersample <= 8
    return "srgb" if coloured and (eight or _ICC_PROFILE in page.tags) else "linear"


def _first_line(error: Exception) -> str:
    return str(error).partition("\n")[0] or type(error).__name__
