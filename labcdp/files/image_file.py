"""Grey TIFF and PNG files as frames, where it is known what their values are."""

from __future__ import annotations

from datetime import UTC, datetime
from os import PathLike
from pathlib import Path
from typing import Protocol

from ..core.errors import InputError
from ..core.frame import Frame
from .file_frame import FileDefaults, FileFrame, camera_of, exposure_of, picture_bytes
from .formats.png_jpeg import PNG, read_png
from .formats.stored_image import MAX_PIXELS
from .formats.tiff import TIFF, read_tiff

#: Endings of the names of the files this module reads.
IMAGE_SUFFIXES = (".tif", ".tiff", ".png")


class Layout(Protocol):
    """What an image file's numbers are; a GenICam pixel format says it."""

    @property
    def name(self) -> str:
        """PFNC name."""

    @property
    def bit_depth(self) -> int:
        """Bits of the DN scale."""

    @property
    def colour_filter(self) -> str | None:
        """Bayer pattern, or None."""


def read_image(path: str | PathLike[str], layout: Layout, defaults: FileDefaults) -> FileFrame:
    """Read a grey TIFF or PNG of 8 or 16 bits whose values are the DN of a sensor.

    Parameters
    ----------
    path : path
        The file.
    layout : Layout
        Bit depth, which a file of 16 bits does not state, and colour filter. A pixel is saturated at the highest DN.
    defaults : FileDefaults
        What counts where the file does not say.

    Raises
    ------
    InputError
        If the file cannot be read, is damaged, coloured or of another depth, has DN beyond `layout`, or does not say
        its exposure.
    """
    path = Path(path)
    data, sha256 = picture_bytes(path, MAX_PIXELS)
    if data.startswith(PNG):
        stored = read_png(data, path, MAX_PIXELS)
    elif data.startswith(TIFF):
        stored = read_tiff(data, path, MAX_PIXELS)
    else:
        raise InputError(f"{path} is neither a TIFF nor a PNG file: give one of these, or a camera RAW file")
    kind = "of floats" if stored.bits is None else f"of {stored.bits} bits"
    if stored.coloured or stored.bits not in (8, 16) or stored.changes:
        changes = [one.code.replace("-", " ") for one in stored.changes]
        what = [*(["coloured"] if stored.coloured else []), kind, *changes]
        raise InputError(f"{path} is {', '.join(what)}: give a grey image of 8 or 16 bits, one number a pixel")
    dn, facts = stored.values, stored.facts
    largest = 2**layout.bit_depth - 1
    if dn.max() > largest:
        raise InputError(
            f"{path} has values up to {dn.max()}, the pixel format {layout.name} ends at {largest}: correct "
            "plan.pixel_format, which says how many bits the values have"
        )
    dn.flags.writeable = False
    gain_db = facts.gain_db
    frame = Frame(
        dn=dn,
        exposure_s=exposure_of(path, facts.exposure_s, defaults),
        gain_db=defaults.gain_db if gain_db is None else gain_db,
        bit_depth=layout.bit_depth,
        saturation_dn=float(largest),
        black_level_dn=None,
        pixel_format=layout.name,
        colour_filter=layout.colour_filter,
        temperature_c=None,
        timestamp=facts.taken or datetime.fromtimestamp(path.stat().st_mtime, UTC),
        camera_timestamp_ns=0,
        frame_id=0,
        camera=camera_of(facts.vendor, facts.model, facts.serial, defaults.camera),
    )
    return FileFrame(
        path, frame, facts.f_number, facts.focal_length_m, sha256, facts.exposure_s is not None, bool(facts.model)
    )
