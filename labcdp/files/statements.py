"""What a picture states of the curve and the colours of its values, whatever its format."""

from __future__ import annotations

import struct
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.result import Finding, info, warning
from .exif import positive_number
from .icc import read_profile
from .stored_image import StoredImage
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

#: Gamma of a file that some write as 0.45454 for 1 / 2.2.
_GAMMA_UNITS = 100_000


@dataclass(frozen=True, eq=False)
class Statement:
    """Curve and colours that a file states; the defaults state nothing.

    Parameters
    ----------
    encoding : str or None
        How values are encoded.
    by : str
        What of the file states it.
    light_table : ndarray of uint16, shape (1 or 3, 2**bits), or None
        Light of each value in 65535ths of white, where the curve is no known encoding.
    weights : (float, float, float)
        Of linear red, green and blue in luminance.
    findings : tuple of Finding
        What is not used, and what follows from the statement.
    """

    encoding: Encoding | None = None
    by: str = ""
    light_table: NDArray[np.uint16] | None = None
    weights: Weights = BT709_LUMINANCE
    findings: tuple[Finding, ...] = ()

    @property
    def states_curve(self) -> bool:
        """Whether a curve is stated."""
        return self.encoding is not None or self.light_table is not None


NOTHING_STATED = Statement()


def stated_by_profile(data: bytes | None, coloured: bool, bits: int) -> Statement:
    """Return what an ICC profile states, and a finding if it cannot be used; nothing where there is none."""
    if data is None:
        return NOTHING_STATED
    try:
        profile = read_profile(data, coloured)
    except InputError as error:
        return Statement(findings=(warning("icc-profile-not-used", reason=str(error)),))
    table = profile.light_tables(bits) if profile.encoding is None else None
    is_other = profile.space != ("RGB" if coloured else "GRAY")
    by = f"its ICC profile ({profile.space})" if is_other else "its ICC profile"
    findings = (warning("icc-table-not-used"),) if profile.has_table else ()
    return Statement(profile.encoding, by, table, profile.weights, findings)


def stated_by_codes(primaries: int, transfer: int, by: str) -> Statement:
    """Return what codes of ITU-T H.273 state, and findings on codes that are not known."""
    encoding = ENCODING_OF_CODE.get(transfer)
    findings = []
    if encoding is None and transfer != UNSPECIFIED:
        findings.append(warning("transfer-code-unknown", code=transfer))
    weights = luminance_weights(PRIMARIES_OF_CODE[primaries]) if primaries in PRIMARIES_OF_CODE else None
    if weights is None and primaries != UNSPECIFIED:
        findings.append(warning("primaries-code-unknown", code=primaries))
    return Statement(encoding, by, None, weights or BT709_LUMINANCE, tuple(findings))


def stated_by_gamma(exponent: float | None, by: str) -> Statement:
    """Return that values to the power of `exponent` are light; a finding for an exponent that is none."""
    if exponent is not None and 0.1 <= exponent <= 10:
        return Statement(gamma_encoding(exponent), by)
    return Statement(findings=(warning("gamma-not-used", by=by),))


def stated_by_table(value: Any, bits: int) -> Statement:
    """Return the curve of a tag TransferFunction, of one table or three (TIFF 6.0, section 20); or that it is none."""
    if value is None:
        return NOTHING_STATED
    n = 2**bits
    try:
        table: NDArray[np.uint16] = np.asarray(value, dtype=np.uint16).ravel()
    except (TypeError, ValueError, OverflowError):
        table = np.zeros(0, np.uint16)
    if table.size not in (n, 3 * n) or np.ptp(table) == 0:
        return Statement(findings=(warning("transfer-function-not-used"),))
    table = table.reshape(-1, n)
    encodings = {known_encoding(channel) for channel in table / 65535.0}
    encoding = encodings.pop() if len(encodings) == 1 else None
    return Statement(encoding, "its tag TransferFunction", table if encoding is None else None)


def stated_by_png(
    chunks: Mapping[bytes, bytes],
    behind: Collection[bytes],
    profile: bytes | None,
    exif: Statement,
    coloured: bool,
    bits: int,
) -> Statement:
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
    exif : Statement
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
        found = Statement("srgb", "its chunk sRGB")
    elif b"gAMA" in chunks:
        gamma = int.from_bytes(chunks[b"gAMA"][:4], "big")
        found = stated_by_gamma(_GAMMA_UNITS / gamma if gamma else None, "its chunk gAMA")
    else:
        found = exif
    if of_codes is not NOTHING_STATED and codes[0] in PRIMARIES_OF_CODE:
        found = replace(found, weights=of_codes.weights)
    elif coloured and b"sRGB" not in chunks and b"cHRM" in chunks:
        weights = None
        if len(chromaticities := chunks[b"cHRM"]) == 32:
            white_x, white_y, *rgb = (one / _GAMMA_UNITS for one in struct.unpack(">8I", chromaticities))
            weights = luminance_weights([*zip(rgb[::2], rgb[1::2], strict=True), (white_x, white_y)])
        if weights is None:
            unused += (warning("primaries-not-used", by="its chunk cHRM"),)
        found = replace(found, weights=weights or BT709_LUMINANCE)
    return replace(found, findings=(*found.findings, *unused))


#: Chunks that state curve and colours, which count before the pixels only (PNG third edition, 5.6).
_BEFORE_PIXELS = (b"cICP", b"iCCP", b"sRGB", b"gAMA", b"cHRM")
#: What ColorSpace of EXIF has for sRGB, and what some cameras have for Adobe RGB.
_SRGB_SPACE, _ADOBE_SPACE = 1, 2
#: Adobe RGB (1998): 563 / 256, and its chromaticities.
_ADOBE_GAMMA = 563 / 256
_ADOBE_PRIMARIES = ((0.64, 0.33), (0.21, 0.71), (0.15, 0.06), (0.3127, 0.3290))


@dataclass(frozen=True)
class ExifColours:
    """Tags that state curve and colours, as they are in EXIF and TIFF; None for those that are not there.

    Parameters
    ----------
    gamma, space, interoperability : object
        Gamma, ColorSpace, and the index of interoperability.
    table, white, primaries : object
        TransferFunction, WhitePoint, PrimaryChromaticities.
    """

    gamma: Any = None
    space: Any = None
    interoperability: Any = None
    table: Any = None
    white: Any = None
    primaries: Any = None

    @classmethod
    def of_block(cls, header: Any) -> ExifColours:
        """Take them from the EXIF of a file that Pillow opened."""
        from PIL import ExifTags

        try:
            block = header.getexif()
            exif, index = block.get_ifd(ExifTags.IFD.Exif), block.get_ifd(ExifTags.IFD.Interop).get(1)
            return cls(
                exif.get(0xA500), exif.get(ExifTags.Base.ColorSpace), index, block.get(301), block.get(318),
                block.get(319),
            )  # fmt: skip
        # A damaged block raises what its parts do.
        except Exception:
            return cls()

    def stated(self, bits: int) -> Statement:
        """Return what they state of values of some bits: TransferFunction before Gamma, that before the others."""
        found = stated_by_table(self.table, bits)
        findings, weights = found.findings, None
        if not found.states_curve and self.gamma is not None:
            found = stated_by_gamma(positive_number(self.gamma), "its EXIF gamma")
            findings += found.findings
        is_adobe = self.space == _ADOBE_SPACE or (self.interoperability == "R03" and self.space != _SRGB_SPACE)
        if not found.states_curve and is_adobe:
            found = Statement(gamma_encoding(_ADOBE_GAMMA), "its EXIF (Adobe RGB)")
        elif not found.states_curve and self.space == _SRGB_SPACE:
            found = Statement("srgb", "its EXIF colour space")
        # The white point alone does not tell what colours add to luminance.
        if self.primaries is not None:
            white, rgb = numbers_of(self.white), numbers_of(self.primaries)
            if len(white) == 2 and len(rgb) == 6:
                weights = luminance_weights([*zip(rgb[::2], rgb[1::2], strict=True), white])
            findings += () if weights else (warning("primaries-not-used", by="its tag PrimaryChromaticities"),)
        weights = weights or (luminance_weights(_ADOBE_PRIMARIES) if is_adobe else None)
        return replace(found, weights=weights or BT709_LUMINANCE, findings=findings)


def numbers_of(value: Any) -> list[float]:
    """Numbers of a tag of fractions: as they are, or, as tifffile gives them, numerators and denominators in turn."""
    try:
        parts = [float(one) for one in value]
        if len(parts) in (4, 12):
            parts = [a / b for a, b in zip(parts[::2], parts[1::2], strict=True)]
    except (TypeError, ValueError, ZeroDivisionError):
        return []
    return parts


def curve_findings(statement: Statement, encoding: Encoding) -> tuple[Finding, ...]:
    """Return what a user should know of a curve that is used because the file states it."""
    found = [*statement.findings]
    usual = encoding == "srgb" and statement.by in ("its chunk sRGB", "its EXIF colour space")
    if statement.states_curve and not usual:
        curve = "encoded with its own curve" if statement.encoding is None else encoding_name(encoding)
        found.append(info("encoding-stated", encoding=curve, by=statement.by))
    if encoding == "pq":
        found.append(info("encoding-pq"))
    if encoding == "hlg":
        found.append(info("encoding-hlg"))
    return tuple(found)


def with_statement(stored: StoredImage, statement: Statement, usual: Encoding) -> StoredImage:
    """Add the curve and the colours that a file states to what was stored, or what is usual."""
    encoding = statement.encoding or usual
    return replace(
        stored,
        encoding=encoding,
        doubts=(*stored.doubts, *curve_findings(statement, encoding)),
        stated_by=statement.by if statement.states_curve else "",
        light_table=statement.light_table,
        weights=statement.weights,
    )
