"""FileFrame: a frame that another program recorded, with the metadata of its file."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from os import PathLike
from pathlib import Path

from ..core.disk import read_bytes
from ..core.errors import InputError
from ..core.frame import CameraIdentity, Frame
from ..core.pixel_format import PixelFormat
from .png_jpeg import PNG, read_png
from .stored_image import MAX_PIXELS
from .tiff import TIFF, read_tiff

#: Bytes of a pixel at the most, four doubles, and of what else may be in a file.
_PIXEL_BYTES, _OTHER_BYTES = 32, 64_000_000


@dataclass(frozen=True)
class FileDefaults:
    """What a file is taken to be where it does not say.

    Parameters
    ----------
    exposure_s : float or None
        Exposure time; None if the file has to say it.
    gain_db : float
        Gain.
    camera : CameraIdentity
        Vendor, model and serial number; each counts where the file has none.
    """

    exposure_s: float | None
    gain_db: float
    camera: CameraIdentity


@dataclass(frozen=True, eq=False)
class FileFrame:
    """A frame from a file.

    Parameters
    ----------
    path : Path
        The file.
    frame : Frame
        Its pixels, DN as stored.
    f_number, focal_length_m : float or None
        Setting of the lens, None where the file does not say.
    sha256 : str
        Hash of the file's bytes; two files are the same picture if it is equal.
    exposure_stated, camera_stated : bool
        Whether the file says exposure and camera.
    clips_at_dn : float or None
        DN below its saturation from which the pixels are clipped, by their histogram.
    """

    path: Path
    frame: Frame
    f_number: float | None
    focal_length_m: float | None
    sha256: str
    exposure_stated: bool = True
    camera_stated: bool = True
    clips_at_dn: float | None = None

    def numbered(self, frame_id: int) -> FileFrame:
        """Return the same with another number of the frame."""
        return replace(self, frame=replace(self.frame, frame_id=frame_id))


def picture_bytes(path: Path, max_pixels: int) -> tuple[bytes, str]:
    """Bytes of a file, and their SHA-256; raises InputError if it cannot be read, is empty, or too large."""
    data = read_bytes(path, "an image file", _PIXEL_BYTES * max_pixels + _OTHER_BYTES)
    if not data:
        raise InputError(f"{path} is empty: copy it again from the camera")
    return data, hashlib.sha256(data).hexdigest()


def exposure_of(path: Path, stated_s: float | None, defaults: FileDefaults) -> float:
    """Exposure time of a file: as stated in it, else as given.

    Raises
    ------
    InputError
        If neither says it.
    """
    exposure_s = stated_s or defaults.exposure_s
    if exposure_s is None:
        raise InputError(f"{path} does not state its exposure time: give it with --exposure, in seconds")
    return exposure_s


def camera_of(vendor: str, model: str, serial: str, known: CameraIdentity) -> CameraIdentity:
    """Identity as a file states it; what it leaves empty is taken from what is known of the camera."""
    stated = replace(known, vendor=vendor or known.vendor, model=model or known.model, serial=serial or known.serial)
    # Only the known camera is simulated, not another that the file states.
    return stated if stated == known else replace(stated, simulated=False)


#: Endings of the names of the files this module reads.
IMAGE_SUFFIXES = (".tif", ".tiff", ".png")


def read_image(path: str | PathLike[str], layout: PixelFormat, defaults: FileDefaults) -> FileFrame:
    """Read a grey TIFF or PNG of 8 or 16 bits whose values are the DN of a sensor.

    Parameters
    ----------
    path : path
        The file.
    layout : PixelFormat
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
