"""Frames of files and videos: what a file says about its pixels, and what is taken where it says little."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.companding import Companding
from ..core.disk import read_bytes
from ..core.dn import PixelFormat, pixel_format
from ..core.errors import InputError, naming
from ..core.frame import BlackPattern, CameraIdentity, Frame
from ..core.result import Finding, info, warning
from .kinds import NPY, PNG, TIFF
from .picture import PictureFile, PictureOptions
from .statements import FileStatements
from .stored_image import INTEGERS, MAX_PIXELS

#: Bytes of a pixel at the most, four doubles, and of what else may be in a file.
_PIXEL_BYTES, _OTHER_BYTES = 32, 64_000_000
#: Exposure of pictures without one; relative luminance does not depend on it.
NO_EXPOSURE_S = 1.0
#: Camera of pictures without one.
UNKNOWN_CAMERA = CameraIdentity("unknown", "unknown", "unknown")


@dataclass(frozen=True, eq=False)
class FileFrame(PictureFile):
    """A frame from a file.

    Parameters
    ----------
    path, sha256, statements
        As of `PictureFile`.
    frame : Frame
        Its pixels, DN as stored.
    clips_at_dn : float or None
        DN below its saturation from which the pixels are clipped, by their histogram.
    findings : tuple of Finding
        What the file states of its values and what was made of it.

    Examples
    --------
    >>> import cv2
    >>> import numpy as np
    >>> from labcdp.core.dn import pixel_format
    >>> from labcdp.files import PictureOptions, read_image
    >>> written = cv2.imwrite("grey.png", np.full((4, 6), 100, np.uint8))
    >>> read_image("grey.png", pixel_format("Mono8"), PictureOptions(exposure_s=0.01)).frame.saturation_dn
    255.0
    """

    frame: Frame
    clips_at_dn: float | None = None
    findings: tuple[Finding, ...] = ()


def picture_bytes(path: Path, max_pixels: int) -> tuple[bytes, str]:
    """Bytes of a file, and their SHA-256; raises InputError if it cannot be read, is empty, or too large."""
    data = read_bytes(path, "an image file", _PIXEL_BYTES * max_pixels + _OTHER_BYTES)
    if not data:
        raise InputError(f"{path} is empty: copy it again from the camera")
    return data, hashlib.sha256(data).hexdigest()


def statements_over(options: PictureOptions, statements: FileStatements) -> PictureOptions:
    """Options with what a file says of exposure, gain and camera in place of what is given."""
    known = options.camera or UNKNOWN_CAMERA
    parts = ("vendor", "model", "serial")
    stated = replace(known, **{name: getattr(statements, name) or getattr(known, name) for name in parts})
    return replace(
        options,
        exposure_s=statements.exposure_s or options.exposure_s,
        gain_db=options.gain_db if statements.gain_db is None else statements.gain_db,
        # Only the known camera is simulated, not another that the file states.
        camera=stated if stated == known else replace(stated, simulated=False),
    )


def no_exposure(path: Path) -> str:
    """Say that the exposure time of a file is not known, and how it is given."""
    return f"{path} does not state its exposure time: give it with --exposure (exposure_s in Python)"


def require_exposure(path: Path, known: PictureOptions) -> None:
    """Raise InputError if neither a file nor the options say its exposure time."""
    if known.exposure_s is None:
        raise InputError(no_exposure(path))


def changed_at(path: Path) -> datetime:
    """Time of the last change of a file."""
    return datetime.fromtimestamp(path.stat().st_mtime, UTC)


#: Codes of what a file states beside its values.
_LEAVES_VALUES = (
    "sensor-corrections-not-applied",
    "black-level-from-xmp",
    "black-level-measured",
    "black-pattern",
    INTEGERS,
)
#: Usual endings of the names of raw dumps.
DUMP_SUFFIXES = (".bin", ".dat", ".raw")
#: Endings of the names of the files this module reads, besides raw dumps whose size is given.
IMAGE_SUFFIXES = (".tif", ".tiff", ".png", ".npy")


def read_image(path: str | PathLike[str], layout: PixelFormat, options: PictureOptions) -> FileFrame:
    """Read a grey TIFF, PNG, NumPy array or raw dump whose values are the DN of a sensor, of up to 24 bits.

    Parameters
    ----------
    path : path
        The file.
    layout : PixelFormat
        Bit depth, which a file of 16 bits does not state, and colour filter; of a raw dump also how its pixels are
        packed. A pixel is saturated at the highest DN.
    options : PictureOptions
        Exposure, gain and camera where the file does not say; the size of a raw dump; the encoding if the DN are codes
        of a curve, which may end before `layout` does.

    Raises
    ------
    InputError
        If the file cannot be read, is damaged, coloured or of another depth, has DN beyond `layout` or the curve, or
        does not say its exposure.

    Examples
    --------
    >>> import cv2
    >>> import numpy as np
    >>> from labcdp.core.dn import pixel_format
    >>> from labcdp.files import PictureOptions, read_image
    >>> written = cv2.imwrite("grey.png", np.full((4, 6), 100, np.uint8))
    >>> read_image("grey.png", pixel_format("Mono8"), PictureOptions(exposure_s=0.01)).frame.shape
    (4, 6)
    """
    path = Path(path)
    data, sha256 = picture_bytes(path, MAX_PIXELS)
    is_dump = options.size is not None and path.suffix.lower() in DUMP_SUFFIXES
    if is_dump:
        from .png_jpeg import read_dump

        assert options.size is not None
        dn, statements = read_dump(data, path, options.size, layout.name, MAX_PIXELS)
    elif data.startswith((PNG, NPY)):
        from .png_jpeg import read_npy, read_png

        dn, statements = (read_png if data.startswith(PNG) else read_npy)(data, path, MAX_PIXELS)
    elif data.startswith(TIFF):
        from .tiff import read_tiff

        dn, statements = read_tiff(data, path, MAX_PIXELS)
    else:
        raise InputError(
            f"{path} is no TIFF, PNG or NumPy array: give one of these, a camera RAW file, or a raw dump with its size"
        )
    kind = "of floats" if statements.bits is None else f"of {statements.bits} bits"
    # What labcdp does not apply leaves the values as they are, and their black level is beside them.
    altered = [finding for finding in statements.changes if finding.code not in _LEAVES_VALUES]
    coloured, curve = dn.ndim == 3, options.encoding if isinstance(options.encoding, Companding) else None
    depths = (8, 16) if layout.bit_depth <= 16 else (16, 32)
    if coloured or (statements.bits not in depths and not is_dump) or altered:
        changes = [finding.code.replace("-", " ") for finding in altered]
        what = [*(["coloured"] if coloured else []), kind, *changes]
        bits = " or ".join(map(str, depths))
        raise InputError(f"{path} is {', '.join(what)}: give a grey image of {bits} bits, one number a pixel")
    largest = 2**layout.bit_depth - 1
    if layout.bit_depth > 16:
        dn = dn.astype(np.uint32)
    if curve is None and dn.max() > largest:
        raise InputError(
            f"{path} has values up to {dn.max()}, the pixel format {layout.name} ends at {largest}: correct "
            "plan.pixel_format, which says how many bits the values have"
        )
    known = replace(statements_over(options, statements), pixel_format=layout.name)
    require_exposure(path, known)
    frame = make_frame(dn, Scale(layout.bit_depth, float(largest)), known, statements.taken or changed_at(path))
    frame = with_stated_levels(frame, statements.black, statements.white_dn)
    if curve is not None:
        with naming(path):
            frame = frame.with_curve(curve)
    unused: tuple[Finding, ...] = ()
    if statements.encoding != "linear" or statements.light_table is not None:
        reason = "values that are recorded or imported are the DN of a sensor"
        unused = (warning("curve-not-used", by=statements.stated_by, reason=reason),)
    return FileFrame(path, sha256, statements, frame, findings=unused)


def frame_of_pixels(
    dn: NDArray[np.unsignedinteger[Any]], options: PictureOptions, timestamp: datetime, frame_id: int = 0
) -> Frame:
    """Frame of DN that come without any statement, such as those of a video.

    Parameters
    ----------
    dn : ndarray of uint8 or uint16, shape (height, width)
        The DN.
    options : PictureOptions
        What is known about them. A bit depth or a pixel format of more than 8 bits counts for 16-bit DN only.
    timestamp : datetime
        When they were taken, with time zone.
    frame_id : int
        Number of the frame.

    Raises
    ------
    InputError
        If the options do not fit the DN.

    Examples
    --------
    >>> from datetime import UTC, datetime
    >>> import numpy as np
    >>> from labcdp.files import PictureOptions, frame_of_pixels
    >>> options = PictureOptions(exposure_s=0.01, bit_depth=12)
    >>> frame = frame_of_pixels(np.full((2, 3), 700, np.uint16), options, datetime.now(UTC))
    >>> frame.saturation_dn
    4095.0
    """
    bits = 8 * dn.dtype.itemsize
    # A guess for each frame of a video could change from one to the next.
    scale = scale_of(dn, bits, options, "the picture") if options.stated_bits else Scale(bits, 2.0**bits - 1)
    return make_frame(dn, scale, options, timestamp, frame_id)


def scale_of(values: NDArray[Any], bits: int, options: PictureOptions, source: str) -> Scale:
    """Bits and saturation of DN, as stated by the file; for any depth stored in 16 bits, as given or estimated.

    Parameters
    ----------
    values : ndarray of uint8 or uint16
        The DN, or colours.
    bits : int
        Bits the file states.
    options : PictureOptions
        Bit depth, or a pixel format that says it.
    source : str
        What messages call the picture.

    Raises
    ------
    InputError
        If a value is beyond the given bits.
    """
    if bits != 16:
        return Scale(bits, 2.0**bits - 1)
    given, largest = options.stated_bits, int(values.max())
    if given is None:
        return guessed_scale(largest, int(np.bitwise_or.reduce(values, axis=None)), bits)
    return Scale(given, 2.0**given - 1).for_values(values, source)


def make_frame(
    dn: NDArray[np.unsignedinteger[Any]], scale: Scale, options: PictureOptions, timestamp: datetime, frame_id: int = 0
) -> Frame:
    """Frame of DN of a scale; a pixel format of another depth does not count."""
    given = None if options.pixel_format is None else pixel_format(options.pixel_format)
    if given is not None and given.bit_depth != scale.bits:
        given = None
    top = 2.0**scale.bits - 1
    saturation_dn = scale.saturation_dn if options.saturation_dn is None else min(options.saturation_dn, top)
    return Frame(
        dn=dn,
        exposure_s=options.exposure_s or NO_EXPOSURE_S,
        gain_db=options.gain_db or 0.0,
        bit_depth=scale.bits,
        saturation_dn=saturation_dn,
        black_level_dn=options.black_level_dn,
        pixel_format=f"Mono{scale.bits}" if given is None else given.name,
        colour_filter=None if given is None else given.colour_filter,
        temperature_c=None,
        timestamp=timestamp,
        camera_timestamp_ns=0,
        frame_id=frame_id,
        camera=options.camera or UNKNOWN_CAMERA,
    )


def with_stated_levels(frame: Frame, black: tuple[float, BlackPattern | None] | None, white_dn: float | None) -> Frame:
    """Frame of stored values with the black level and the saturation that their file states, None for nothing."""
    if black is not None:
        frame = replace(frame, black_level_dn=black[0], black_pattern=black[1])
    return frame if white_dn is None else replace(frame, saturation_dn=min(frame.saturation_dn, white_dn))


#: Bits of converters whose DN are kept in 16 bits.
_DEPTHS = (10, 12, 14)


@dataclass(frozen=True)
class Scale:
    """Bits of the DN scale, the DN from which a pixel is saturated, and how they were found."""

    bits: int
    saturation_dn: float
    findings: tuple[Finding, ...] = ()

    def for_values(self, values: NDArray[Any], source: str) -> Scale:
        """Return it for values that are on it; raises InputError, naming their `source`, for others."""
        if int(values.max()) >= 2**self.bits:
            raise InputError(
                f"{source} has values up to {values.max()}, above {self.bits} bits: give the bit depth it was written "
                "with"
            )
        return self


def guessed_scale(largest: int, in_use: int, bits: int) -> Scale:
    """Scale of DN in a wider type: that of a converter at whose highest DN the values end, else the type's own.

    Parameters
    ----------
    largest : int
        Largest DN of all pictures that belong together.
    in_use : int
        Bits that are set in any of them.
    bits : int
        Bits of the type.
    """
    for depth in _DEPTHS:
        if largest == 2**depth - 1 < 2**bits - 1:
            return Scale(depth, float(largest), (info("bit-depth-guessed", bits=depth, saturation_dn=largest),))
    for depth in _DEPTHS:
        step = 2 ** (bits - depth)
        top = 2**bits - step
        if largest == top and not in_use & (step - 1):
            guess = info("bit-depth-guessed-upper", bits=depth, stored_bits=bits, saturation_dn=top)
            return Scale(bits, float(top), (guess,))
    findings: tuple[Finding, ...] = ()
    if largest < 2 ** (bits - 1):
        findings = (warning("bit-depth-unknown", largest_dn=largest, top_dn=2**bits - 1),)
    return Scale(bits, 2.0**bits - 1, findings)
