"""What a picture states of the curve and the colours of its values, whatever its format."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.result import Finding, info, warning
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
    """Return what an ICC profile states, and a finding if it cannot be used."""
    if not data:
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


def stated_by_gamma(exponent: float, by: str) -> Statement:
    """Return that values to the power of `exponent` are light; nothing for an exponent that is none."""
    return Statement(gamma_encoding(exponent), by) if 0.1 <= exponent <= 10 else NOTHING_STATED


def stated_by_png(chunks: Mapping[bytes, bytes], profile: bytes | None, coloured: bool, bits: int) -> Statement:
    """Return what a PNG states: cICP before iCCP, that before sRGB, that before gAMA and cHRM (PNG third edition, 4.3).

    Parameters
    ----------
    chunks : mapping of bytes to bytes
        The file's chunks by name.
    profile : bytes or None
        Its ICC profile.
    coloured : bool
        Whether it has red, green and blue.
    bits : int
        Bits of its values.
    """
    codes = chunks.get(b"cICP", b"")
    of_profile = stated_by_profile(profile, coloured, bits)
    if len(codes) == 4 and ENCODING_OF_CODE.get(codes[1]) is not None:
        return stated_by_codes(codes[0], codes[1], "its chunk cICP")
    if of_profile.states_curve:
        return of_profile
    unused = of_profile.findings
    if len(codes) == 4:
        unused = (*stated_by_codes(codes[0], codes[1], "").findings, *unused)
    if b"sRGB" in chunks:
        return Statement("srgb", "its chunk sRGB", findings=unused)
    gamma = chunks.get(b"gAMA", b"")
    value = struct.unpack(">I", gamma)[0] if len(gamma) == 4 else 0
    found = stated_by_gamma(_GAMMA_UNITS / value, "its chunk gAMA") if value else NOTHING_STATED
    chromaticities = chunks.get(b"cHRM", b"")
    if coloured and len(chromaticities) == 32:
        white_x, white_y, *rgb = (one / _GAMMA_UNITS for one in struct.unpack(">8I", chromaticities))
        weights = luminance_weights([*zip(rgb[::2], rgb[1::2], strict=True), (white_x, white_y)])
        found = replace(found, weights=weights or BT709_LUMINANCE)
    return replace(found, findings=unused)


def stated_by_exif(header: Any) -> Statement:
    """Return what EXIF states of a JPEG: the tag Gamma, or Adobe RGB by its ColorSpace and interoperability index."""
    from PIL import ExifTags

    try:
        block = header.getexif()
        exif, index = block.get_ifd(ExifTags.IFD.Exif), block.get_ifd(ExifTags.IFD.Interop).get(1)
        gamma, space = exif.get(0xA500), exif.get(ExifTags.Base.ColorSpace)
        exponent = None if gamma is None else float(gamma)
    # A damaged block raises what its parts do.
    except Exception:
        return NOTHING_STATED
    if exponent is not None and exponent > 0:
        return stated_by_gamma(exponent, "its EXIF gamma")
    if index == "R03" and space != 1:
        # Adobe RGB (1998): 563 / 256, and its chromaticities.
        weights = luminance_weights(((0.64, 0.33), (0.21, 0.71), (0.15, 0.06), (0.3127, 0.3290)))
        return Statement(gamma_encoding(563 / 256), "its EXIF (Adobe RGB)", None, weights or BT709_LUMINANCE)
    if space == 1:
        return Statement("srgb", "its EXIF colour space")
    return NOTHING_STATED


def curve_findings(statement: Statement, encoding: Encoding) -> tuple[Finding, ...]:
    """Return what a user should know of a curve that is used because the file states it."""
    found = [*statement.findings]
    usual = encoding == "srgb" and statement.by in ("its chunk sRGB", "its EXIF colour space")
    if statement.states_curve and not usual:
        curve = "encoded by a curve of its own" if statement.encoding is None else encoding_name(encoding)
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
