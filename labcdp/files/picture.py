"""A picture that was read."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isclose
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..core.companding import Companding
from ..core.disk.files import shown
from ..core.dn import PIXEL_FORMATS, pixel_format
from ..core.errors import InputError
from ..core.frame import FILTER_NAMES, CameraIdentity, Frame, filter_name
from ..core.luminance import LuminanceMap
from ..core.result import Finding, warning
from ..core.vignetting import VIGNETTING_REL, Lens
from .doubts import CERTAIN, Doubts
from .statements import FileStatements
from .stored_image import MAX_PIXELS, MOST_BITS
from .transfer import Encoding, encoding_name

#: Frame rates are below this.
_MOST_HZ = 1e7


@dataclass(frozen=True, eq=False)
class PictureFile:
    """The file of a picture, and what it states.

    Parameters
    ----------
    path : Path
        The file.
    sha256 : str
        Hash of its bytes; two files are the same picture if it is equal.
    statements : FileStatements
        What the file states.
    """

    path: Path
    sha256: str
    statements: FileStatements

    @property
    def f_number(self) -> float | None:
        """Aperture of the lens, None where the file does not say."""
        return self.statements.f_number

    @property
    def focal_length_m(self) -> float | None:
        """Focal length of the lens, None where the file does not say."""
        return self.statements.focal_length_m

    @property
    def exposure_stated(self) -> bool:
        """Whether the file itself says its exposure."""
        return self.statements.exposure_s is not None

    @property
    def camera_stated(self) -> bool:
        """Whether the file itself says its camera."""
        return bool(self.statements.model)


@dataclass(frozen=True, eq=False)
class StoredColours:
    """Red, green and blue as a file stores them.

    Parameters
    ----------
    values : ndarray of uint8 or uint16, shape (height, width, 3)
        The values.
    bits : int
        Bits of their scale.
    encoding : str
        How they are encoded.
    saturated : ndarray of bool, shape (height, width)
        Pixels of which a colour is at its highest value.
    """

    values: NDArray[np.unsignedinteger[Any]]
    bits: int
    encoding: Encoding
    saturated: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Picture(PictureFile):
    """An image file that was read.

    Parameters
    ----------
    path, sha256, statements
        As of `PictureFile`.
    frame : Frame or None
        DN, grey or behind a Bayer pattern; of colours, linear luminance in 65535ths of white. None for floats.
    light : ndarray of float32, shape (height, width), or None
        Values of a file of floats, None for integers.
    light_is_cd_m2 : bool
        Whether the file says that the floats are luminance in cd/m^2.
    encoding : str
        How the values of the file are encoded, as it states, by its kind or as requested.
    findings : tuple of Finding
        What was done with the values, and what the user gave that the file contradicts or that cannot count for it.
    exposure_known : bool
        Whether the file or the options say the exposure; if not, `frame.exposure_s` means nothing.
    coloured : bool
        Whether `frame` was made of colours; then it is linear, whatever `encoding`.
    guessed_by : (int, int) or None
        Largest value and bits that are set in any, where the bits of the scale are an estimate from them.
    luminance : LuminanceMap or None
        The whole map of a file that labcdp wrote as luminance, with uncertainty and flags.
    doubts : Doubts
        What is doubtful about the values.
    lens : Lens or None
        The lens by the plan of the session it was recorded in; None for others.
    rgb : StoredColours or None
        The colours that `frame` was made of; None for others.

    Examples
    --------
    >>> import cv2
    >>> import numpy as np
    >>> from labcdp.files import read_picture
    >>> written = cv2.imwrite("grey.png", np.full((20, 30), 100, np.uint8))
    >>> picture = read_picture("grey.png")
    >>> picture.frame.shape, picture.encoding
    ((20, 30), 'linear')
    """

    frame: Frame | None = None
    light: NDArray[np.float32] | None = None
    light_is_cd_m2: bool = False
    encoding: Encoding = "linear"
    findings: tuple[Finding, ...] = ()
    exposure_known: bool = False
    coloured: bool = False
    guessed_by: tuple[int, int] | None = None
    luminance: LuminanceMap | None = None
    doubts: Doubts = CERTAIN
    lens: Lens | None = None
    rgb: StoredColours | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""
        values = self.light if self.frame is None else self.frame.dn
        assert values is not None
        return values.shape[0], values.shape[1]


@dataclass(frozen=True)
class PictureOptions:
    """What a file is taken to be where it does not say, and what is allowed.

    Parameters
    ----------
    exposure_s, gain_db : float or None
        Exposure time and gain; None for not known, and for 0 dB.
    temperature_c : float or None
        Temperature of the camera; None for what the file says.
    camera : CameraIdentity or None
        Camera; None if unknown.
    bit_depth : int or None
        Bits of the DN in files of 16 bits, for example 12, or of 32 bits, for example 20; None to guess.
    pixel_format : str or None
        GenICam pixel format the DN came in: says bits and colour filter of grey files, and the layout of raw dumps.
    size : (int, int) or None
        Width and height of raw dumps.
    saturation_dn, black_level_dn : float or None
        DN from which a pixel is saturated, and of dark signal; None for the highest DN, and for 0.
    encoding : str or None
        How values are encoded, see `labcdp.files.transfer`; None for what the file states or its kind suggests.
    assumed_encoding : str or None
        How grey values are taken to be encoded where neither is said; None for what their histogram looks like.
    bayer : str or None
        Colour filter of grey files, by the first 2 x 2 pixels: ``RGGB``, ``RCCB``, ``RCCC`` and these shifted; None for
        what the file or `pixel_format` says.
    focal_length_m, pixel_pitch_m : float or None
        Focal length of the lens, and distance of the pixels of the sensor, for the vignetting; None for not known.
    vignetting_rel : float
        Relative standard uncertainty of the vignetting by these, in the corners of an image.
    no_vignetting : bool
        Whether pictures are without vignetting, such as simulated and corrected ones.
    frame_rate_hz : float or None
        Images a second of videos that are images and state no times; None for not known.
    overrides : frozenset of str
        Names of the options that the user gave explicitly: these count before what a file says, with a finding where
        it says otherwise or the option cannot count. The others count where the file does not say.
    max_pixels : int
        Pixels from which a picture is refused before it is decoded.
    damaged : bool
        Whether frames of a video that are damaged, or build on damaged ones, are used, with a note.

    Raises
    ------
    InputError
        If a value is not possible.

    Examples
    --------
    >>> from labcdp.files import PictureOptions
    >>> PictureOptions(exposure_s=0.01, black_level_dn=64).black_level_dn
    64
    """

    exposure_s: float | None = None
    gain_db: float | None = None
    temperature_c: float | None = None
    camera: CameraIdentity | None = None
    bit_depth: int | None = None
    pixel_format: str | None = None
    size: tuple[int, int] | None = None
    saturation_dn: float | None = None
    black_level_dn: float | None = None
    encoding: Encoding | None = None
    assumed_encoding: Encoding | None = None
    bayer: str | None = None
    focal_length_m: float | None = None
    pixel_pitch_m: float | None = None
    vignetting_rel: float = VIGNETTING_REL
    no_vignetting: bool = False
    frame_rate_hz: float | None = None
    overrides: frozenset[str] = frozenset()
    max_pixels: int = MAX_PIXELS
    damaged: bool = False

    def __post_init__(self) -> None:
        if self.exposure_s is not None and not (np.isfinite(self.exposure_s) and self.exposure_s > 0):
            raise InputError(f"the exposure is {self.exposure_s} s: give a time above 0 s")
        if self.gain_db is not None and not np.isfinite(self.gain_db):
            raise InputError(f"the gain is {self.gain_db} dB: give a number")
        if self.temperature_c is not None and not -100 <= self.temperature_c <= 200:
            raise InputError(f"the temperature is {self.temperature_c} °C: give -100 to 200")
        if self.bit_depth is not None and not 1 <= self.bit_depth <= MOST_BITS:
            raise InputError(f"the bit depth is {self.bit_depth}: give 1 to {MOST_BITS} bits")
        if self.pixel_format is not None:
            pixel_format(self.pixel_format)
        if self.size is not None and min(self.size) < 1:
            raise InputError(f"the size is {self.size[0]} x {self.size[1]} pixels: give at least 1 x 1")
        if self.black_level_dn is not None and not 0 <= self.black_level_dn < 2**MOST_BITS:
            raise InputError(f"the black level is {self.black_level_dn} DN: give a number from 0 to {2**MOST_BITS - 1}")
        if self.bayer is not None and self.bayer not in FILTER_NAMES:
            raise InputError(f"bayer is {shown(self.bayer)}: give {', '.join(FILTER_NAMES)}")
        lens = ("focal length", self.focal_length_m, 1e-4, 10.0), ("pixel pitch", self.pixel_pitch_m, 1e-7, 1e-3)
        for what, value, least, most in lens:
            if value is not None and not least <= value <= most:
                raise InputError(f"the {what} is {value:g} m: give {least:g} to {most:g} m")
        rate_hz = self.frame_rate_hz
        if rate_hz is not None and not 0 < rate_hz < _MOST_HZ:
            raise InputError(f"the frame rate is {rate_hz:g} Hz: give a number above 0, for example 30")
        if self.max_pixels < 1:
            raise InputError(f"the limit is {self.max_pixels} pixels: give at least 1")

    def given(self, **values: Any) -> Self:
        """Return options with what the user states, which counts before what files say; None states nothing."""
        numbers = (
            "exposure_s",
            "gain_db",
            "temperature_c",
            "bit_depth",
            "black_level_dn",
            "focal_length_m",
            "pixel_pitch_m",
            "frame_rate_hz",
        )
        for name in numbers:
            value = values.get(name)
            if value is not None and (isinstance(value, bool) or not isinstance(value, int | float | np.number)):
                raise InputError(f"{name} is {shown(value)}: give a number")
        stated = {name: value for name, value in values.items() if value is not None}
        return replace(self, **stated, overrides=self.overrides | stated.keys())._with_curve()

    def _with_curve(self) -> Self:
        """Return them with bits, saturation and black level of the curve of companded values, if it is one."""
        curve, bits = self.encoding, self.override("bit_depth")
        if not isinstance(curve, Companding):
            return self
        if bits not in (None, curve.file_bits):
            raise InputError(
                f"the bit depth is {bits}, but the curve {curve.name} is for values of {curve.file_bits} bits: leave "
                "the bit depth out, or correct bits and shift of the curve"
            )
        black_dn = self.override("black_level_dn")
        return replace(
            self,
            bit_depth=curve.file_bits,
            saturation_dn=curve.saturation_dn,
            black_level_dn=curve.black_dn if black_dn is None else black_dn,
        )

    @property
    def stated_bits(self) -> int | None:
        """Bits of the DN in files of 16 bits, by bit depth or pixel format; None if neither is given."""
        of_format = None if self.pixel_format is None else pixel_format(self.pixel_format).bit_depth
        return self.bit_depth or of_format

    @property
    def of_sensor(self) -> bool:
        """Whether grey values are said to be the DN of a sensor, which are in proportion to light."""
        by_curve = isinstance(self.encoding, Companding)
        return bool(by_curve or self.pixel_format or {"bayer", "black_level_dn"} & self.overrides)

    def override(self, name: str) -> Any:
        """Return the value of an option that the user gave explicitly, else None."""
        return getattr(self, name) if name in self.overrides else None


#: Options of what values mean, beside exposure, gain and bits, in results.
OF_VALUES = ("black_level_dn", "bayer", "focal_length_m", "pixel_pitch_m", "no_vignetting")
#: Difference that rounding explains: 1/60 s as 16.7 ms; an ISO speed in steps of a third.
_EXPOSURE_REL, _GAIN_DB = 0.005, 0.05
_AS_STORED = {"black_level_dn": "black level", "bayer": "colour filter"}
_OF_DN = {"exposure_s": "exposure", "gain_db": "gain", "bit_depth": "bit depth", "pixel_format": "pixel format"}


def overridden_frame(frame: Frame, options: PictureOptions) -> Frame:
    """Frame with exposure, gain, temperature, and of DN as stored black level and colour filter, that the user gave."""
    given = {name: options.override(name) for name in ("exposure_s", "gain_db", "temperature_c")}
    frame = replace(frame, **{name: value for name, value in given.items() if value is not None})
    if frame.clipped is not None:
        # Light, that was made of colours or by a table.
        return frame
    black_dn, bayer = options.override("black_level_dn"), options.override("bayer")
    if black_dn is not None:
        frame = replace(frame, black_level_dn=black_dn, black_pattern=None)
    if bayer is not None:
        pattern = FILTER_NAMES[bayer]
        named = f"Bayer{pattern}{frame.bit_depth}"
        pixel_format = named if named in PIXEL_FORMATS else frame.pixel_format
        frame = replace(frame, colour_filter=pattern, pixel_format=pixel_format)
    return frame


def contradictions(exposure_s: float, gain_db: float, options: PictureOptions) -> tuple[Finding, ...]:
    """Find where a file says another exposure or gain than the user gave."""
    findings = []
    given_s, given_db = options.override("exposure_s"), options.override("gain_db")
    if given_s is not None and not isclose(exposure_s, given_s, rel_tol=_EXPOSURE_REL):
        findings.append(warning("exposure-replaced", stated_s=exposure_s, given_s=given_s))
    if given_db is not None and not isclose(gain_db, given_db, abs_tol=_GAIN_DB):
        findings.append(warning("gain-replaced", stated_db=gain_db, given_db=given_db))
    return tuple(findings)


def _other_levels(frame: Frame, options: PictureOptions) -> tuple[Finding, ...]:
    """Find where a file says another black level or colour filter of DN than the user gave."""
    findings = []
    black_dn, bayer = options.override("black_level_dn"), options.override("bayer")
    if black_dn is not None and frame.clipped is None and frame.black_level_dn not in (None, black_dn):
        findings.append(warning("black-level-replaced", stated_dn=frame.black_level_dn, given_dn=black_dn))
    if bayer is not None and frame.colour_filter not in (None, FILTER_NAMES[bayer]):
        findings.append(warning("colour-filter-replaced", stated=filter_name(frame.colour_filter or ""), given=bayer))
    return tuple(findings)


def unused_options(frame: Frame | None, bits: int | None, options: PictureOptions) -> tuple[Finding, ...]:
    """Find what the user gave that cannot count for the DN of a file.

    Parameters
    ----------
    frame : Frame or None
        The DN, None of a file of floats.
    bits : int or None
        Bits of the values as they were taken from the file.
    options : PictureOptions
        With what was given.
    """
    if frame is None:
        given = [what for name, what in {**_OF_DN, **_AS_STORED}.items() if name in options.overrides]
        return tuple(warning("option-needs-dn", option=what) for what in given)
    findings = []
    if frame.clipped is not None:
        given = [what for name, what in _AS_STORED.items() if name in options.overrides]
        findings += [warning("option-needs-grey", option=what) for what in given]
    given_bits, name = options.override("bit_depth"), options.override("pixel_format")
    if given_bits not in (None, bits):
        findings.append(warning("bit-depth-ignored", given=given_bits, bits=bits))
    if name is not None and pixel_format(name).name != frame.pixel_format:
        findings.append(warning("pixel-format-ignored", given=name))
    return tuple(findings)


def with_overrides(
    frame: Frame | None, size: tuple[int, int], encoding: Encoding, options: PictureOptions, bits: int | None
) -> tuple[Frame | None, tuple[Finding, ...]]:
    """Return DN with what the user gave, and findings about what contradicts their file or cannot count for it.

    Parameters
    ----------
    frame : Frame or None
        The DN, None of a file of floats.
    size : (int, int)
        Width and height of the picture.
    encoding : str
        How its values are taken to be encoded.
    options : PictureOptions
        With what was given.
    bits : int or None
        Bits of the values as they were taken from the file.
    """
    findings: list[Finding] = []
    if frame is not None:
        findings += contradictions(frame.exposure_s, frame.gain_db, options)
        findings += _other_levels(frame, options)
        frame = overridden_frame(frame, options)
    findings += unused_options(frame, bits, options)
    given_size, given_encoding = options.override("size") or size, options.override("encoding")
    if given_size != size:
        given = {"given_width": given_size[0], "given_height": given_size[1]}
        findings.append(warning("size-ignored", **given, width=size[0], height=size[1]))
    if given_encoding not in (None, encoding):
        findings.append(
            warning("encoding-ignored", given=encoding_name(given_encoding), encoding=encoding_name(encoding))
        )
    return frame, tuple(findings)
