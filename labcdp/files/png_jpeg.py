"""PNG and JPEG files, NumPy arrays and raw dumps: values as stored, with what their EXIF says."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.disk import quoted
from ..core.disk.arrays import npy_header, parse_npy
from ..core.disk.files import damage_reported
from ..core.dn import pixel_format
from ..core.errors import InputError, naming
from ..core.result import Finding, info, warning
from .exif import read_exif
from .kinds import PNG
from .statements import (
    NOTHING_STATED,
    FileStatements,
    exif_colours,
    stated_by_exif,
    stated_by_png,
    stated_by_profile,
)
from .stored_image import (
    SCREEN_BITS,
    Stored,
    as_seen,
    decoder_messages,
    real_numbers,
    require_size,
    whole_numbers,
    without_alpha,
)

#: The last chunk with its check.
_PNG_END = b"IEND\xaeB`\x82"
#: Colour types (ISO/IEC 15948:2004, table 11.1).
_GREY, _PALETTE, _GREY_ALPHA = 0, 3, 4


def read_png(data: bytes, path: Path, max_pixels: int) -> Stored:
    """Read a PNG of any kind, without its transparency.

    Raises
    ------
    InputError
        If it is truncated, damaged, larger than `max_pixels`, or holds several pictures.
    """
    import imagecodecs
    from PIL.PngImagePlugin import PngImageFile

    with damage_reported(f"{path} cannot be read as PNG", ": if another program opens it, save it there again"):
        header = PngImageFile(BytesIO(data))
        require_size(path, *header.size, max_pixels)
        if getattr(header, "n_frames", 1) > 1:
            raise InputError(
                f"{path} is an animated PNG of {header.n_frames} pictures, which labcdp does not read: give a PNG of "
                "each, or convert it to a video (ffmpeg -i IN -c:v ffv1 OUT.mkv)"
            )
        if _PNG_END not in data:
            raise InputError(f"{path} is truncated: it has no end mark in {len(data)} bytes: copy or save it again")
        values = imagecodecs.png_decode(data)
    depth, colour_type = data[24], data[25]
    values, bits, changes = _resolved(values, depth, colour_type)
    coloured, (chunks, behind) = values.ndim == 3, _chunks(data)
    exif = stated_by_exif(bits, **exif_colours(header))
    # Pillow leaves out a profile that is not whole.
    profile = header.info.get("icc_profile") or (b"" if b"iCCP" in chunks else None)
    curve = stated_by_png(chunks, behind, profile, exif, coloured, bits)
    doubts = [warning("png-calibration-not-used")] if b"pCAL" in {*chunks, *behind} else []
    if curve.stated_by == "its chunk cICP" and chunks[b"cICP"][3] == 0:
        if bits >= SCREEN_BITS:
            values, changes = _full_range(values, bits), (*changes, info("limited-range"))
        else:
            doubts.append(warning("chunk-not-used", name="cICP", reason="a limited range needs 8 bits or more"))
    # Fewer significant bits are the upper ones (PNG third edition, 11.3.2.7).
    used = min(chunks.get(b"sBIT", b"")[: 3 if coloured else 1], default=bits)
    is_full = bits == 16 and 8 <= used < bits and int(values.max()) >= 2**used
    white_dn = float(2**bits - 2 ** (bits - used)) if is_full else None
    statements = replace(
        _exif(header, path), bits=bits, white_dn=white_dn, changes=changes, findings=tuple(doubts)
    ).with_curve(curve, "srgb" if coloured else "linear")
    return as_seen(values, statements)


def _exif(header: Any, path: Path) -> FileStatements:
    from PIL import ExifTags

    block = header.info.get("exif")
    stated = (
        read_exif(block.removeprefix(b"Exif\0\0"), path, whole=False) if isinstance(block, bytes) else NOTHING_STATED
    )
    try:
        # Of PNG some programs write EXIF as a text (ImageMagick), or the orientation as XMP.
        orientation = header.getexif().get(ExifTags.Base.Orientation, 1)
    # A damaged block raises what its parts do.
    except Exception:
        return stated
    return (
        replace(stated, orientation=orientation) if stated.orientation == 1 and orientation in range(1, 9) else stated
    )


def _resolved(values: NDArray[Any], depth: int, colour_type: int) -> tuple[NDArray[Any], int, tuple[Finding, ...]]:
    """Values as the file means them, of what libpng returns: fewer than 8 bits are spread over 8."""
    changes: list[Finding] = []
    bits = 8 if colour_type == _PALETTE else depth
    if values.ndim == 3 and values.shape[2] in (2, 4):
        values, change = without_alpha(values, 2 ** max(bits, 8) - 1)
        changes.append(change)
    if colour_type == _PALETTE:
        changes.append(info("palette-resolved"))
    if bits < 8:
        values = values // (255 // (2**bits - 1))
    return np.ascontiguousarray(values), bits, tuple(changes)


def _chunks(data: bytes) -> tuple[dict[bytes, bytes], set[bytes]]:
    """Chunks before the pixels by name, of which the first of a name counts, and names of those behind them."""
    chunks: dict[bytes, bytes] = {}
    behind: set[bytes] = set()
    at, in_front = len(PNG), True
    while at + 8 <= len(data):
        size, name = int.from_bytes(data[at : at + 4], "big"), data[at + 4 : at + 8]
        in_front = in_front and name != b"IDAT"
        if in_front:
            chunks.setdefault(name, data[at + 8 : at + 8 + size])
        else:
            behind.add(name)
        at += 12 + size
    return chunks, behind


def _full_range(values: NDArray[Any], bits: int) -> NDArray[Any]:
    """Values of limited range, 16 to 235 of 8 bits, spread over all of it (ITU-T H.273, 8.3)."""
    top = 2**bits - 1
    spread = (values / 2 ** (bits - 8) - 16) * top / 219
    return np.asarray(np.rint(spread.clip(0, top)), values.dtype)


#: Markers (ITU-T T.81, table B.1): end, scan; those without a length, RST0 to SOI and TEM.
_JPEG_END, _SCAN, _ALONE = 0xD9, 0xDA, (*range(0xD0, 0xD9), 0x01)
#: Kinds of coding by the marker of a frame (table B.1; JPEG-LS: ITU-T T.87) that FFmpeg and libjpeg decode; others.
_HUFFMAN = (0xC0, 0xC1, 0xC2)
_RARE = {
    0xC3: "lossless JPEG", 0xF7: "JPEG-LS", **dict.fromkeys((0xC5, 0xC6, 0xC7), "hierarchical JPEG"),
    **dict.fromkeys((0xC9, 0xCA, 0xCB, 0xCD, 0xCE, 0xCF), "arithmetic-coded JPEG"),
}  # fmt: skip
#: Marker of the frame of a progressive JPEG; that of segments with an ICC profile, and how these begin.
_PROGRESSIVE, _APP2, _PROFILE = 0xC2, 0xE2, b"ICC_PROFILE\0"
#: More bits than a coefficient has.
_NOTHING = 16
#: What files with a gain map for brighter displays hold (Ultra HDR; ISO 21496-1).
_GAIN_MAPS = (b"http://ns.adobe.com/hdr-gain-map/1.0/", b"urn:iso:std:iso:ts:21496:-1")
_TO_TIFF = "which labcdp does not read: convert it to 16-bit TIFF"


def read_jpeg(data: bytes, path: Path, max_pixels: int) -> Stored:
    """Read a JPEG of 8 bits, grey or coloured; of several pictures, or one with a film behind it, the first picture.

    Raises
    ------
    InputError
        If it is truncated, damaged, larger than `max_pixels`, or of a kind with more than 8 bits or four colours.
    """
    import cv2
    from PIL.JpegImagePlugin import JpegImageFile

    whole, kind, segments = data, None, tuple(_jpeg_segments(data))
    for marker, at in segments:
        if marker in (*_HUFFMAN, *_RARE) and kind is None:
            kind = _RARE.get(marker) or (f"JPEG of {data[at + 4]} bits" if data[at + 4 : at + 5] > b"\x08" else "")
        # What follows, such as a film or a second picture, is not of it.
        data = data[: at + 2] if marker == _JPEG_END else data
    if kind:
        raise InputError(f"{path} is {kind}, {_TO_TIFF}")
    with damage_reported(f"{path} cannot be read as JPEG", ": if another program opens it, convert it to PNG"):
        header = JpegImageFile(BytesIO(data))
    require_size(path, *header.size, max_pixels)
    if header.mode not in ("L", "RGB"):
        raise InputError(f"{path} has {header.mode} colours, as used for printing: save it as grey or RGB")
    if data[-2:] != bytes((0xFF, _JPEG_END)):
        raise InputError(f"{path} is truncated: it has no end mark in {len(whole)} bytes: copy it again")
    # Pillow does not say what libjpeg has to say of damage.
    with decoder_messages() as messages:
        values = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION)
    if values is None or values.shape[:2] != header.size[::-1] or values.dtype != np.uint8:
        raise InputError(
            f"{path} cannot be decoded as JPEG: if another program opens it, convert it to PNG; otherwise copy it again"
        )
    values = values if values.ndim == 2 else np.ascontiguousarray(values[..., ::-1])
    doubts = [warning("decoder-message", message=message) for message in messages]
    if any(mark in data for mark in _GAIN_MAPS):
        doubts.append(info("gain-map-not-used"))
    if _scans_are_missing(data, segments):
        doubts.append(warning("jpeg-scans-missing"))
    profile = header.info.get("icc_profile")
    # Pillow gives nothing of a profile that is not whole.
    if profile is None and any(_is_profile(data, marker, at) for marker, at in segments):
        doubts.append(warning("icc-profile-not-used", reason="parts of it are missing"))
    curve = stated_by_profile(profile, values.ndim == 3, 8)
    if not curve.states_curve:
        of_exif = stated_by_exif(8, **exif_colours(header))
        curve = replace(of_exif, findings=(*of_exif.findings, *curve.findings))
    statements = replace(
        _exif(header, path), bits=8, is_settled=True, changes=(info("jpeg-compressed"),), findings=tuple(doubts)
    )
    return as_seen(values, statements.with_curve(curve, "srgb"))


def _jpeg_segments(data: bytes) -> Iterator[tuple[int, int]]:
    """Marker and place of each segment up to the end mark, or where the data stop being such (ITU-T T.81, B.1)."""
    at = 2
    # What no marker begins is passed over, as by other readers.
    while 0 < (at := data.find(b"\xff", at)) < len(data) - 1:
        marker = data[at + 1]
        if marker == 0xFF:
            # Markers may be filled up.
            at += 1
            continue
        yield marker, at
        if marker == _JPEG_END:
            return
        at += 2 if marker in _ALONE else 2 + int.from_bytes(data[at + 2 : at + 4], "big")
        if marker == _SCAN:
            # In coded data, 0xFF is followed by 0 or the marker of a restart.
            marker_at = _IN_SCAN.search(data, at)
            at = len(data) if marker_at is None else marker_at.start()


def _is_profile(data: bytes, marker: int, at: int) -> bool:
    """Whether a segment holds a part of an ICC profile (ICC.1:2022, annex B.4)."""
    return marker == _APP2 and data.startswith(_PROFILE, at + 4)


def _scans_are_missing(data: bytes, segments: Sequence[tuple[int, int]]) -> bool:
    """Whether a progressive JPEG ends before each coefficient came with all its bits (ITU-T T.81, G.1.1 and B.2.3).

    Decoders show what there is, without a message.
    """
    frame = next((at for marker, at in segments if marker in _HUFFMAN), None)
    if frame is None or data[frame + 1] != _PROGRESSIVE:
        return False
    # Bits that are still to come, of each coefficient of each component; nothing came yet.
    names = data[frame + 10 :: 3][: data[frame + 9]]
    left = np.full((len(names), 64), _NOTHING)
    for at in (at for marker, at in segments if marker == _SCAN):
        n = data[at + 4]
        first, last, bits = data[at + 5 + 2 * n : at + 8 + 2 * n]
        for name in data[at + 5 : at + 5 + 2 * n : 2]:
            left[names.find(name), first : last + 1] = bits & 15
    return bool(left.any())


#: A marker that ends a scan.
_IN_SCAN = re.compile(rb"\xff+[^\x00\xd0-\xd7\xff]")


def read_npy(data: bytes, path: Path, max_pixels: int) -> Stored:
    """Read a 2-D array of whole or real numbers.

    Raises
    ------
    InputError
        If it is truncated or damaged, has another number of dimensions, holds something else than real numbers, or is
        larger than `max_pixels`.
    """
    with naming(path):
        header = npy_header(data)
        shape, dtype = header.shape, header.dtype
        if len(shape) != 2:
            raise InputError(
                f"it is an array of shape {quoted(shape)}: give a 2-D array, one value a pixel; of colours, or of "
                "several pictures, save one"
            )
        if dtype.kind not in "buif" or dtype.itemsize > 8:
            raise InputError(f"it holds {dtype}: give an array of whole numbers (DN) or floats")
        require_size(path, shape[1], shape[0], max_pixels)
        values = parse_npy(data)
    if dtype.kind == "f":
        return real_numbers(values, path), NOTHING_STATED
    dn, bits, changes = whole_numbers(values, path)
    return np.ascontiguousarray(dn), FileStatements(bits=bits, changes=changes, is_settled=True)


def read_dump(data: bytes, path: Path, size: tuple[int, int], format_name: str, max_pixels: int) -> Stored:
    """Read pixels that fill a file from its first byte to its last.

    Parameters
    ----------
    data : bytes
        The file.
    path : Path
        For messages.
    size : (int, int)
        Width and height in pixels.
    format_name : str
        GenICam pixel format, for example ``Mono12Packed``.
    max_pixels : int
        Limit.

    Raises
    ------
    InputError
        If the pixel format is not known, or the file has another length than such an image.
    """
    width, height = size
    require_size(path, width, height, max_pixels)
    layout = pixel_format(format_name)
    needed = layout.payload_bytes(width * height)
    if len(data) != needed:
        raise InputError(
            f"{path} has {len(data)} bytes, {width} x {height} pixels of {layout.name} take {needed}: give the size "
            "and the pixel format it was written with"
        )
    dn = layout.unpack(np.frombuffer(data, np.uint8), (height, width))
    dn = dn.astype(dn.dtype.newbyteorder("="), copy=False)
    if int(dn.max()) >= 2**layout.bit_depth:
        raise InputError(
            f"{path} has values up to {dn.max()}, {layout.name} ends at {2**layout.bit_depth - 1}: give the pixel "
            "format it was written with"
        )
    return dn, FileStatements(bits=layout.bit_depth, is_settled=True)
