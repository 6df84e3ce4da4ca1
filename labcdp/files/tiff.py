"""TIFF files: grey, colours or a palette, integers or floats."""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import replace
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.disk import parse_json
from ..core.disk.tiff import open_tiff, pixels_of
from ..core.errors import InputError
from ..core.frame import BlackPattern
from ..core.result import info, warning
from .exif import read_exif
from .sensor_tags import LEVELS, masked_level, pattern_findings, tags_of
from .statements import FileStatements
from .stored_image import Stored, as_seen, real_numbers, require_size, whole_numbers, without_alpha
from .tiff_statements import nodata_findings, share_at_end, statements_of
from .transfer import BT709_LUMINANCE, Encoding

_WHITE_IS_ZERO, _BLACK_IS_ZERO, _RGB, _PALETTE = 0, 1, 2, 3
_ICC_PROFILE, _UNCOMPRESSED = 34675, 1
#: Compressions that may lose something, by their codes (TIFF 6.0, and those registered or in use since).
_LOSSY = {
    **dict.fromkeys((6, 7, 99, 33007, 34892), "JPEG"), **dict.fromkeys((33003, 33004, 33005, 34712), "JPEG 2000"),
    34887: "LERC", **dict.fromkeys((22610, 34934), "JPEG XR"), **dict.fromkeys((34927, 50001), "WebP"),
    **dict.fromkeys((50002, 52546), "JPEG XL"),
}  # fmt: skip


def read_tiff(data: bytes, path: Path, max_pixels: int, number: int | None = None) -> Stored:
    """Read a TIFF of one picture, or one of several.

    Parameters
    ----------
    data : bytes
        The file.
    path : Path
        For messages.
    max_pixels : int
        Pixels from which it is refused before it is decoded.
    number : int or None
        Which picture, from 0; None for the only one.

    Raises
    ------
    InputError
        If it is truncated, damaged, larger than `max_pixels`, holds several pictures, or one of another kind.
    """
    exif = read_exif(data, path)
    with open_tiff(data, path) as tiff:
        pages = _pages(tiff, path)
        if number is None and len(pages) != 1:
            raise InputError(
                f"{path} holds {len(pages)} pictures: give files of one picture each, or evaluate it as a video"
            )
        page = pages[number or 0]
        require_size(path, page.imagewidth, page.imagelength, max_pixels)
        _require_kind(page, path)
        return _read(page, path, exif)


def looked_at(data: bytes) -> tuple[dict[str, Any] | None, bool]:
    """Return what labcdp noted in a TIFF it wrote, None for others; and whether it is camera RAW in TIFF's form.

    The latter has a DNGVersion, or lies behind a colour filter array. Of a damaged file nothing is known.
    """
    values, of_a_sensor = None, False
    with suppress(InputError), open_tiff(data, Path()) as tiff:
        page = tiff.pages.first.aspage()
        of_a_sensor = 50706 in page.tags or page.photometric in (32803, 34892)
        # Others write what they like into a description.
        values = parse_json(page.description)
    return values if isinstance(values, dict) else None, of_a_sensor


def count_pictures(data: bytes, path: Path) -> int:
    """Count the pictures of a TIFF; raises InputError if it is damaged or has none."""
    with open_tiff(data, path) as tiff:
        return len(_pages(tiff, path))


def _pages(tiff: Any, path: Path) -> list[Any]:
    all_pages = [page.aspage() for page in tiff.pages]
    # Small copies for previews are no pictures of their own; the picture may lie in a directory below them.
    pages = [page for page in all_pages if not page.subfiletype & 1] or [
        below.aspage() for page in all_pages for below in page.pages or () if not below.aspage().subfiletype & 1
    ]
    if not pages and len(all_pages) == 1 and not all_pages[0].subifds:
        pages = all_pages
    if not pages:
        what = "only small copies of a picture" if all_pages else "no picture"
        raise InputError(f"{path} contains {what} in {tiff.filehandle.size} bytes: give one with a picture")
    if len(pages) == 1 and (count := _count_in_block(pages[0], tiff.filehandle.size)) > 1:
        raise InputError(
            f"{path} holds {count} pictures in one block but lists only the first one, as ImageJ does for stacks of "
            "more than 4 GB, which labcdp does not read: save it with ImageJ as an image sequence"
        )
    return pages


def _count_in_block(page: Any, n_bytes: int) -> int:
    """Pictures that a description of ImageJ or tifffile states and that lie one behind the other, else 1."""
    count = 1
    if noted := re.match(r"ImageJ=[^\0]*?^images=(\d{1,9})\s*$", page.description, re.MULTILINE):
        count = int(noted[1])
    elif noted := re.match(r'{"shape": \[([\d, ]{1,99})\], "truncated": true', page.description):
        count = prod(map(int, noted[1].split(","))) // max(page.size, 1)
    # Others may have copied the description with one picture of a stack.
    is_there = page.dataoffsets and page.dataoffsets[0] + count * sum(page.databytecounts) <= n_bytes
    return count if is_there and page.compression == _UNCOMPRESSED else 1


def _require_kind(page: Any, path: Path) -> None:
    samples, extra = page.samplesperpixel, len(page.extrasamples)
    colours = samples - extra
    known = {_WHITE_IS_ZERO: 1, _BLACK_IS_ZERO: 1, _PALETTE: 1, _RGB: 3}.get(page.photometric)
    if page.dtype is None or page.dtype.kind not in "buif":
        what = "complex numbers" if page.dtype is not None else f"values of {page.bitspersample} bits"
        raise InputError(f"{path} holds {what}, which labcdp does not read: save it as whole numbers or floats")
    if known != colours or extra > 1 or page.imagedepth != 1:
        raise InputError(
            f"{path} holds {samples} values a pixel as {getattr(page.photometric, 'name', page.photometric)}: save it "
            "as grey or RGB"
        )


def _read(page: Any, path: Path, exif: FileStatements) -> Stored:
    values = pixels_of(page, path)
    if page.planarconfig == 2 and values.ndim == 3:
        values = np.moveaxis(values, 0, -1)
    if values.shape[:2] != (page.imagelength, page.imagewidth) or values.ndim not in (2, 3):
        raise ValueError(f"its data have the shape {values.shape}")
    changes = [info("lossy-compression", name=_LOSSY[page.compression])] if page.compression in _LOSSY else []
    if page.extrasamples:
        opaque = float(np.iinfo(values.dtype).max) if values.dtype.kind in "ui" else 1.0
        values, change = without_alpha(values, opaque)
        changes.append(change)
    stated = tags_of(page, path) if values.ndim == 2 and page.photometric == _BLACK_IS_ZERO else None
    black = None if stated is None else stated.black_of((0, 0), values.shape, path)
    if stated is not None:
        changes += stated.findings
        measured = masked_level(values, stated.masked, (1, 1)) if black is None and stated.masked else None
        if measured is not None:
            black = BlackPattern.split(measured)
            changes.append(info("black-level-measured", black_dn=black[0]))
    is_float, coloured = values.dtype.kind == "f", values.ndim == 3 or page.photometric == _PALETTE
    of_sensor = stated is not None and (black is not None or stated.linearization is not None)
    # Whole numbers and colours of palettes have 16 bits at the most.
    bits = None if is_float else 16 if page.photometric == _PALETTE else min(page.bitspersample, 16)
    states = statements_of(page, coloured, bits, of_sensor)
    doubts = [*states.findings, *nodata_findings(values, states.nodata)]
    if stated is None and any(code in page.tags for code in LEVELS):
        doubts.append(warning("sensor-levels-not-used"))
    if is_float and page.photometric == _WHITE_IS_ZERO:
        doubts.append(warning("value-scale-not-used", by="PhotometricInterpretation, by which white is 0,"))
    if is_float:
        if black is not None:
            level, pattern = black
            values = values - np.float64(level) - (0 if pattern is None else pattern.offsets_dn(values.shape))
            changes.append(info("black-level-subtracted", black_dn=level))
        if values.ndim == 3:
            values = values.astype(np.float64) @ states.curve.weights
            usual = states.curve.weights == BT709_LUMINANCE
            changes.append(info("linear-colour-to-grey" if usual else "colour-to-grey-by-file"))
        if states.scale is not None:
            values = states.scale.values(values)
            changes.append(states.scale.finding)
        doubts += states.curve.findings
        per_value = 1.0 if states.scale is not None and states.scale.is_luminance else states.cd_m2_per_value
        known = replace(exif, cd_m2_per_value=per_value, changes=tuple(changes), findings=tuple(doubts))
        return as_seen(real_numbers(values, path), known)
    if page.photometric == _PALETTE:
        values, bits = _resolved(values, page)
        changes.append(info("palette-resolved"))
    else:
        values, bits, more = whole_numbers(values, path)
        changes += more
        if page.bitspersample < 16:
            bits = page.bitspersample
        if states.bits is not None and int(values.max()) < 2**states.bits:
            bits = states.bits
    if page.photometric == _WHITE_IS_ZERO and states.scale is None:
        # What a scale stands for is counted from the stored values: ImageJ inverts only what it shows.
        values = (2**bits - 1 - values).astype(values.dtype)
        changes.append(info("white-is-zero"))
    if stated is not None and stated.linearization is not None:
        table = stated.linearization.clip(0, 65535).astype(np.uint16)
        values, bits = table[np.minimum(values, table.size - 1)], 16
        changes.append(info("linearization-applied"))
    if black is not None:
        changes += pattern_findings(black[1])
    white_dn = None if stated is None else stated.white
    if states.scale is not None:
        zero_dn = states.scale.black_dn(2.0**bits - 1)
        changes.append(states.scale.finding)
        if zero_dn is None or black is not None or states.scale.is_luminance:
            if (share := share_at_end(values, bits)) > 0:
                doubts.append(warning("values-at-end", share=share))
            light = real_numbers(states.scale.values(values), path)
            per_value = 1.0 if states.scale.is_luminance else None
            known = replace(exif, cd_m2_per_value=per_value, changes=tuple(changes), findings=tuple(doubts))
            return as_seen(light, known)
        black = zero_dn, None
    known = replace(
        exif, bits=bits, black=black, white_dn=white_dn, changes=tuple(changes), findings=tuple(doubts)
    ).with_curve(states.curve, _usual_encoding(page, values.ndim == 3))
    return as_seen(np.ascontiguousarray(values), known)


def _resolved(indices: NDArray[Any], page: Any) -> tuple[NDArray[Any], int]:
    """Colours of a palette, and their bits."""
    palette = np.asarray(page.colormap, dtype=np.uint16)
    high, low = palette >> 8, palette & 255
    bits = 16
    # Many programs spread 8 bits over the 16 of the format, times 257 or 256, or do not spread them.
    if not high.any():
        palette, bits = low.astype(np.uint8), 8
    elif np.array_equal(low, high) or not low.any():
        palette, bits = high.astype(np.uint8), 8
    return np.moveaxis(palette[:, indices.astype(np.intp)], 0, -1), bits


def _usual_encoding(page: Any, coloured: bool) -> Encoding:
    """Colours of 8 bits, and those with a profile that does not tell the curve, are made for screens."""
    eight = page.bitspersample <= 8
    return "srgb" if coloured and (eight or _ICC_PROFILE in page.tags) else "linear"
