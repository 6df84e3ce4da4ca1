"""What a TIFF states of its values: curve and colours, functions of calibration, scale, offset, unit and bits."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.disk.files import shortened
from ..core.result import Finding, info, warning
from .statements import (
    NOTHING_STATED,
    FileStatements,
    numbers_of,
    positive_number,
    stated_by_exif,
    stated_by_profile,
)

# Tags (TIFF 6.0, sections 20 and 22; TIFF Technical Note on SGI LogLuv; GDAL's own).
_TRANSFER_FUNCTION, _WHITE_POINT, _PRIMARIES, _REFERENCE, _STONITS = 301, 318, 319, 532, 37439
_GDAL_METADATA, _GDAL_NODATA, _ICC_PROFILE, _EXIF = 42112, 42113, 34675, 34665
#: Tags of the least and the largest value: SMinSampleValue before MinSampleValue; others that are named.
_LEAST, _LARGEST = (340, 280), (341, 281)
_UNUSED = {291: "GrayResponseCurve", 342: "TransferRange"}
#: Units of luminance as programs write them.
_LUMINANCE = re.compile(r"(cd|candela)\s*[/·. ]?\s*m\s*(\^?-?2|²|⁻²)|nits?|cd/m\^2|cd\.m-2", re.IGNORECASE)
#: Functions of calibration by ImageJ's number (its `CurveFitter`), of stored values x and parameters p.
_FUNCTIONS: dict[int, Any] = {
    **dict.fromkeys((1, 2, 3), lambda x, p: np.polynomial.polynomial.polyval(x, p)),
    4: lambda x, p: p[0] * np.exp(p[1] * x),
    5: lambda x, p: p[0] * x ** p[1],
    6: lambda x, p: p[0] * np.log(p[1] * x),
    7: lambda x, p: p[3] + (p[0] - p[3]) / (1 + (x / p[2]) ** p[1]),
    8: lambda x, p: np.where(x > p[0], p[1] * (x - p[0]) ** p[2] * np.exp(-(x - p[0]) / p[3]), 0),
    9: lambda x, p: p[0] + p[1] * np.log(x - p[2]),
    11: lambda x, p: p[0] * np.exp(-p[1] * x) + p[2],
    13: lambda x, p: p[0] * (1 - np.exp(-p[1] * x)) + p[2],
}
_STRAIGHT_LINE = 0


@dataclass(frozen=True)
class ValueScale:
    """What stored values stand for.

    Parameters
    ----------
    by : str
        What of the file states it.
    parameters : tuple of float
        Of the function, offset and factor of a straight line.
    function : int
        ImageJ's number; 0 for a straight line.
    unit : str
        Unit of the values, empty if none is stated.
    """

    by: str
    parameters: tuple[float, ...]
    function: int = _STRAIGHT_LINE
    unit: str = ""

    @property
    def is_luminance(self) -> bool:
        """Whether the unit is that of luminance."""
        return _LUMINANCE.fullmatch(self.unit.strip()) is not None

    @property
    def changes(self) -> bool:
        """Whether values differ from those that are stored."""
        return self.function != _STRAIGHT_LINE or self.parameters != (0.0, 1.0)

    def black_dn(self, top_dn: float) -> float | None:
        """Return the stored value that stands for 0 on a rising line, also below 0; None if it is above all."""
        if self.function != _STRAIGHT_LINE or not self.parameters[1] > 0:
            return None
        zero = -self.parameters[0] / self.parameters[1]
        return zero if zero <= top_dn else None

    def values(self, stored: NDArray[Any]) -> NDArray[np.float64]:
        """Return the values of what is stored; not finite where the function is not defined."""
        x = stored.astype(np.float64)
        if self.function == _STRAIGHT_LINE:
            return np.asarray(self.parameters[0] + self.parameters[1] * x)
        with np.errstate(all="ignore"):
            return np.asarray(_FUNCTIONS[self.function](x, self.parameters))

    @property
    def finding(self) -> Finding:
        """Return what was done with the values."""
        unit = shortened(self.unit, 30) or "none"
        if self.function != _STRAIGHT_LINE:
            return info("values-by-function", by=self.by, function=self.function, unit=unit)
        offset, factor = self.parameters
        return info("values-scaled", by=self.by, offset=offset, factor=factor, unit=unit)


@dataclass(frozen=True)
class TiffStatements:
    """What a page states.

    Parameters
    ----------
    curve : FileStatements
        Curve and colours.
    scale : ValueScale or None
        What stored values stand for.
    bits : int or None
        Bits that are used.
    cd_m2_per_value : float or None
        Luminance of the value 1.
    nodata : float or None
        Value of pixels without data.
    findings : tuple of Finding
        What is not used.
    """

    curve: FileStatements = NOTHING_STATED
    scale: ValueScale | None = None
    bits: int | None = None
    cd_m2_per_value: float | None = None
    nodata: float | None = None
    findings: tuple[Finding, ...] = field(default=())


def statements_of(page: Any, coloured: bool, bits: int | None, of_sensor: bool) -> TiffStatements:
    """Return what a page states of its values.

    Parameters
    ----------
    page : tifffile.TiffPage
        The page; a description counts for all pages of a file.
    coloured : bool
        Whether it has red, green and blue.
    bits : int or None
        Bits of its whole numbers, None for floats.
    of_sensor : bool
        Whether other tags state that the values are those of a sensor.
    """
    text = str(page.parent.pages.first.aspage().description or "")
    tags = {code: tag.value for code in _READ if (tag := page.tags.get(code)) is not None}
    scale, findings = _imagej(text) if text.startswith("ImageJ=") else _gdal(str(tags.get(_GDAL_METADATA, "")))
    if coloured and scale is not None and scale.changes:
        findings, scale = (*findings, warning("value-scale-not-used", by=scale.by)), None
    reference = tags.get(_REFERENCE)
    if bits is not None and reference is not None and _is_other_range(reference, bits):
        findings = (*findings, warning("reference-black-white-not-used"))
    used, unused = _used_bits(text, tags, bits)
    others = tuple(
        warning("value-scale-not-used", by=f"its tag {name}") for code, name in _UNUSED.items() if code in tags
    )
    findings = (*findings, *unused, *others)
    stonits = positive_number(tags.get(_STONITS))
    if stonits is not None and bits is not None:
        findings = (*findings, warning("stonits-not-used", cd_m2=stonits))
    nodata = None
    with suppress(ValueError):
        nodata = float(str(tags.get(_GDAL_NODATA, "")).strip("\0 "))
    return TiffStatements(
        curve=_curve(page, tags, coloured, bits, of_sensor),
        scale=scale if scale is not None and (scale.changes or scale.is_luminance) else None,
        bits=used,
        cd_m2_per_value=stonits,
        nodata=nodata,
        findings=findings,
    )


_READ = (
    _TRANSFER_FUNCTION, _WHITE_POINT, _PRIMARIES, _REFERENCE, _STONITS, _GDAL_METADATA, _GDAL_NODATA, _ICC_PROFILE,
    _EXIF, *_LEAST, *_LARGEST, *_UNUSED,
)  # fmt: skip


def _used_bits(text: str, tags: dict[int, Any], bits: int | None) -> tuple[int | None, tuple[Finding, ...]]:
    """Return the bits in use by OME, or by a range of values that is all of them; and a finding on another range."""
    significant = re.search(r'\bSignificantBits="(\d{1,2})"', text) if "<OME" in text[:2000] else None
    used = int(significant[1]) if significant else 0
    low, high = (_number(next((tags[code] for code in codes if code in tags), None)) for codes in (_LEAST, _LARGEST))
    findings: tuple[Finding, ...] = ()
    if high is not None:
        low = low or 0.0
        of_range = int(high).bit_length() if 0 < high < 2**16 else 0
        if bits is None or (low, high) != (0, 2**of_range - 1):
            findings = (info("sample-range-not-used", low=low, high=high),)
        else:
            used = used or of_range
    return (used if bits is not None and 0 < used < bits else None), findings


def _number(value: Any) -> float | None:
    """Return the first number of a tag; None for anything else."""
    with suppress(TypeError, ValueError, IndexError):
        number = float(np.ravel(value)[0])
        return number if np.isfinite(number) else None
    return None


def _curve(page: Any, tags: dict[int, Any], coloured: bool, bits: int | None, of_sensor: bool) -> FileStatements:
    profile = tags.get(_ICC_PROFILE)
    stated = stated_by_profile(profile if isinstance(profile, bytes) else None, coloured, bits or 8)
    if stated.states_curve and bits is not None:
        return stated
    colours = _exif_colours(tags, page)
    by_tags = stated_by_exif(bits or 8, **colours)
    if bits is None:
        # Floats are linear; of profile and tags only the colours count.
        why, unused = "the values are floats, which are linear", list[Finding]()
        if stated.states_curve and stated.encoding != "linear":
            unused.append(warning("icc-profile-not-used", reason=why))
        if by_tags.states_curve and by_tags.encoding != "linear":
            unused.append(warning("curve-not-used", by=by_tags.stated_by, reason=why))
        weights = stated.weights if stated.states_curve else by_tags.weights
        return FileStatements(weights=weights, findings=(*stated.findings, *unused))
    findings = (*by_tags.findings, *stated.findings)
    linear = stated_by_exif(bits, **{name: colours[name] for name in ("table", "white", "primaries")})
    if of_sensor and by_tags.stated_by != linear.stated_by:
        # Cameras write the colour space of their JPEG files into raw ones too.
        why = "with a black level or a table of linearisation, the values are those of a sensor"
        return replace(linear, findings=(*findings, warning("curve-not-used", by=by_tags.stated_by, reason=why)))
    return replace(by_tags, findings=findings)


def _exif_colours(tags: dict[int, Any], page: Any) -> dict[str, Any]:
    exif = tags.get(_EXIF)
    exif = exif if isinstance(exif, dict) else {}
    index = _interoperability(page.parent, exif.get("InteroperabilityTag"))
    return {
        "gamma": exif.get("Gamma"),
        "space": exif.get("ColorSpace"),
        "interoperability": index,
        "table": tags.get(_TRANSFER_FUNCTION),
        "white": tags.get(_WHITE_POINT),
        "primaries": tags.get(_PRIMARIES),
    }


def _interoperability(tiff: Any, offset: Any) -> str | None:
    """Index of a directory that tifffile does not read, in its first entry (CIPA DC-008, 4.6.7)."""
    if not isinstance(offset, int) or tiff.is_bigtiff:
        return None
    tiff.filehandle.seek(offset)
    entry = tiff.filehandle.read(14)
    return entry[10:13].decode("latin-1") if entry[2:4] in (b"\1\0", b"\0\1") else None


def _is_other_range(value: Any, bits: int) -> bool:
    numbers, top = numbers_of(value), 2.0**bits - 1
    return bool(numbers) and numbers != [0.0, top] * (len(numbers) // 2)


def _imagej(text: str) -> tuple[ValueScale | None, tuple[Finding, ...]]:
    """Return ImageJ's function of calibration (keys cf, c0 to c4, vunit), and a finding if it is not read."""
    lines = dict(line.partition("=")[::2] for line in text.splitlines())
    if "cf" not in lines:
        return None, ()
    by, unit = "ImageJ's calibration function", lines.get("vunit", "").strip()
    try:
        function = int(float(lines["cf"]))
        parameters = tuple(float(lines[f"c{number}"]) for number in range(5) if f"c{number}" in lines)
        fewest = {_STRAIGHT_LINE: 2, 1: 3, 2: 4, 3: 5, 4: 2, 5: 2, 6: 2, 7: 4, 8: 4, 9: 3, 11: 3, 13: 3}[function]
        if len(parameters) < fewest or not np.isfinite(parameters).all():
            raise ValueError
    except (ValueError, KeyError, OverflowError):
        return None, (warning("value-scale-not-used", by=f"{by} {shortened(lines['cf'], 20)}"),)
    return ValueScale(by, parameters[:fewest], function, "" if unit.lower() == "gray value" else unit), ()


def _gdal(text: str) -> tuple[ValueScale | None, tuple[Finding, ...]]:
    """Return scale and offset of GDAL's metadata, an XML text with items of these roles; and a finding if unusable."""
    items = {"scale": "1", "offset": "0", "unittype": ""}
    is_stated = False
    for attributes, value in re.findall(r"<Item\b([^>]*)>([^<]*)</Item>", text[:100_000]):
        role = re.search(r"""\brole\s*=\s*["'](scale|offset|unittype)["']""", attributes)
        if role is not None:
            items[role[1]], is_stated = value, True
    if not is_stated:
        return None, ()
    by = "GDAL's scale and offset"
    with suppress(ValueError):
        parameters = float(items["offset"]), float(items["scale"])
        if np.isfinite(parameters).all() and parameters[1] != 0:
            return ValueScale(by, parameters, unit=items["unittype"]), ()
    return None, (warning("value-scale-not-used", by=by),)


def share_at_end(stored: NDArray[Any], bits: int) -> float:
    """Share of the pixels at the end of the scale, which are saturated."""
    return float(np.mean(stored >= 2**bits - 1))


def nodata_findings(values: NDArray[Any], nodata: float | None) -> Sequence[Finding]:
    """Return a finding if pixels have the value that stands for none."""
    if nodata is None or not (share := float(np.mean(values == nodata))) > 0:
        return ()
    return (warning("nodata-values", value=nodata, share=share),)
