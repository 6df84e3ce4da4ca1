"""Camera RAW files as frames: the DN of the sensor as the camera stored them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from io import BytesIO
from itertools import combinations
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.frame import BlackPattern
from ..core.result import Finding, info
from .exif import read_exif
from .frame import FileFrame, Scale, changed_at, make_frame, picture_bytes, require_exposure, statements_over
from .picture import PictureOptions
from .sensor_tags import (
    CFA,
    SensorTags,
    float_values,
    masked_findings,
    masked_level,
    pattern_findings,
    sensor_tags,
)
from .statements import FileStatements, positive_number
from .stored_image import MAX_PIXELS, require_size


def read_raw(path: str | PathLike[str], options: PictureOptions, max_pixels: int = MAX_PIXELS) -> FileFrame:
    """Read a camera RAW file (CR2, CR3, NEF, ARW, DNG and whatever else LibRaw knows).

    The pixels are those of the visible area, not corrected in any way but by the table of linearisation of the file;
    floats are scaled to 16 bits. `black_level_dn` is the mean of the pixels' black levels, `black_pattern` what each
    adds to it, and `saturation_dn` the lowest of the white levels. The gain is 20 log10(ISO / 100).

    Parameters
    ----------
    path : path
        The file.
    options : PictureOptions
        Exposure, gain and camera where the file does not say.
    max_pixels : int
        Pixels from which it is refused before it is decoded.

    Raises
    ------
    InputError
        If the file cannot be read, is truncated, is no RAW file, has neither a Bayer pattern nor a monochrome sensor,
        or does not say its exposure.

    Examples
    --------
    >>> from pathlib import Path
    >>> from labcdp import InputError
    >>> from labcdp.files import PictureOptions, read_raw
    >>> written = Path("no-raw.dng").write_bytes(bytes(1000))
    >>> try:
    ...     read_raw("no-raw.dng", PictureOptions(exposure_s=0.01))
    ... except InputError as error:
    ...     print(error)
    no-raw.dng is not a camera RAW file that LibRaw knows: give one, or convert it to 16-bit TIFF
    """
    path = Path(path)
    data, sha256 = picture_bytes(path, max_pixels)
    statements = read_exif(data, path)
    stated = sensor_tags(data, path)
    with _opened(data, path) as raw:
        require_size(path, raw.sizes.raw_width, raw.sizes.raw_height, max_pixels)
        colour_filter, group = _pattern(raw, path, statements)
        whole, white = np.array(raw.raw_image), int(raw.white_level)
        corner = raw.sizes.top_margin, raw.sizes.left_margin
        shape = raw.raw_image_visible.shape
        levels = (level for level in raw.camera_white_level_per_channel or () if level > 0)
        saturation_dn = float(min([white, *levels]))
        statements = _completed(statements, raw.other)
    per_value, findings = 1.0, list[Finding]()
    if stated is not None and stated.is_dng and stated.is_float:
        whole, per_value = _scaled(float_values(data, path), stated.white or 1.0)
        white, saturation_dn = _TOP_DN, float(_TOP_DN)
        group = np.zeros((1, 1))
        findings.append(info("float-raw-scaled", white=stated.white or 1.0, top_dn=_TOP_DN))
    if whole.ndim != 2:
        raise InputError(
            f"{path} holds no rows and columns of one value a pixel, which labcdp does not read: convert it to 16-bit "
            "TIFF"
        )
    dn = whole[corner[0] : corner[0] + shape[0], corner[1] : corner[1] + shape[1]].copy()
    dn.flags.writeable = False
    bit_depth = min(max(white.bit_length(), 8), 16)
    (black_dn, pattern), more = _black(whole, corner, (dn.shape[0], dn.shape[1]), group, white, stated, path, per_value)
    known = replace(
        statements_over(options, statements), black_level_dn=black_dn, saturation_dn=None, pixel_format=None
    )
    require_exposure(path, known)
    frame = replace(
        make_frame(dn, Scale(bit_depth, saturation_dn), known, statements.taken or changed_at(path)),
        pixel_format=f"{f'Bayer{colour_filter}' if colour_filter else 'Mono'}{bit_depth}",
        colour_filter=colour_filter,
        black_pattern=pattern,
    )
    clips_at_dn = clipping_dn(dn, colour_filter, black_dn, white)
    early = clips_at_dn is not None and clips_at_dn < saturation_dn
    return FileFrame(path, sha256, statements, frame, clips_at_dn if early else None, (*findings, *more))


#: Highest DN of floats, which are scaled to 16 bits.
_TOP_DN = 65535


def _scaled(values: NDArray[np.float64], white: float) -> tuple[NDArray[np.uint16], float]:
    """DN of floats of which this one is saturated, and DN a float stands for; what is no number is 0."""
    per_value = _TOP_DN / white
    scaled = np.clip(np.nan_to_num(values * per_value, nan=0.0, posinf=_TOP_DN), 0, _TOP_DN)
    return np.rint(scaled).astype(np.uint16), per_value


def _black(
    whole: NDArray[Any],
    corner: tuple[int, int],
    shape: tuple[int, int],
    of_libraw: NDArray[np.float64],
    white: int,
    stated: SensorTags | None,
    path: Path,
    per_value: float,
) -> tuple[tuple[float, BlackPattern | None], tuple[Finding, ...]]:
    """Black level of the visible part and the pattern around it: by the tags of DNG, masked pixels, or LibRaw."""
    beyond_colours = stated is not None and stated.beyond_colours
    if stated is None or not (stated.is_dng or beyond_colours):
        return BlackPattern.split(of_libraw), ()
    measured = masked_level(whole, stated.masked, (2, 2)) if stated.masked else None
    black = stated.black_of(corner, shape, path, per_value)
    if black is None and measured is not None:
        black = BlackPattern.split(np.roll(measured, (-corner[0], -corner[1]), (0, 1)))
        return black, (*stated.findings, info("black-level-measured", black_dn=black[0]))
    if black is None:
        black = BlackPattern.split(of_libraw)
    doubts = () if measured is None else masked_findings(black[0], float(measured.mean()), white - black[0])
    return black, (*stated.findings, *(pattern_findings(black[1]) if beyond_colours else ()), *doubts)


@contextmanager
def _opened(data: bytes, path: Path) -> Iterator[Any]:
    import rawpy

    try:
        with rawpy.imread(BytesIO(data)) as raw:
            if raw.raw_type != rawpy.RawType.Flat:
                raise InputError(
                    f"{path} holds several values for each pixel (a linear DNG or a layered sensor), not "
                    "unprocessed sensor data: use the camera's own RAW file"
                )
            yield raw
    except rawpy.LibRawFileUnsupportedError as error:
        raise InputError(
            f"{path} is not a camera RAW file that LibRaw knows: give one, or convert it to 16-bit TIFF"
        ) from error
    except rawpy.LibRawError as error:
        text = error.args[0] if error.args else error
        why = text.decode() if isinstance(text, bytes) else str(text)
        raise InputError(
            f"{path} cannot be read as camera RAW ({why}): if another program opens it, convert it to DNG or 16-bit "
            "TIFF; otherwise copy it again from the camera"
        ) from error


def _pattern(raw: Any, path: Path, statements: FileStatements) -> tuple[str | None, NDArray[np.float64]]:
    """Name of the Bayer pattern, None for a monochrome sensor; LibRaw's black levels of the first 2 x 2 pixels."""
    black = [float(level) for level in raw.black_level_per_channel]
    if raw.num_colors == 1 and not (statements.photometric == CFA and not statements.has_cfa_pattern):
        return None, np.array([[black[0]]])
    try:
        colours: NDArray[np.uint8] = raw.raw_colors_visible
    except NotImplementedError:  # Of a filter that rawpy does not know.
        colours = np.zeros((1, 1), np.uint8)
    letters = raw.color_desc.decode()
    group = colours[:2, :2]
    repeats = group.shape == (2, 2) and all(
        (colours[y::2, x::2] == group[y, x]).all() for y in range(2) for x in range(2)
    )
    names = "".join(letters[i] if i < len(letters) else "?" for i in group.ravel())
    if not (repeats and names in ("RGGB", "GBRG", "GRBG", "BGGR")):
        raise InputError(
            f"{path} has no Bayer pattern of red, green and blue: give a RAW file of a camera with one, or of a "
            "monochrome camera"
        )
    return names[:2], np.array(black)[group]


def _completed(statements: FileStatements, other: Any) -> FileStatements:
    """Facts with what LibRaw knows besides; it has 0 for what it does not know."""
    return replace(
        statements,
        exposure_s=statements.exposure_s or positive_number(other.shutter_speed),
        f_number=statements.f_number or positive_number(other.aperture),
        focal_length_m=statements.focal_length_m or positive_number(other.focal_length / 1000),
        iso=statements.iso or positive_number(other.iso_speed),
    )


#: Pixels above this quantile may be defects, such as hot ones.
_DEFECTS = 2e-5
#: Pixels that are piled up, at the least, and how many times as many as below a level.
_LEAST, _TIMES = 50, 4.0
#: Parts of the range above black: the lowest place of a pile, and how far the planes' piles may differ.
_FROM, _ALIKE = 0.8, 0.03


def planes_of(dn: NDArray[Any], colour_filter: str | None) -> list[NDArray[Any]]:
    """Pixels of each colour, in the order of the first 2 x 2; all pixels of a sensor without a colour filter."""
    return [dn] if colour_filter is None else [dn[y::2, x::2] for y in (0, 1) for x in (0, 1)]


@dataclass(frozen=True)
class PlaneClipping:
    """End of the histogram of the pixels of one colour.

    Parameters
    ----------
    largest_dn : int
        Largest DN.
    at_largest : int
        Pixels that have it.
    pile : (int, int) or None
        Lowest and highest DN of the pile of clipped pixels, None if the histogram fades out.
    share : float
        Share of the pixels in the pile and above.
    """

    largest_dn: int
    at_largest: int
    pile: tuple[int, int] | None
    share: float

    @classmethod
    def of(cls, dn: NDArray[Any], black_dn: float, white_dn: float) -> PlaneClipping:
        """Look at the pixels of one colour."""
        largest, pile = int(dn.max()), _pile(dn, black_dn, white_dn)
        share = 0.0 if pile is None else float(np.mean(dn >= pile[0]))
        return cls(largest, int(np.count_nonzero(dn == largest)), pile, share)


def clipping_dn(dn: NDArray[Any], colour_filter: str | None, black_dn: float, white_dn: float) -> float | None:
    """DN from which pixels are clipped, None if no pile of them shows it.

    A sensor that clips piles up pixels at the end of the histogram: at one DN, or spread over a few where the camera
    corrects its DN afterwards. A bright surface does so too, but at other DN in each colour; a spread pile therefore
    counts only where two colours have it at the same DN.

    Parameters
    ----------
    dn : ndarray of uint8 or uint16, shape (height, width)
        All pixels.
    colour_filter : str or None
        Whether they lie behind a Bayer pattern.
    black_dn, white_dn : float
        Levels that the file states.
    """
    piles = [_pile(plane, black_dn, white_dn) for plane in planes_of(dn, colour_filter)]
    sharp = [low for low, high in filter(None, piles) if low == high]
    # The two greens see the same light.
    second_green = {None: 4, "RG": 2, "BG": 2, "GR": 3, "GB": 3}[colour_filter]
    colours = [pile for at, pile in enumerate(piles) if at != second_green]
    lowest = [pile[0] for pile in colours if pile is not None]
    alike = _ALIKE * (white_dn - black_dn)
    ends = sharp + [min(a, b) for a, b in combinations(lowest, 2) if abs(a - b) <= alike]
    return float(min(ends)) if ends else None


def _pile(dn: NDArray[Any], black_dn: float, white_dn: float) -> tuple[int, int] | None:
    """Lowest and highest DN of a pile at the end of a histogram, None if it just fades out."""
    counts = np.bincount(dn.ravel()).astype(float)
    end = int(np.searchsorted(np.cumsum(counts), (1 - _DEFECTS) * dn.size))
    lowest = black_dn + _FROM * (white_dn - black_dn)
    if end < lowest:
        return None
    # Some cameras leave DN out: levels count in steps, not one by one.
    step = max(round((white_dn - black_dn) / 256), 1)
    if counts[end] >= max(_LEAST, _TIMES * counts[max(end - 2 * step, 0) : end].max(initial=0)):
        return end, end
    usual = _TIMES * max(float(counts[max(end - 40 * step, 0) : max(end - 8 * step, 1)].mean()), dn.size * 1e-7)
    over = np.convolve(counts[: end + 1], np.full(step, 1 / step))[: end + 1] > usual
    if not over[end]:
        return None
    start = max(end - int(np.argmin(over[::-1])) - step + 2, 0)
    low = start + int(np.argmax(counts[start : end + 1] > usual))
    return (low, end) if low >= lowest and counts[low : end + 1].sum() >= _LEAST else None
