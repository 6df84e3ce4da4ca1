"""What a file states of a picture, whatever its format: how it was taken, curve and colours of its values."""

from __future__ import annotations

import struct
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from math import hypot, isfinite, log10
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.frame import BlackPattern
from ..core.result import Finding, info, warning
from .transfer import (
    BT709_LUMINANCE,
    ENCODING_OF_CODE,
    PRIMARIES_OF_CODE,
    UNSPECIFIED,
    Encoding,
    Weights,
    encoding_name,
    gamma_encoding,
    known_encoding,
    luminance_weights,
)

#: Diagonal of 36 mm x 24 mm.
_FILM_DIAGONAL_M = hypot(36e-3, 24e-3)
#: ISO speed that counts as a gain of 0 dB.
_ISO_OF_0_DB = 100.0
#: Gamma of a file that some write as 0.45454 for 1 / 2.2.
_GAMMA_UNITS = 100_000


@dataclass(frozen=True, eq=False)
class FileStatements:
    """What a file states of a picture: how it was taken, and what its values mean; None or empty where it does not say.

    By the tags of EXIF (CIPA DC-008, Exif 2.32), TIFF and DNG (Adobe DNG 1.7), and whatever else its format has.

    Parameters
    ----------
    exposure_s, f_number, focal_length_m, iso : float or None
        ExposureTime, FNumber, FocalLength, ISOSpeedRatings.
    vendor, model, serial : str
        Make, Model, CameraSerialNumber or BodySerialNumber.
    taken : datetime or None
        DateTimeOriginal, with OffsetTimeOriginal or else in local time.
    orientation : int
        Orientation, 1 to 8; 1 if the file does not say.
    photometric : int or None
        PhotometricInterpretation of the largest picture.
    has_cfa_pattern : bool
        Whether there is a CFAPattern.
    focal_length_35mm_m : float or None
        FocalLengthIn35mmFilm: the focal length with the same field of view on 36 mm x 24 mm.
    pixel_pitch_m : float or None
        Distance of pixels by FocalPlaneXResolution and FocalPlaneResolutionUnit.
    width_px : int or None
        PixelXDimension: columns of the picture that the camera took.
    bits : int or None
        Bits of the scale of integers; None for floats.
    encoding : str or None
        How values are encoded: as stated, or of the values of a file what its kind suggests.
    stated_by : str
        What of the file states the encoding, such as ``its ICC profile``; empty if nothing does.
    light_table : ndarray of uint16, shape (1 or 3, n), or None
        Light of grey, or of red, green and blue, at equal steps from 0 to the largest value, in 65535ths of white, by a
        curve that is no `encoding`.
    weights : (float, float, float)
        Of linear red, green and blue in luminance.
    is_settled : bool
        Whether the kind of the file says how values are encoded, as those of JPEG, arrays and dumps do.
    black : (float, BlackPattern or None) or None
        Black level, and the pattern of the pixels around it.
    white_dn : float or None
        DN from which pixels are saturated.
    cd_m2_per_value : float or None
        Luminance of the value 1.
    changes : tuple of Finding
        What was done to the values.
    findings : tuple of Finding
        What is not used, what follows, and what is not certain about the values.
    """

    exposure_s: float | None = None
    f_number: float | None = None
    focal_length_m: float | None = None
    iso: float | None = None
    vendor: str = ""
    model: str = ""
    serial: str = ""
    taken: datetime | None = None
    orientation: int = 1
    photometric: int | None = None
    has_cfa_pattern: bool = False
    focal_length_35mm_m: float | None = None
    pixel_pitch_m: float | None = None
    width_px: int | None = None
    bits: int | None = None
    encoding: Encoding | None = None
    stated_by: str = ""
    light_table: NDArray[np.uint16] | None = None
    weights: Weights = BT709_LUMINANCE
    is_settled: bool = False
    black: tuple[float, BlackPattern | None] | None = None
    white_dn: float | None = None
    cd_m2_per_value: float | None = None
    changes: tuple[Finding, ...] = ()
    findings: tuple[Finding, ...] = ()

    @property
    def gain_db(self) -> float | None:
        """20 log10(ISO / 100), as twice the speed is twice the DN; None if the ISO speed is not known."""
        return 20 * log10(self.iso / _ISO_OF_0_DB) if self.iso else None

    @property
    def states_curve(self) -> bool:
        """Whether a curve is stated."""
        return self.encoding is not None or self.light_table is not None

    def pixel_pitch_on(self, shape: tuple[int, int]) -> float | None:
        """Return the distance of the pixels of a picture of this height and width on the sensor; None if not known.

        That of FocalPlaneXResolution, unless the picture has another size than the camera took; else by the focal
        length and that of 35 mm film with the same field, by its diagonal.
        """
        if self.pixel_pitch_m is not None and self.width_px in (None, *shape):
            return self.pixel_pitch_m
        if self.focal_length_m is None or self.focal_length_35mm_m is None:
            return None
        return self.focal_length_m / self.focal_length_35mm_m * _FILM_DIAGONAL_M / hypot(*shape)

    def with_curve(self, curve: FileStatements, usual: Encoding) -> FileStatements:
        """Return them with curve and colours that others state, or the usual encoding, and what there is to say."""
        encoding = curve.encoding or usual
        return replace(
            self,
            encoding=encoding,
            stated_by=curve.stated_by if curve.states_curve else "",
            light_table=curve.light_table,
            weights=curve.weights,
            findings=(*self.findings, *curve_findings(curve, encoding)),
        )


NOTHING_STATED = FileStatements()


def positive_number(value: Any) -> float | None:
    """Positive number of a tag that may be a fraction or a list of one; None if it is nothing of that."""
    try:
        if isinstance(value, tuple | list):
            value = value[0] / value[1] if len(value) == 2 else value[0]
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError, IndexError, OverflowError):
        return None
    return number if isfinite(number) and number > 0 else None


def stated_by_profile(data: bytes | None, coloured: bool, bits: int) -> FileStatements:
    """Return what an ICC profile states, and a finding if it cannot be used; nothing where there is none."""
    if data is None:
        return NOTHING_STATED
    from .icc import read_profile

    try:
        profile = read_profile(data, coloured)
    except InputError as error:
        return FileStatements(findings=(warning("icc-profile-not-used", reason=str(error)),))
    table = profile.light_tables(bits) if profile.encoding is None else None
    is_other = profile.space != ("RGB" if coloured else "GRAY")
    by = f"its ICC profile ({profile.space})" if is_other else "its ICC profile"
    findings = (warning("icc-table-not-used"),) if profile.has_table else ()
    return FileStatements(
        encoding=profile.encoding, stated_by=by, light_table=table, weights=profile.weights, findings=findings
    )


def stated_by_codes(primaries: int, transfer: int, by: str) -> FileStatements:
    """Return what codes of ITU-T H.273 state, and findings on codes that are not known."""
    encoding = ENCODING_OF_CODE.get(transfer)
    findings = []
    if encoding is None and transfer != UNSPECIFIED:
        findings.append(warning("transfer-code-unknown", code=transfer))
    weights = luminance_weights(PRIMARIES_OF_CODE[primaries]) if primaries in PRIMARIES_OF_CODE else None
    if weights is None and primaries != UNSPECIFIED:
        findings.append(warning("primaries-code-unknown", code=primaries))
    return FileStatements(encoding=encoding, stated_by=by, weights=weights or BT709_LUMINANCE, findings=tuple(findings))


def stated_by_gamma(exponent: float | None, by: str) -> FileStatements:
    """Return that values to the power of `exponent` are light; a finding for an exponent that is none."""
    if exponent is not None and 0.1 <= exponent <= 10:
        return FileStatements(encoding=gamma_encoding(exponent), stated_by=by)
    return FileStatements(findings=(warning("gamma-not-used", by=by),))


def stated_by_table(value: Any, bits: int) -> FileStatements:
    """Return the curve of a tag TransferFunction, of one table or three (TIFF 6.0, section 20); or that it is none."""
    if value is None:
        return NOTHING_STATED
    n = 2**bits
    try:
        table: NDArray[np.uint16] = np.asarray(value, dtype=np.uint16).ravel()
    except (TypeError, ValueError, OverflowError):
        table = np.zeros(0, np.uint16)
    if table.size not in (n, 3 * n) or np.ptp(table) == 0:
        return FileStatements(findings=(warning("transfer-function-not-used"),))
    table = table.reshape(-1, n)
    encodings = {known_encoding(channel) for channel in table / 65535.0}
    encoding = encodings.pop() if len(encodings) == 1 else None
    by, light_table = "its tag TransferFunction", table if encoding is None else None
    return FileStatements(encoding=encoding, stated_by=by, light_table=light_table)


def stated_by_png(
    chunks: Mapping[bytes, bytes],
    behind: Collection[bytes],
    profile: bytes | None,
    exif: FileStatements,
    coloured: bool,
    bits: int,
) -> FileStatements:
    """Return what a PNG states: cICP before iCCP, that before sRGB, that before gAMA and cHRM (PNG third edition, 4.3).

    What EXIF states counts where there is no other curve.

    Parameters
    ----------
    chunks : mapping of bytes to bytes
        The file's chunks before its pixels by name.
    behind : collection of bytes
        Names of chunks behind them.
    profile : bytes or None
        Its ICC profile.
    exif : FileStatements
        What its EXIF states.
    coloured : bool
        Whether it has red, green and blue.
    bits : int
        Bits of its values.
    """
    codes, late = chunks.get(b"cICP", b""), [name for name in _BEFORE_PIXELS if name in behind]
    of_profile = stated_by_profile(profile, coloured, bits)
    unused = tuple(warning("chunk-not-used", name=name.decode(), reason="it comes after the pixels") for name in late)
    of_codes = NOTHING_STATED
    if b"cICP" in chunks and len(codes) != 4:
        unused += (warning("chunk-not-used", name="cICP", reason=f"it has {len(codes)} bytes, not 4"),)
    elif codes and codes[2] != 0:
        # Red, green and blue have no matrix (PNG third edition, 11.3.2.6).
        unused += (warning("chunk-not-used", name="cICP", reason="its matrix coefficients are not 0"),)
    elif codes:
        of_codes = stated_by_codes(codes[0], codes[1], "its chunk cICP")
    if of_codes.states_curve:
        return replace(of_codes, findings=(*of_codes.findings, *unused))
    unused += of_codes.findings
    if of_profile.states_curve:
        return replace(of_profile, findings=(*of_profile.findings, *unused))
    unused += of_profile.findings
    if b"sRGB" in chunks:
        curve = FileStatements(encoding="srgb", stated_by="its chunk sRGB")
    elif b"gAMA" in chunks:
        gamma = int.from_bytes(chunks[b"gAMA"][:4], "big")
        curve = stated_by_gamma(_GAMMA_UNITS / gamma if gamma else None, "its chunk gAMA")
    else:
        curve = exif
    if of_codes is not NOTHING_STATED and codes[0] in PRIMARIES_OF_CODE:
        curve = replace(curve, weights=of_codes.weights)
    elif coloured and b"sRGB" not in chunks and b"cHRM" in chunks:
        weights = None
        if len(chromaticities := chunks[b"cHRM"]) == 32:
            white_x, white_y, *rgb = (number / _GAMMA_UNITS for number in struct.unpack(">8I", chromaticities))
            weights = luminance_weights([*zip(rgb[::2], rgb[1::2], strict=True), (white_x, white_y)])
        if weights is None:
            unused += (warning("primaries-not-used", by="its chunk cHRM"),)
        curve = replace(curve, weights=weights or BT709_LUMINANCE)
    return replace(curve, findings=(*curve.findings, *unused))


#: Chunks that state curve and colours, which count before the pixels only (PNG third edition, 5.6).
_BEFORE_PIXELS = (b"cICP", b"iCCP", b"sRGB", b"gAMA", b"cHRM")
#: What ColorSpace of EXIF has for sRGB, and what some cameras have for Adobe RGB.
_SRGB_SPACE, _ADOBE_SPACE = 1, 2
#: Adobe RGB (1998): 563 / 256, and its chromaticities.
_ADOBE_GAMMA = 563 / 256
_ADOBE_PRIMARIES = ((0.64, 0.33), (0.21, 0.71), (0.15, 0.06), (0.3127, 0.3290))


def exif_colours(header: Any) -> dict[str, Any]:
    """Return tags that state curve and colours from the EXIF of a file that Pillow opened, as arguments below."""
    from PIL import ExifTags

    try:
        block = header.getexif()
        exif = block.get_ifd(ExifTags.IFD.Exif)
        return {
            "gamma": exif.get(0xA500),
            "space": exif.get(ExifTags.Base.ColorSpace),
            "interoperability": block.get_ifd(ExifTags.IFD.Interop).get(1),
            "table": block.get(301),
            "white": block.get(318),
            "primaries": block.get(319),
        }
    # A damaged block raises what its parts do.
    except Exception:
        return {}


def stated_by_exif(
    bits: int,
    *,
    gamma: Any = None,
    space: Any = None,
    interoperability: Any = None,
    table: Any = None,
    white: Any = None,
    primaries: Any = None,
) -> FileStatements:
    """Return what tags of EXIF and TIFF state: TransferFunction before Gamma, that before the others.

    Parameters
    ----------
    bits : int
        Bits of the values.
    gamma, space, interoperability : object
        Gamma, ColorSpace, and the index of interoperability, as they are in the file; None for those that are not.
    table, white, primaries : object
        TransferFunction, WhitePoint, PrimaryChromaticities.
    """
    stated = stated_by_table(table, bits)
    findings, weights = stated.findings, None
    if not stated.states_curve and gamma is not None:
        stated = stated_by_gamma(positive_number(gamma), "its EXIF gamma")
        findings += stated.findings
    is_adobe = space == _ADOBE_SPACE or (interoperability == "R03" and space != _SRGB_SPACE)
    if not stated.states_curve and is_adobe:
        stated = FileStatements(encoding=gamma_encoding(_ADOBE_GAMMA), stated_by="its EXIF (Adobe RGB)")
    elif not stated.states_curve and space == _SRGB_SPACE:
        stated = FileStatements(encoding="srgb", stated_by="its EXIF colour space")
    # The white point alone does not tell what colours add to luminance.
    if primaries is not None:
        white_xy, rgb = numbers_of(white), numbers_of(primaries)
        if len(white_xy) == 2 and len(rgb) == 6:
            weights = luminance_weights([*zip(rgb[::2], rgb[1::2], strict=True), white_xy])
        findings += () if weights else (warning("primaries-not-used", by="its tag PrimaryChromaticities"),)
    weights = weights or (luminance_weights(_ADOBE_PRIMARIES) if is_adobe else None)
    return replace(stated, weights=weights or BT709_LUMINANCE, findings=findings)


def numbers_of(value: Any) -> list[float]:
    """Numbers of a tag of fractions: as they are, or, as tifffile gives them, numerators and denominators in turn."""
    try:
        parts = [float(number) for number in value]
        if len(parts) in (4, 12):
            parts = [a / b for a, b in zip(parts[::2], parts[1::2], strict=True)]
    except (TypeError, ValueError, ZeroDivisionError):
        return []
    return parts


def curve_findings(curve: FileStatements, encoding: Encoding) -> tuple[Finding, ...]:
    """Return what a user should know of a curve that is used because the file states it."""
    findings = [*curve.findings]
    usual = encoding == "srgb" and curve.stated_by in ("its chunk sRGB", "its EXIF colour space")
    if curve.states_curve and not usual:
        name = "encoded with its own curve" if curve.encoding is None else encoding_name(encoding)
        findings.append(info("encoding-stated", encoding=name, by=curve.stated_by))
    if encoding == "pq":
        findings.append(info("encoding-pq"))
    if encoding == "hlg":
        findings.append(info("encoding-hlg"))
    return tuple(findings)
