"""What the tags of DNG, and of raw TIFF files of cameras, state of DN before they are light.

Adobe DNG 1.7, chapters 4 and 7: a pixel's black level is that of its place in a repeating group, and what its column
and row add. Multispectral cameras write the same tags, or XMP, into TIFF files.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.disk.tiff import open_tiff, pixels_of
from ..core.errors import InputError
from ..core.frame import BlackPattern
from ..core.result import Finding, info, warning

#: Photometric interpretations of the values of a sensor: behind a colour filter array, and linear.
CFA, _LINEAR_RAW = 32803, 34892
_DNG_VERSION, _LINEARIZATION, _REPEAT, _BLACK, _DELTA_H, _DELTA_V, _WHITE = (
    50706,
    50712,
    50713,
    50714,
    50715,
    50716,
    50717,
)
_ACTIVE, _MASKED, _OPCODES, _XMP, _SAMPLE_FORMAT, _FLOATS = 50829, 50830, (51008, 51009, 51022), 700, 339, 3
#: Tags that change what values stand for.
LEVELS = (_LINEARIZATION, _BLACK, _DELTA_H, _DELTA_V, _WHITE)
#: Types of TIFF whose numbers are fractions.
_RATIONAL = (5, 10)
#: Opcodes by number (DNG 1.7, chapter 7), and those that leave the DN of sound pixels as they are.
_OPCODE_NAMES = {
    1: "WarpRectilinear", 2: "WarpFisheye", 3: "FixVignetteRadial", 4: "FixBadPixelsConstant", 5: "FixBadPixelsList",
    6: "TrimBounds", 7: "MapTable", 8: "MapPolynomial", 9: "GainMap", 10: "DeltaPerRow", 11: "DeltaPerColumn",
    12: "ScalePerRow", 13: "ScalePerColumn", 14: "WarpRectilinear2",
}  # fmt: skip
_OF_GEOMETRY = (
    "WarpRectilinear",
    "WarpFisheye",
    "FixBadPixelsConstant",
    "FixBadPixelsList",
    "TrimBounds",
    "WarpRectilinear2",
)
#: Black levels in XMP: of DJI, and the masked rows of MicaSense, which count where there is no tag.
_XMP_BLACK = ("BlackLevel", "BlackCurrent", "DarkRowValue")
#: Corrections in XMP of MicaSense, Parrot and DJI that differ by place or bend the response.
_XMP_CORRECTIONS = (
    "RadiometricCalibration", "VignettingPolynomial", "VignettingPolynomial2D", "VignettingData", "SensorModel",
)  # fmt: skip
#: Masked pixels from which their mean is a black level, and how far it may be from the one that is stated, in DN and as
#: a part of the range.
_LEAST_MASKED, _BLACK_DN, _BLACK_PART = 64, 2.0, 0.002


@dataclass(frozen=True, eq=False)
class SensorTags:
    """What the tags state; DN are those of the file.

    Parameters
    ----------
    is_dng : bool
        Whether the file is DNG.
    is_float : bool
        Whether its values are floats.
    black : (ndarray, ndarray or None, ndarray or None) or None
        Levels of a group of pixels, and what columns and rows add, from the first pixel of `active` on; None if they
        are not stated.
    white : float or None
        Value from which a pixel is saturated.
    linearization : ndarray or None
        DN by stored value.
    active : (int, int)
        First row and column of the area that the black levels begin with.
    masked : tuple of (int, int, int, int)
        Masked pixels: top, left, bottom, right.
    findings : tuple of Finding
        What is stated and not applied, or taken from elsewhere.
    """

    is_dng: bool
    is_float: bool
    black: tuple[NDArray[Any], NDArray[Any] | None, NDArray[Any] | None] | None
    white: float | None
    linearization: NDArray[Any] | None
    active: tuple[int, int]
    masked: tuple[tuple[int, ...], ...]
    findings: tuple[Finding, ...]

    @property
    def beyond_colours(self) -> bool:
        """Whether black levels are stated that differ by more than the colour of the pixel."""
        if self.black is None:
            return False
        group, *lines = self.black
        return max(group.shape) > 2 or any(line is not None for line in lines)

    def black_of(
        self, corner: tuple[int, int], shape: tuple[int, int], path: Path, per_value: float = 1.0
    ) -> tuple[float, BlackPattern | None] | None:
        """Black level of a part of the image, and the pattern around it; None if it is not stated.

        Parameters
        ----------
        corner, shape : (int, int)
            First row and column of the part, and its height and width.
        path : Path
            For messages.
        per_value : float
            DN of the frame that a value of the file stands for.

        Raises
        ------
        InputError
            If the differences by column or row are not as many as the part has.
        """
        if self.black is None:
            return None
        starts = [at - first for at, first in zip(corner, self.active, strict=True)]
        group, *lines = self.black
        parts: list[NDArray[Any] | None] = []
        for values, start, size, what in zip(lines, starts[::-1], shape[::-1], ("columns", "rows"), strict=True):
            if values is None:
                parts.append(None)
                continue
            part = values[max(start, 0) : start + size]
            if len(part) != size:
                raise InputError(
                    f"{path} states differences of the black level for {len(values)} {what}, it has {size}: convert it "
                    "to 16-bit TIFF"
                )
            parts.append(part * per_value)
        return BlackPattern.split(np.roll(group, [-start for start in starts], (0, 1)) * per_value, *parts)


def sensor_tags(data: bytes, path: Path) -> SensorTags | None:
    """Read the tags of the sensor's picture in a file; None if it is no TIFF, or has none of them.

    Raises
    ------
    InputError
        If a black level has other numbers than its group.
    """
    if data[:2] not in (b"II", b"MM"):
        return None
    try:
        with open_tiff(data, path) as tiff:
            page = _sensor_page(tiff)
            first = tiff.pages.first.aspage()
            return None if page is None else tags_of(page, path, _DNG_VERSION in first.tags)
    except InputError:
        # LibRaw reads files that are TIFF only in part.
        return None


def tags_of(page: Any, path: Path, is_dng: bool = False) -> SensorTags:
    """Read the tags of a picture; raises InputError as `sensor_tags`."""
    numbers = {tag.code: _numbers(tag) for tag in page.tags.values() if tag.code in _NUMBERS}
    xmp = _xmp_values(page.tags.get(_XMP))
    black, findings = _black(numbers, xmp, path)
    named = _opcodes([page.tags.get(code) for code in _OPCODES]) + [name for name in _XMP_CORRECTIONS if name in xmp]
    if named:
        bends = [name for name in named if name not in _OF_GEOMETRY]
        findings.append(
            (warning if bends else info)("sensor-corrections-not-applied", names=list(dict.fromkeys(named)))
        )
    white, table = numbers.get(_WHITE), numbers.get(_LINEARIZATION)
    if table and is_dng:
        findings.append(info("linearization-applied"))
    active = numbers.get(_ACTIVE) or (0, 0)
    masked = numbers.get(_MASKED) or ()
    is_float = numbers.get(_SAMPLE_FORMAT, (1,))[0] == _FLOATS
    return SensorTags(
        is_dng=is_dng,
        is_float=is_float,
        black=black,
        white=min(white) if white and min(white) > 0 else None,
        linearization=np.array(table) if table else None,
        active=(int(active[0]), int(active[1])),
        masked=tuple(tuple(int(number) for number in masked[at : at + 4]) for at in range(0, len(masked) - 3, 4)),
        findings=tuple(findings),
    )


def _sensor_page(tiff: Any) -> Any:
    """Return the largest picture of a sensor's values; None if there is none."""
    pages = [page.aspage() for page in tiff.pages]
    pages += [below.aspage() for page in pages for below in page.pages or ()]
    # A size of a wrong type is text: times another it fills the memory.
    sensors = [
        page
        for page in pages
        if page.photometric in (CFA, _LINEAR_RAW) and {type(page.imagewidth), type(page.imagelength)} == {int}
    ]
    return max(sensors, key=lambda page: page.imagewidth * page.imagelength, default=None)


def float_values(data: bytes, path: Path) -> NDArray[np.float64]:
    """Decode the values of a DNG of floats; raises InputError if that fails."""
    with open_tiff(data, path) as tiff:
        return np.asarray(pixels_of(_sensor_page(tiff), path), dtype=np.float64)


_NUMBERS = (_LINEARIZATION, _REPEAT, _BLACK, _DELTA_H, _DELTA_V, _WHITE, _ACTIVE, _MASKED, _SAMPLE_FORMAT)


def _numbers(tag: Any) -> tuple[float, ...]:
    several = isinstance(tag.value, tuple | list | bytes | np.ndarray)
    values = tuple(np.ravel(tag.value).tolist() if isinstance(tag.value, np.ndarray) else tag.value) if several else ()
    values = values if several else (tag.value,)
    if not all(isinstance(number, int | float) for number in values):
        return ()
    if int(tag.dtype) in _RATIONAL:
        return tuple(a / b if b else 0.0 for a, b in zip(values[::2], values[1::2], strict=False))
    return tuple(values)


def _black(
    numbers: Mapping[int, tuple[float, ...]], xmp: Mapping[str, tuple[float, ...]], path: Path
) -> tuple[tuple[NDArray[Any], NDArray[Any] | None, NDArray[Any] | None] | None, list[Finding]]:
    levels, findings = numbers.get(_BLACK, ()), list[Finding]()
    across, down = (np.array(values) if (values := numbers.get(code)) else None for code in (_DELTA_H, _DELTA_V))
    repeat = [int(number) for number in numbers.get(_REPEAT, (1, 1))][:2]
    if not levels:
        name = next((name for name in _XMP_BLACK if xmp.get(name)), None)
        if name is None and across is None and down is None:
            return None, []
        levels, repeat = (0.0,), [1, 1]
        if name is not None:
            # Of masked rows, MicaSense states one number for each.
            levels = (float(np.mean(xmp[name])),)
            findings.append(info("black-level-from-xmp", name=name, black_dn=levels[0]))
    if len(repeat) != 2 or min(repeat) < 1 or len(levels) < repeat[0] * repeat[1]:
        raise InputError(f"{path} states {len(levels)} black levels for a group of {repeat}: convert it to 16-bit TIFF")
    if len(levels) > repeat[0] * repeat[1] == 1:
        # Without the size of the group it is not known which level is whose.
        levels = (float(np.mean(levels)),)
    group = np.array(levels[: repeat[0] * repeat[1]], dtype=float).reshape(repeat)
    return (group, across, down), findings


def _opcodes(tags: Sequence[Any]) -> list[str]:
    """Names of the opcodes in lists of them: their number, then number, version, flags and length of each."""
    names: list[str] = []
    for tag in tags:
        data = bytes(tag.value) if tag is not None and isinstance(tag.value, bytes | bytearray) else b""
        at = 4
        for _ in range(int.from_bytes(data[:4], "big")):
            if at + 16 > len(data):
                break
            code = int.from_bytes(data[at : at + 4], "big")
            names.append(_OPCODE_NAMES.get(code, f"opcode {code}"))
            at += 16 + int.from_bytes(data[at + 12 : at + 16], "big")
    return names


_NUMBER = re.compile(r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")


def _xmp_values(tag: Any) -> dict[str, tuple[float, ...]]:
    """Numbers of the XMP properties that matter here, as attributes or elements, whatever their name space."""
    if tag is None or not isinstance(tag.value, bytes | str):
        return {}
    text = tag.value.decode("utf-8", "replace") if isinstance(tag.value, bytes) else tag.value
    values_by_name = {}
    for name in (*_XMP_BLACK, *_XMP_CORRECTIONS):
        match = re.search(
            rf'[\w-]+:{name}\s*=\s*"([^"]*)"|<[\w-]+:{name}\b[^>]*>(.*?)</[\w-]+:{name}>', text, re.DOTALL
        )
        if match:
            values = re.sub(r"<[^>]*>", " ", match[1] or match[2] or "")
            values_by_name[name] = tuple(float(number) for number in _NUMBER.findall(values))
    return values_by_name


def masked_level(
    dn: NDArray[Any], masked: Sequence[Sequence[int]], group: tuple[int, int]
) -> NDArray[np.float64] | None:
    """Mean DN of masked pixels by their place in a group of rows and columns; None if there are too few."""
    sums, counts = np.zeros(group), np.zeros(group)
    for top, left, bottom, right in masked:
        part = dn[top:bottom, left:right].astype(np.float64)
        for y in range(group[0]):
            for x in range(group[1]):
                values = part[(y - top) % group[0] :: group[0], (x - left) % group[1] :: group[1]]
                sums[y, x] += values.sum()
                counts[y, x] += values.size
    return None if counts.min() < _LEAST_MASKED else sums / counts


def masked_findings(stated_dn: float, measured_dn: float, range_dn: float) -> tuple[Finding, ...]:
    """Find that masked pixels show another black level than the file states."""
    if abs(stated_dn - measured_dn) <= max(_BLACK_DN, _BLACK_PART * range_dn):
        return ()
    return (warning("black-level-contradicted", stated_dn=stated_dn, measured_dn=measured_dn),)


def pattern_findings(pattern: BlackPattern | None) -> tuple[Finding, ...]:
    """Say that black levels differ from pixel to pixel."""
    if pattern is None:
        return ()
    spread_dn = sum(float(np.ptp(np.array(part))) for part in (pattern.group, pattern.columns, pattern.rows) if part)
    return (info("black-pattern", spread_dn=spread_dn),)
