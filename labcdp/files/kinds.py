"""What a file is by its first bytes, for messages about files that a reader is not for."""

from __future__ import annotations

import re

from ..core.errors import InputError

#: How files that labcdp reads begin.
PNG, JPEG, NPY, EXR, ZIP = b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"\x93NUMPY", b"\x76\x2f\x31\x01", b"PK\x03\x04"
TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
#: Brands of ISO base media files that hold photographs, or sequences of them (ISO/IEC 23008-12, and AVIF).
_PHOTOGRAPHS = {
    b"heic": "HEIC", b"heix": "HEIC", b"heim": "HEIC", b"heis": "HEIC", b"hevc": "HEIC", b"hevx": "HEIC",
    b"mif1": "HEIF", b"mif2": "HEIF", b"msf1": "HEIF", b"avif": "AVIF", b"avis": "AVIF", b"jpeg": "HEIF",
}  # fmt: skip
#: Pictures that labcdp does not read, by how they begin.
_UNREAD: tuple[tuple[bytes, str], ...] = (
    (rb"RIFF.{4}WEBP", "WebP"), (rb"\xff\x0a|\x00\x00\x00\x0cJXL ", "JPEG XL"),
    (rb"\x00\x00\x00\x0cjP|\xff\x4f\xff\x51", "JPEG 2000"),
    (rb"II\xbc", "JPEG XR"), (rb"8BP[SB]", "Photoshop"), (rb"gimp xcf", "GIMP"), (rb"BM.{4}\x00\x00\x00\x00", "BMP"),
    (rb"\x00\x00[\x01\x02]\x00[\x01-\xff]\x00", "icon"), (rb"DDS ", "DDS"),
    (rb"P[1-7][\s#]", "PNM"), (rb"P[fF]\s", "PFM"), (rb"\x0a[\x00-\x05]\x01[\x01\x08]", "PCX"),
    (rb"#\?(RADIANCE|RGBE)", "Radiance HDR"), (rb"SIMPLE  =", "FITS"), (rb".{128}DICM", "DICOM"),
    (rb"\x01\xda[\x00\x01]", "SGI"),
    (rb"\x59\xa6\x6a\x95", "Sun raster"), (rb"qoif", "QOI"), (rb"farbfeld", "farbfeld"), (rb"FLIF", "FLIF"),
    (rb"BPG\xfb", "BPG"), (rb"\x8aMNG|\x8bJNG", "MNG"), (rb"GIF8[79]a", "GIF"), (rb"%PDF", "PDF"),
    (rb"%!PS", "PostScript"),
    (rb"ZISRAWFILE", "CZI"), (rb"\xd7\xcd\xc6\x9a", "WMF"), (rb"<svg", "SVG"), (rb"FLGH|AFF\x00|FFF\x00", "FLIR"),
)  # fmt: skip
#: Pictures that `labcdp image` reads.
_READ: tuple[tuple[bytes, str], ...] = (
    (rb"\x89PNG\r\n\x1a\n", "PNG"), (rb"II[*+]\x00|MM\x00[*+]", "TIFF or camera RAW"),
    (rb"\x76\x2f\x31\x01", "OpenEXR"), (rb"\x93NUMPY", "NumPy"),
    (rb".{4}ftypcrx ", "Canon CR3"), (rb"FUJIFILMCCD-RAW", "Fujifilm RAF"),
)  # fmt: skip
_VIDEOS: tuple[tuple[bytes, str], ...] = (
    (rb".{4}(ftyp|moov|mdat|wide|free|skip|pnot)", "MP4 or QuickTime"), (rb"\x1aE\xdf\xa3", "Matroska or WebM"),
    (rb"RIFF.{4}(AVI |AVIX)", "AVI"), (rb"OggS", "Ogg"), (rb"FLV\x01", "Flash"),
    (rb"\x30\x26\xb2\x75", "Windows Media"),
    (rb"G.{187}G", "MPEG transport stream"), (rb".{4}G.{191}G", "MPEG transport stream"),
    (rb"\x00\x00\x01[\xba\xb3]", "MPEG"),
    (rb"\x06\x0e\x2b\x34\x02\x05", "MXF"), (rb"YUV4MPEG2", "YUV4MPEG"), (rb"DKIF", "IVF"),
    (rb"nut/multimedia", "NUT"),
)  # fmt: skip
#: Bytes that are looked at.
HEAD_BYTES = 1024


def unread_picture(head: bytes) -> str | None:
    """Return the kind of a picture that labcdp does not read, by the first bytes of its file; None for others."""
    if head[4:8] == b"ftyp":
        size = min(max(int.from_bytes(head[:4], "big"), 16), len(head))
        # The first brand is the file's own; a photograph may call itself a compatible one of them only.
        brands = [head[8:12], *(head[at : at + 4] for at in range(16, size - 3, 4))]
        named = next((_PHOTOGRAPHS[brand] for brand in brands[:1] if brand in _PHOTOGRAPHS), None)
        is_video = any(brand[:3] in (b"iso", b"mp4", b"avc", b"qt ", b"M4V") for brand in brands)
        return named or next((_PHOTOGRAPHS[brand] for brand in brands if brand in _PHOTOGRAPHS and not is_video), None)
    return _first(_UNREAD, head)


def _first(kinds: tuple[tuple[bytes, str], ...], head: bytes) -> str | None:
    return next((name for begin, name in kinds if re.match(begin, head, re.DOTALL)), None)


def no_picture(path: object, head: bytes) -> InputError | None:
    """Return the error of a file that no reader of pictures is for; None where its kind is not known."""
    if kind := unread_picture(head):
        return InputError(f"{path} is a {kind} file, which labcdp does not read: convert it to PNG or 16-bit TIFF")
    if kind := _first(_VIDEOS, head):
        return InputError(f"{path} is a video ({kind}), not a picture: evaluate it with labcdp video")
    return None


def no_video(path: object, head: bytes, refused: bool = False) -> InputError | None:
    """Return the error of a file that no reader of videos is for; None where it may be one.

    Motion JPEG begins as a JPEG does: that it is a picture counts where FFmpeg `refused` it.
    """
    if kind := _first(_READ, head) or ("JPEG" if refused and head.startswith(b"\xff\xd8\xff") else None):
        return InputError(f"{path} is a picture ({kind}), not a video: evaluate it with labcdp image")
    kind = unread_picture(head)
    # Of GIF, FFmpeg reads all pictures.
    if kind is None or kind == "GIF":
        return None
    return InputError(
        f"{path} is a {kind} file, which labcdp does not read: convert it to PNG or 16-bit TIFF, and one of several "
        "pictures to a video in FFV1"
    )
