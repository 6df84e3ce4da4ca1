"""What the tags of a TIFF, a TIFF-based RAW or a PNG say about how a picture was taken."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime, timedelta
from io import BytesIO
from itertools import islice
from pathlib import Path
from typing import Any

from ..core.disk.tiff import MOST_PAGES, require_end
from ..core.errors import InputError
from .statements import NOTHING_STATED, FileStatements, positive_number

#: Metres by FocalPlaneResolutionUnit: inch, centimetre, and millimetre and micrometre that some cameras write.
_UNITS_M = {2: 25.4e-3, 3: 1e-2, 4: 1e-3, 5: 1e-6}
_EXIF = 34665
#: Tags in the EXIF directory of names that TIFF/EP has for others.
_OF_EXIF = {"FocalPlaneXResolution": 41486, "FocalPlaneResolutionUnit": 41488}
_STRIPS, _TILES = (273, 279), (324, 325)


def read_exif(data: bytes, path: Path, whole: bool = True) -> FileStatements:
    """Read the tags, and check that all pixels they point to are in the file if it is the whole one.

    Parameters
    ----------
    data : bytes
        The whole file, or the EXIF block of one.
    path : Path
        For messages.
    whole : bool
        Whether `data` is the whole file; the block of one may name pixels of another, of which it was made.

    Returns
    -------
    FileStatements
        Nothing known if `data` is no TIFF.

    Raises
    ------
    InputError
        If the file ends before the pixels do, does not say where they are, or its list of pages does not end.
    """
    import tifffile

    require_end(data, path)
    try:
        with tifffile.TiffFile(BytesIO(data)) as tiff:
            pages = [page.aspage() for page in tiff.pages]
            # Of a damaged file the list of those below may be long.
            pages += [below.aspage() for page in pages for below in islice(page.pages or (), MOST_PAGES)]
            directories = [{tag.code: tag.value for tag in page.tags.values()} for page in pages]
    # tifffile meets a damaged directory with whatever its parts raise.
    except Exception:
        return NOTHING_STATED
    for tags in directories if whole else ():
        _require_whole(tags, len(data), path)
    # The first directory that has a tag counts.
    merged = {code: value for tags in reversed(directories) for code, value in tags.items()}
    exif = merged.get(_EXIF)
    if isinstance(exif, dict):
        codes = tifffile.TIFF.EXIF_TAGS
        # Names of several tags, such as CFAPattern, do not say which of them it is.
        of_name = {name: _OF_EXIF.get(name) or codes[name] for name in exif if name in _OF_EXIF or _is_one(codes, name)}
        merged |= {code: exif[name] for name, code in of_name.items()}
    largest = max(directories, key=lambda tags: positive_number(tags.get(256)) or 0, default={})
    return _statements(merged, largest)


def _is_one(codes: Any, name: str) -> bool:
    return len(codes.getall(name, ())) == 1


def _require_whole(tags: Mapping[int, Any], size: int, path: Path) -> None:
    for offsets, counts in (_STRIPS, _TILES):
        starts, lengths = (_whole_numbers(tags.get(code), path) for code in (offsets, counts))
        end = max((start + length for start, length in zip(starts, lengths, strict=False)), default=0)
        if end > size:
            raise InputError(
                f"{path} is truncated: its pixels reach to byte {end}, it has {size}: copy it again from the camera"
            )


def _whole_numbers(value: Any, path: Path) -> tuple[int, ...]:
    """Value of an integer tag; a damaged one can be anything."""
    several = () if value is None else value if isinstance(value, tuple | list) else (value,)
    if not all(isinstance(number, int) for number in several):
        raise InputError(
            f"{path} is damaged: where its pixels are is {str(value)[:40]!r} and no number: copy or save it again"
        )
    return tuple(several)


def _statements(tags: Mapping[int, Any], largest: Mapping[int, Any]) -> FileStatements:
    focal_length_mm = positive_number(tags.get(37386))
    photometric = positive_number(largest.get(262))
    of_film_mm, per_unit = positive_number(tags.get(41989)), positive_number(tags.get(41486))
    unit_m = _UNITS_M.get(int(positive_number(tags.get(41488)) or 2))
    pixel_pitch_m = unit_m / per_unit if unit_m and per_unit else None
    columns = positive_number(tags.get(40962))
    orientation = int(positive_number(tags.get(274)) or 1)
    return FileStatements(
        exposure_s=positive_number(tags.get(33434)),
        f_number=positive_number(tags.get(33437)),
        focal_length_m=focal_length_mm / 1000 if focal_length_mm else None,
        iso=positive_number(tags.get(34855)),
        vendor=_text(tags.get(271)),
        model=_text(tags.get(272)) or _text(tags.get(50708)),
        serial=_text(tags.get(50735)) or _text(tags.get(42033)),
        taken=_time(tags),
        orientation=orientation if orientation in range(1, 9) else 1,
        photometric=None if photometric is None else int(photometric),
        has_cfa_pattern=33422 in tags,
        focal_length_35mm_m=of_film_mm / 1000 if of_film_mm else None,
        # Others are damaged or no pixels: no sensor has them.
        pixel_pitch_m=pixel_pitch_m if pixel_pitch_m is not None and 1e-7 < pixel_pitch_m < 1e-3 else None,
        width_px=None if columns is None else int(columns),
    )


def _text(value: Any) -> str:
    if isinstance(value, bytes):
        value = value.decode("latin-1")
    return " ".join(value.replace("\x00", " ").split()) if isinstance(value, str) else ""


def _time(tags: Mapping[int, Any]) -> datetime | None:
    text, offset, fraction = (_text(tags.get(code)) for code in (36867, 36881, 37521))
    try:
        taken = datetime.strptime(f"{text or _text(tags.get(306))}{offset}", "%Y:%m:%d %H:%M:%S" + "%z" * bool(offset))
        return taken.astimezone() + timedelta(seconds=float(f"0.{fraction}") if fraction.isdigit() else 0.0)
    except (ValueError, OverflowError, OSError):
        return None
