"""FileFrame: a frame that another program recorded, with the metadata of its file."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path

from ..core.disk import read_bytes
from ..core.errors import InputError
from ..core.frame import CameraIdentity, Frame

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
