"""A frame as a TIFF file that any image program opens."""

from __future__ import annotations

import json
from io import BytesIO
from pathlib import Path

from ..core.disk import parse_json, reason
from ..core.disk.tiff import open_tiff, pixels_of
from ..core.errors import InputError, SessionError
from ..core.frame import Frame

#: What messages call the file, which the session names itself.
_IT = Path("it")


def frame_to_tiff(frame: Frame, compress: bool) -> memoryview:
    """Make the bytes of a one-page grey TIFF with the frame's own depth, 8 or 16 bit.

    Parameters
    ----------
    frame : Frame
        The frame; its ``metadata()`` goes into the tag ImageDescription as JSON.
    compress : bool
        Whether to compress without loss (zlib, TIFF compression 8), about half the size and 15 times the time.

    Raises
    ------
    InputError
        If the metadata has a value JSON does not have.
    """
    import tifffile

    try:
        description = json.dumps(frame.metadata(), allow_nan=False)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"the metadata of frame {frame.frame_id} cannot be written as JSON ({error}): give text and finite numbers"
        ) from error
    file = BytesIO()
    tifffile.imwrite(
        file,
        frame.dn,
        byteorder="<",
        photometric="minisblack",
        compression="zlib" if compress else None,
        description=description,
        metadata=None,
        software="labcdp",
    )
    # Not a copy: a frame has megabytes.
    return file.getbuffer()


def frame_from_tiff(data: bytes, source: str) -> Frame:
    """Make the frame of what `frame_to_tiff` made, bit for bit; messages call it `source`.

    Raises
    ------
    SessionError
        If it is a TIFF, but not one of labcdp's frames.
    """
    try:
        with open_tiff(data, _IT) as tiff:
            page = tiff.pages.first
            dn = pixels_of(page, _IT)
            metadata = parse_json(page.description)
        return Frame.from_metadata(dn.astype(dn.dtype.newbyteorder("="), copy=False), metadata)
    except InputError as error:
        raise SessionError(f"{source} is not a frame recorded by labcdp ({reason(error)})") from error


def frame_file_name(number: int, role: str, exposure_s: float) -> str:
    """Name of a frame's file, for example ``0001_light_5ms.tif``."""
    unit, scale = next(
        (unit, scale)
        for unit, scale in (("s", 1.0), ("ms", 1e3), ("us", 1e6))
        if exposure_s * scale >= 1 or unit == "us"
    )
    return f"{number:04d}_{role}_{exposure_s * scale:.6g}{unit}.tif"
