"""JPEG files: values as decoded, with what their EXIF says."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np

from ...core.disk.quoting import reason
from ...core.errors import InputError
from ...core.finding import info, warning
from .decoder_messages import decoder_messages
from .exif import ExifFacts, read_exif
from .stored_image import StoredImage, require_size

SIGNATURE = b"\xff\xd8\xff"
#: Markers of a scan and of the end (ITU-T T.81, table B.1), which do not occur in coded data.
_SCAN, _END = b"\xff\xda", b"\xff\xd9"


def read_jpeg(data: bytes, path: Path, max_pixels: int) -> StoredImage:
    """Read a JPEG of 8 bits, grey or coloured.

    Raises
    ------
    InputError
        If it is truncated, damaged, larger than `max_pixels`, or of a kind with more than 8 bits or four colours.
    """
    import cv2
    from PIL.JpegImagePlugin import JpegImageFile

    try:
        header = JpegImageFile(BytesIO(data))
    # Damaged files raise what the library does.
    except Exception as error:
        raise InputError(f"{path} cannot be read as JPEG ({reason(error)}): copy it again from the camera") from error
    require_size(path, *header.size, max_pixels)
    if header.mode not in ("L", "RGB"):
        raise InputError(f"{path} has the colours {header.mode}, as for print: save it as grey or RGB")
    if data.rfind(_END) < data.rfind(_SCAN):
        raise InputError(f"{path} is truncated: it has no end mark in {len(data)} bytes: copy it again")
    # Pillow does not say what libjpeg has to say of damage.
    with decoder_messages() as messages:
        values = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION)
    if values is None or values.shape[:2] != header.size[::-1] or values.dtype != np.uint8:
        raise InputError(f"{path} cannot be read as JPEG (its data are damaged or of a rare kind): copy it again")
    block = header.info.get("exif")
    facts = read_exif(block.removeprefix(b"Exif\0\0"), path) if isinstance(block, bytes) else ExifFacts()
    values = values if values.ndim == 2 else np.ascontiguousarray(values[..., ::-1])
    doubts = tuple(warning("decoder-message", message=message) for message in messages)
    return StoredImage(values, 8, "srgb", facts, (info("jpeg-compressed"),), doubts).upright()
