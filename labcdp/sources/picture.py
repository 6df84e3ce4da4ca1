"""Pictures: image files of many kinds as frames of DN, or as floats."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..frame import CameraIdentity, Frame
from ..luminance import LuminanceMap
from . import exr_picture, jpeg_picture, npy_picture, png_picture, tiff_picture
from .colour import luminance_dn
from .dump_picture import read_dump
from .exr_layout import require_whole
from .file_frame import FileDefaults, camera_of, read_bytes
from .luminance_file import FORMAT as LUMINANCE
from .luminance_file import read_luminance
from .picture_frame import NO_EXPOSURE_S, UNKNOWN_CAMERA, frame_of_pixels, make_frame, scale_of
from .picture_options import PictureOptions
from .picture_paths import DUMP_SUFFIXES, RAW_SUFFIXES, STATED_SUFFIXES, picture_paths
from .raw import read_raw
from .saturation import Scale
from .stored_image import Encoding, StoredImage
from .told_options import as_told

__all__ = ["Picture", "PictureOptions", "frame_of_pixels", "picture_paths", "read_picture"]

#: Bytes of a pixel at the most, four doubles, and of what else may be in a file.
_PIXEL_BYTES, _OTHER_BYTES = 32, 64_000_000
_ZIP = b"PK\x03\x04"
#: Readers by the first bytes of a file.
_READERS: dict[bytes, Callable[[bytes, Path, int], StoredImage]] = {
    png_picture.SIGNATURE: png_picture.read_png,
    jpeg_picture.SIGNATURE: jpeg_picture.read_jpeg,
    exr_picture.SIGNATURE: exr_picture.read_exr,
    npy_picture.SIGNATURE: npy_picture.read_npy,
}
#: Options of files that say all that is needed.
NOTHING_KNOWN = PictureOptions()


@dataclass(frozen=True, eq=False)
class Picture:
    """An image file that was read.

    Parameters
    ----------
    path : Path
        The file.
    sha256 : str
        Hash of its bytes.
    frame : Frame or None
        DN, grey or behind a Bayer pattern; of colours, linear luminance in 65535ths of white. None for floats.
    light : ndarray of float32, shape (height, width), or None
        Values of a file of floats, None for integers.
    light_is_cd_m2 : bool
        Whether the file says that the floats are luminance in cd/m^2.
    encoding : {'linear', 'srgb'}
        How the values of the file follow light, as its kind suggests or as was asked for.
    notes : tuple of str
        What was done with the values, in plain words.
    f_number, focal_length_m : float or None
        Setting of the lens, None where the file does not say.
    exposure_stated, camera_stated : bool
        Whether the file itself says exposure and camera.
    exposure_known : bool
        Whether the file or the options say the exposure; if not, `frame.exposure_s` means nothing.
    coloured : bool
        Whether `frame` was made of colours; then it is linear, whatever `encoding`.
    clipped : ndarray of bool, shape (height, width), or None
        Of colours: pixels of which a colour is at its highest value.
    warnings : tuple of str
        What a person gave explicitly that the file contradicts, or that cannot count for it.
    luminance : LuminanceMap or None
        The whole map of a file that labcdp wrote as luminance, with uncertainty and flags.
    """

    path: Path
    sha256: str
    frame: Frame | None
    light: NDArray[np.float32] | None
    light_is_cd_m2: bool
    encoding: Encoding
    notes: tuple[str, ...]
    f_number: float | None
    focal_length_m: float | None
    exposure_stated: bool
    camera_stated: bool
    exposure_known: bool = False
    coloured: bool = False
    clipped: NDArray[np.bool_] | None = None
    luminance: LuminanceMap | None = None
    warnings: tuple[str, ...] = ()

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""
        values = self.light if self.frame is None else self.frame.dn
        assert values is not None
        return values.shape[0], values.shape[1]


def read_picture(path: str | PathLike[str], options: PictureOptions = NOTHING_KNOWN) -> Picture:
    """Read an image file.

    PNG, JPEG, TIFF, OpenEXR, NumPy arrays, camera RAW, raw dumps (with size and pixel format), frames that labcdp
    recorded and luminance that it saved. What a file is, its bytes say, not its name; grey values stay as they are
    stored, and no integer loses bits.

    Parameters
    ----------
    path : path
        The file.
    options : PictureOptions
        What counts where the file does not say, and of that what a person gave, which counts in any case.

    Raises
    ------
    InputError
        If it cannot be read, is damaged, no image, too large, or of a kind that is not read; in one line.
    """
    path = Path(path)
    _require_file(path, options)
    data, sha256 = read_bytes(path)
    suffix = path.suffix.lower()
    if options.size is not None and suffix not in STATED_SUFFIXES:
        if options.pixel_format is None:
            raise InputError(f"{path} is a raw dump: give its pixel format too, for example Mono12Packed")
        stored = read_dump(data, path, options.size, options.pixel_format, options.max_pixels)
        return _picture(stored, path, sha256, options)
    own = _from_labcdp(data, sha256, path, options.max_pixels)
    if own is not None:
        return as_told(own, options, None if own.frame is None else own.frame.bit_depth)
    is_tiff = data.startswith(tiff_picture.SIGNATURES)
    if is_tiff and suffix not in RAW_SUFFIXES and not tiff_picture.is_of_a_sensor(data):
        return _picture(tiff_picture.read_tiff(data, path, options.max_pixels), path, sha256, options)
    for signature, read in _READERS.items():
        if data.startswith(signature):
            return _picture(read(data, path, options.max_pixels), path, sha256, options)
    if is_tiff or suffix in RAW_SUFFIXES:
        return _from_raw(path, sha256, options)
    raise InputError(_not_known(path))


def _require_file(path: Path, options: PictureOptions) -> None:
    try:
        size = path.stat().st_size
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): give a file you can read") from error
    if not path.is_file():
        raise InputError(f"{path} is no file: give an image file")
    if size > _PIXEL_BYTES * options.max_pixels + _OTHER_BYTES:
        raise InputError(
            f"{path} has {size / 1e9:.3g} GB, more than a picture of {options.max_pixels / 1e6:g} megapixels takes: "
            "give an image file, or raise the limit"
        )


def _not_known(path: Path) -> str:
    if path.suffix.lower() in DUMP_SUFFIXES:
        return (
            f"{path} does not say what it is: for a raw dump give its size and pixel format, for example Mono12Packed"
        )
    return (
        f"{path} is no image that labcdp reads: give PNG, JPEG, TIFF, OpenEXR, NPY, camera RAW, or a raw dump with its "
        "size"
    )


def _from_labcdp(data: bytes, sha256: str, path: Path, max_pixels: int) -> Picture | None:
    """Read what labcdp wrote, a recorded frame or luminance; return None for any other file."""
    if data.startswith(_ZIP):
        # Of archives these are the only ones that are read.
        return _from_luminance(data, sha256, path, max_pixels)
    text: dict[str, Any] | None = None
    if data.startswith(tiff_picture.SIGNATURES):
        text = tiff_picture.tiff_text(data)
    elif data.startswith(exr_picture.SIGNATURE):
        require_whole(data, path, max_pixels)
        text = exr_picture.exr_text(path, max_pixels)
    if text is None:
        return None
    if text.get("format") == LUMINANCE:
        return _from_luminance(data, sha256, path, max_pixels)
    if not {"exposure_s", "saturation_dn", "camera"} <= set(text):
        return None
    stored = tiff_picture.read_tiff(data, path, max_pixels)
    try:
        frame = Frame.from_metadata(stored.values, text)
    except InputError as error:
        raise InputError(f"{path} is not a frame recorded by labcdp ({error})") from error
    return Picture(path, sha256, frame, None, False, "linear", (), None, None, True, True, exposure_known=True)


def _from_luminance(data: bytes, sha256: str, path: Path, max_pixels: int) -> Picture:
    luminance, _ = read_luminance(data, path, max_pixels)
    light = np.asarray(luminance.luminance_cd_m2, dtype=np.float32)
    return Picture(
        path, sha256, None, light, True, "linear", ("luminance that labcdp saved",), None, None, True, True,
        exposure_known=True, luminance=luminance,
    )  # fmt: skip


def _from_raw(path: Path, sha256: str, options: PictureOptions) -> Picture:
    defaults = FileDefaults(
        options.exposure_s or NO_EXPOSURE_S, options.gain_db or 0.0, options.camera or UNKNOWN_CAMERA
    )
    taken = read_raw(path, defaults, options.max_pixels)
    picture = Picture(
        path, sha256, taken.frame, None, False, "linear", (), taken.f_number, taken.focal_length_m,
        taken.exposure_stated, taken.camera_stated,
        exposure_known=taken.exposure_stated or options.exposure_s is not None,
    )  # fmt: skip
    return as_told(picture, options, taken.frame.bit_depth)


def _picture(stored: StoredImage, path: Path, sha256: str, options: PictureOptions) -> Picture:
    facts = stored.facts
    encoding = options.encoding or stored.encoding
    picture = Picture(
        path, sha256, None, None, stored.cd_m2_per_value is not None, encoding, (*stored.notes, *stored.doubts),
        facts.f_number, facts.focal_length_m, facts.exposure_s is not None, bool(facts.model),
        exposure_known=(facts.exposure_s or options.exposure_s) is not None,
    )  # fmt: skip
    if stored.bits is None:
        factor = np.float32(stored.cd_m2_per_value or 1.0)
        return as_told(replace(picture, light=stored.values * factor, encoding="linear"), options, None)
    known = replace(
        options,
        exposure_s=facts.exposure_s or options.exposure_s,
        gain_db=options.gain_db if facts.gain_db is None else facts.gain_db,
        camera=_camera(stored, options),
    )
    taken = facts.taken or datetime.fromtimestamp(path.stat().st_mtime, UTC)
    scale = scale_of(stored.values, stored.bits, options, str(path))
    notes = (*picture.notes, *scale.notes)
    if not stored.coloured:
        picture = replace(picture, frame=make_frame(stored.values, scale, known, taken), notes=notes)
        return as_told(picture, options, scale.bits)
    dn = luminance_dn(stored.values, scale.bits, encoding)
    how = f"colour to grey ({'sRGB decoded, ' if encoding == 'srgb' else ''}ITU-R BT.709 luminance)"
    picture = replace(
        picture,
        frame=make_frame(dn, Scale(16, 65535.0), replace(known, pixel_format=None, saturation_dn=None), taken),
        notes=(*notes, how),
        coloured=True,
        clipped=np.any(stored.values >= scale.saturation_dn, axis=2),
    )
    return as_told(picture, options, scale.bits)


def _camera(stored: StoredImage, options: PictureOptions) -> CameraIdentity:
    facts, known = stored.facts, options.camera or UNKNOWN_CAMERA
    return camera_of(facts.vendor, facts.model, facts.serial, known)
