"""What the tags of a TIFF, a TIFF-based RAW or a PNG say about how a picture was taken."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from io import BytesIO
from itertools import islice
from math import hypot, isfinite, log10
from pathlib import Path
from typing import Any

from ..core.disk.tiff import MOST_PAGES, require_end
from ..core.errors import InputError

#: Diagonal of 36 mm x 24 mm.
_FILM_DIAGONAL_M = hypot(36e-3, 24e-3)
#: Metres by FocalPlaneResolutionUnit: inch, centimetre, and millimetre and micrometre that some cameras write.
_UNITS_M = {2: 25.4e-3, 3: 1e-2, 4: 1e-3, 5: 1e-6}
#: ISO speed that counts as a gain of 0 dB.
_ISO_OF_0_DB = 100.0
_EXIF = 34665
#: Tags in the EXIF directory of names that TIFF/EP has for others.
_OF_EXIF = {"FocalPlaneXResolution": 41486, "FocalPlaneResolutionUnit": 41488}
_STRIPS, _TILES = (273, 279), (324, 325)


@dataclass(frozen=True)
class ExifFacts:
    """Facts from the tags (CIPA DC-008, Exif 2.32; Adobe DNG 1.7), None or empty where a file does not say.

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

    @property
    def gain_db(self) -> float | None:
        """20 log10(ISO / 100), as twice the speed is twice the DN; None if the ISO speed is not known."""
        return 20 * log10(self.iso / _ISO_OF_0_DB) if self.iso else None


#: Of a file that says nothing.
NOTHING_SAID = ExifFacts()


def read_exif(data: bytes, path: Path, whole: bool = True) -> ExifFacts:
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
    ExifFacts
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
        return ExifFacts()
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
    return _facts(merged, largest)


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
    if not all(isinstance(one, int) for one in several):
        raise InputError(
            f"{path} is damaged: where its pixels are is {str(value)[:40]!r} and no number: copy or save it again"
        )
    return tuple(several)


def _facts(tags: Mapping[int, Any], largest: Mapping[int, Any]) -> ExifFacts:
    focal_length_mm = positive_number(tags.get(37386))
    photometric = positive_number(largest.get(262))
    of_film_mm, per_unit = positive_number(tags.get(41989)), positive_number(tags.get(41486))
    unit_m = _UNITS_M.get(int(positive_number(tags.get(41488)) or 2))
    pixel_pitch_m = unit_m / per_unit if unit_m and per_unit else None
    columns = positive_number(tags.get(40962))
    orientation = int(positive_number(tags.get(274)) or 1)
    return ExifFacts(
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


def positive_number(value: Any) -> float | None:
    """Positive number of a tag that may be a fraction or a list of one; None if it is nothing of that."""
    try:
        if isinstance(value, tuple | list):
            value = value[0] / value[1] if len(value) == 2 else value[0]
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError, IndexError, OverflowError):
        return None
    return number if isfinite(number) and number > 0 else None


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
