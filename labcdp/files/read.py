"""Pictures: image files of many kinds as frames of DN, or as floats."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.companding import Companding
from ..core.disk import reading
from ..core.disk.files import SESSION_JOURNAL
from ..core.dn import pixel_format
from ..core.errors import InputError, LabcdpError
from ..core.frame import Frame
from ..core.result import Finding, info, warning
from ..core.vignetting import Lens
from .doubts import BLACK_LEVEL, ENCODING, doubts_of, encodings, histogram_of, mosaic_of
from .frame import (
    DUMP_SUFFIXES,
    IMAGE_SUFFIXES,
    NO_EXPOSURE_S,
    Scale,
    changed_at,
    make_frame,
    picture_bytes,
    scale_of,
    statements_over,
    with_stated_levels,
)
from .kinds import EXR, HEAD_BYTES, JPEG, NPY, PNG, TIFF, ZIP, no_picture
from .picture import Picture, PictureOptions, StoredColours, with_overrides
from .statements import NOTHING_STATED, FileStatements
from .stored_image import INTEGERS, MOST_BITS, SCREEN_BITS, Stored, decoded_by_table, grey_finding, luminance_dn
from .transfer import Encoding, encoding_name

#: Codes of what is said of an encoding that was not given.
_STATED = ("encoding-stated", "encoding-pq", "encoding-hlg")
#: Options of files that say all that is needed.
NOTHING_KNOWN = PictureOptions()


def read_picture(path: str | PathLike[str], options: PictureOptions = NOTHING_KNOWN) -> Picture:
    """Read an image file.

    PNG, JPEG, TIFF, OpenEXR, NumPy arrays, camera RAW, raw dumps (with size and pixel format), frames that labcdp
    recorded and luminance that it saved. What a file is, its bytes say, not its name; grey values stay as they are
    stored, and no integer loses bits.

    Parameters
    ----------
    path : path
        The file.
    options : PictureOptions
        What counts where the file does not say, and of that what the user gave, which counts in any case.

    Raises
    ------
    InputError
        If it cannot be read, is damaged, no image, too large, or of a kind that is not read; in one line.

    Examples
    --------
    >>> import cv2
    >>> import numpy as np
    >>> from labcdp.files import read_picture
    >>> written = cv2.imwrite("ramp.png", np.arange(12, dtype=np.uint8).reshape(3, 4))
    >>> read_picture("ramp.png").frame.dn[2].tolist()
    [8, 9, 10, 11]
    """
    path = Path(path)
    data, sha256 = picture_bytes(path, options.max_pixels)
    suffix = path.suffix.lower()
    if options.size is not None and suffix not in STATED_SUFFIXES:
        from .png_jpeg import read_dump

        if options.pixel_format is None:
            raise InputError(f"{path} is a raw dump: give its pixel format too, for example Mono12Packed")
        stored = read_dump(data, path, options.size, options.pixel_format, options.max_pixels)
        return _picture(stored, path, sha256, options)
    if data.startswith((PNG, JPEG, NPY)):
        return _picture(_read_simple(data, path, options.max_pixels), path, sha256, options)
    noted, of_a_sensor, is_tiff = None, False, data.startswith(TIFF)
    if is_tiff:
        from .tiff import looked_at, read_tiff

        noted, of_a_sensor = looked_at(data)
    elif data.startswith(EXR):
        from .exr import exr_text, read_exr

        noted = exr_text(path, options.max_pixels)
    written = _from_labcdp(noted, data, sha256, path, options)
    if written is not None:
        return written
    if data.startswith(EXR):
        return _picture(read_exr(data, path, options.max_pixels), path, sha256, options)
    if is_tiff and suffix not in RAW_SUFFIXES and not of_a_sensor:
        return _picture(read_tiff(data, path, options.max_pixels), path, sha256, options)
    if is_tiff or suffix in RAW_SUFFIXES:
        return _from_raw(path, sha256, options)
    if suffix in DUMP_SUFFIXES:
        raise InputError(
            f"the format of {path} is unknown: for a raw dump give its size and pixel format, for example Mono12Packed"
        )
    raise no_picture(path, data[:HEAD_BYTES]) or InputError(
        f"{path} is not an image labcdp can read: use PNG, JPEG, TIFF, OpenEXR, NPY, camera RAW, or a raw dump with "
        "its "
        "size"
    )


def _read_simple(data: bytes, path: Path, max_pixels: int) -> Stored:
    """Read a PNG, a JPEG or a NumPy array."""
    from .png_jpeg import read_jpeg, read_npy, read_png

    return (read_png if data.startswith(PNG) else read_jpeg if data.startswith(JPEG) else read_npy)(
        data, path, max_pixels
    )


def read_page(path: Path, data: bytes, number: int, options: PictureOptions) -> Picture:
    """Read one picture of a TIFF of several; raises InputError as `read_picture`."""
    from .tiff import read_tiff

    return _picture(read_tiff(data, path, options.max_pixels, number), path, "", options)


def read_otherwise(picture: Picture, code: str, options: PictureOptions) -> Picture:
    """Return a picture as it is if its values are read otherwise.

    Parameters
    ----------
    picture : Picture
        The picture, of DN.
    code : str
        One of the codes of its doubts.
    options : PictureOptions
        Those it was read with.

    Raises
    ------
    InputError
        If its file is needed and cannot be read again.
    """
    doubts, frame = picture.doubts, picture.frame
    if code == ENCODING:
        assert doubts.other_encoding is not None
        if picture.coloured:
            return read_picture(picture.path, replace(options, encoding=doubts.other_encoding))
        return replace(picture, encoding=doubts.other_encoding)
    assert frame is not None
    if code == BLACK_LEVEL:
        return replace(picture, frame=replace(frame, black_level_dn=doubts.black_dn))
    return replace(picture, frame=replace(frame, colour_filter=doubts.colour_filter))


def _from_labcdp(
    noted: dict[str, Any] | None, data: bytes, sha256: str, path: Path, options: PictureOptions
) -> Picture | None:
    """Read what labcdp wrote, a recorded frame or luminance, by what it noted; return None for any other file."""
    if noted is None and not data.startswith(ZIP):
        return None
    from .luminance_file import FORMAT, read_luminance

    # Of archives, luminance is the only one that is read.
    if noted is None or noted.get("format") == FORMAT:
        luminance, _ = read_luminance(data, path, options.max_pixels)
        light, findings = np.asarray(luminance.luminance_cd_m2, dtype=np.float32), [info("luminance-file")]
        return _made(
            path,
            sha256,
            NOTHING_STATED,
            options,
            light=light,
            light_is_cd_m2=True,
            findings=findings,
            luminance=luminance,
        )
    if not {"exposure_s", "saturation_dn", "camera"} <= set(noted):
        return None
    from .tiff import read_tiff

    values, _ = read_tiff(data, path, options.max_pixels)
    lens, curve = _plan_of_session(path, sha256)
    given = options.override("encoding")
    if isinstance(given, Companding):
        # Of a frame that lies elsewhere, the user may state the curve it was recorded with.
        curve = given
    try:
        frame = Frame.from_metadata(values, noted, curve)
    except InputError as error:
        raise InputError(f"{path} is not a frame recorded by labcdp ({error})") from error
    stated, encoding = FileStatements(exposure_s=frame.exposure_s, model=frame.camera.model), frame.companding
    findings = []
    if encoding is not None and given not in (None, encoding):
        findings.append(warning("encoding-ignored", given=encoding_name(given), encoding=encoding_name(encoding)))
    return _made(
        path,
        sha256,
        stated,
        options,
        frame.bit_depth,
        frame=frame,
        encoding=encoding or "linear",
        findings=findings,
        exposure_known=True,
        lens=lens,
    )


def _plan_of_session(path: Path, sha256: str) -> tuple[Lens | None, Companding | None]:
    """Return lens and curve by the plan of the session in whose folder a frame was recorded; None for others."""
    # A link may lie elsewhere.
    folder = path.resolve().parent.parent
    if not (folder / SESSION_JOURNAL).is_file():
        return None, None
    with suppress(LabcdpError, OSError):
        lens, curve, frames = _session_at(folder, (folder / SESSION_JOURNAL).stat().st_mtime_ns)
        return (lens, curve) if sha256 in frames else (None, None)
    return None, None


@lru_cache(maxsize=4)
def _session_at(folder: Path, _changed_ns: int) -> tuple[Lens, Companding | None, frozenset[str]]:
    """Lens and curve of a session, and hashes of its frames."""
    from ..session import Session

    with Session.open(folder) as session:
        plan, hashes = session.configuration, frozenset(record.file.sha256 for record in session.frames())
        return plan.optics, plan.camera.curve, hashes


def _from_raw(path: Path, sha256: str, options: PictureOptions) -> Picture:
    from .raw import read_raw

    if isinstance(options.encoding, Companding):
        raise InputError(f"{path} is a camera RAW, which states its curve itself: leave the encoding out")
    known = replace(options, exposure_s=options.exposure_s or NO_EXPOSURE_S)
    taken = read_raw(path, known, options.max_pixels)
    frame, findings = taken.frame, [*taken.findings]
    if taken.clips_at_dn is not None:
        findings += [warning("raw-clips-early", found_dn=taken.clips_at_dn, stated_dn=frame.saturation_dn)]
        frame = replace(frame, saturation_dn=taken.clips_at_dn)
    statements, bits = taken.statements, frame.bit_depth
    is_known = (statements.exposure_s or options.exposure_s) is not None
    return _made(path, sha256, statements, options, bits, frame=frame, findings=findings, exposure_known=is_known)


def _picture(stored: Stored, path: Path, sha256: str, options: PictureOptions) -> Picture:
    """Make a picture of the values of a file and what it states."""
    values, statements = stored
    curve = options.encoding if isinstance(options.encoding, Companding) else None
    if curve is not None:
        values = _codes(values, statements, curve, path)
    findings, table = [*statements.changes, *statements.findings], statements.light_table
    if options.encoding is not None:
        findings = [finding for finding in findings if finding.code not in _STATED]
    usual: Encoding = statements.encoding or "linear"
    encoding, other = options.encoding or usual, None
    if statements.stated_by and options.override("encoding") not in (None, None if table is not None else usual):
        findings.append(warning("encoding-replaced", given=encoding_name(encoding), by=statements.stated_by))
    known, taken = statements_over(options, statements), statements.taken or changed_at(path)
    exposure_known = known.exposure_s is not None
    if statements.bits is None:
        # What is not finite is invalid in the map.
        with np.errstate(over="ignore", invalid="ignore"):
            light = values * np.float32(statements.cd_m2_per_value or 1.0)
        is_cd_m2 = statements.cd_m2_per_value is not None
        return _made(
            path,
            sha256,
            statements,
            options,
            light=light,
            findings=findings,
            light_is_cd_m2=is_cd_m2,
            exposure_known=exposure_known,
        )
    given_bits = options.override("bit_depth") or 0
    is_wide = any(finding.code == INTEGERS for finding in statements.changes)
    # Of a series, dark pictures have as many bits as the others.
    if values.dtype.itemsize > 2 or (is_wide and given_bits > 16):
        findings = [finding for finding in findings if finding.code != INTEGERS]
        return _of_many_bits(values.astype(np.uint32), path, sha256, statements, options, findings)
    if given_bits > 16:
        raise InputError(f"{path} has values of {statements.bits} bits, not of {given_bits}: give 1 to 16")
    coloured, scale = values.ndim == 3, scale_of(values, statements.bits, options, str(path))
    bits, guessed_by = scale.bits, None
    if statements.bits == 16 and options.stated_bits is None:
        guessed_by = int(values.max()), int(np.bitwise_or.reduce(values, axis=None))
    states_white = statements.white_dn is not None
    findings += [finding for finding in scale.findings if not (states_white and finding.code == "bit-depth-unknown")]
    levels = (scale.saturation_dn, statements.white_dn, options.saturation_dn)
    saturation_dn = min(level for level in levels if level is not None)
    counts = histogram_of(values)
    is_known = statements.stated_by or statements.is_settled or _is_of_sensor(coloured, statements, options)
    if options.encoding is None and not is_known:
        # A palette has colours, and colours of more bits are as is usual for their kind.
        in_colours = coloured or any(finding.code == "palette-resolved" for finding in statements.changes)
        likely, other = encodings(counts, saturation_dn, statements.bits, in_colours)
        encoding = usual if in_colours else options.assumed_encoding or likely
        other = other if encoding == likely else likely
    if options.encoding is None and statements.bits > SCREEN_BITS and not (coloured or statements.stated_by):
        from .companded import companded_findings

        findings += companded_findings(counts, statements.bits)
    bare = not coloured and _is_bare(statements, options)
    top_dn = 2.0**scale.bits - 1 if isinstance(encoding, Companding) else saturation_dn
    doubts = doubts_of(values, top_dn, encoding, other, counts, as_stored=bare)
    encoding, clipped, white_dn = doubts.encoding, None, statements.white_dn
    by_table = table is not None and options.encoding is None
    if table is not None and options.encoding is None:
        clipped = values >= saturation_dn
        values = decoded_by_table(values, scale.bits, table, statements.weights)
        encoding, scale, white_dn = "linear", _OF_LIGHT, None
    if by_table or coloured:
        known = replace(known, pixel_format=None, saturation_dn=None, black_level_dn=None)
    rgb = None
    if coloured:
        dn = luminance_dn(values, scale.bits, encoding, statements.weights)
        frame = make_frame(dn, _OF_LIGHT, known, taken)
        clipped = np.any(values >= saturation_dn if clipped is None else clipped, axis=2)
        rgb = StoredColours(values, scale.bits, encoding, clipped)
        findings.append(grey_finding(encoding, statements.weights))
    else:
        frame = with_stated_levels(make_frame(values, scale, known, taken), statements.black, white_dn)
    if clipped is not None and (share := float(np.mean((frame.dn > 0) & (frame.dn < _FEW_STEPS)))) > _DARK:
        findings.append(info("light-in-steps", share=share))
    return _made(
        path,
        sha256,
        statements,
        options,
        bits,
        frame=replace(frame, clipped=clipped, companding=curve),
        encoding=encoding,
        findings=findings,
        exposure_known=exposure_known,
        coloured=coloured,
        guessed_by=guessed_by,
        doubts=doubts,
        rgb=rgb,
    )


def _of_many_bits(
    values: NDArray[np.uint32],
    path: Path,
    sha256: str,
    statements: FileStatements,
    options: PictureOptions,
    findings: Sequence[Finding],
) -> Picture:
    """Make a picture of linear values of 17 to 24 bits."""
    if values.ndim == 3 or options.encoding not in (None, "linear"):
        raise InputError(f"{path} has values up to {values.max()}: more than 16 bits are read as linear grey only")
    stated = options.override("bit_depth") or statements.bits
    if stated is None or not 16 < stated <= MOST_BITS:
        # What a calibration or a camera specification says.
        stated = options.stated_bits if 16 < (options.stated_bits or 0) <= MOST_BITS else None
    bits = stated or next(n for n in (20, 24) if values.max() < 2**n)
    if values.max() >= 2**bits:
        raise InputError(
            f"{path} has values up to {values.max()}, above {bits} bits: give the bit depth it was written with"
        )
    known, taken = statements_over(options, statements), statements.taken or changed_at(path)
    exposure_known = known.exposure_s is not None
    frame = make_frame(values, Scale(bits, 2.0**bits - 1), known, taken)
    more = [info("many-bits", bits=bits) if bits == stated else warning("many-bits-guessed", bits=bits)]
    mosaic = "" if frame.colour_filter or options.bayer else mosaic_of(values)
    if mosaic:
        more.append(warning("many-bits-mosaic", mosaic=mosaic))
    return _made(
        path, sha256, statements, options, bits, frame=frame, findings=(*findings, *more), exposure_known=exposure_known
    )


def _codes(
    values: NDArray[Any], statements: FileStatements, curve: Companding, path: Path
) -> NDArray[np.unsignedinteger[Any]]:
    """Return the codes of companded values, without embedded rows; raises InputError if a file has none."""
    if values.ndim != 2 or statements.bits is None:
        what = "floats" if statements.bits is None else "colours"
        raise InputError(f"{path} contains {what}, but {encoding_name(curve)} are grey codes of a sensor")
    if curve.bits > 8 * values.dtype.itemsize:
        raise InputError(
            f"{path} has values of {8 * values.dtype.itemsize} bits, but {encoding_name(curve)} are codes of "
            f"{curve.bits} bits: use the file as the camera recorded it"
        )
    return curve.image_rows(values)


def _made(
    path: Path,
    sha256: str,
    statements: FileStatements,
    options: PictureOptions,
    bits: int | None = None,
    *,
    frame: Frame | None = None,
    light: NDArray[np.float32] | None = None,
    encoding: Encoding = "linear",
    findings: Iterable[Finding] = (),
    **others: Any,
) -> Picture:
    """Make a picture with what the user gave; `bits` are those of the values as they were taken from the file."""
    values = light if frame is None else frame.dn
    assert values is not None
    height, width = values.shape
    frame, more = with_overrides(frame, (width, height), encoding, options, bits)
    return Picture(path, sha256, statements, frame, light, encoding=encoding, findings=(*findings, *more), **others)


def _is_of_sensor(coloured: bool, statements: FileStatements, options: PictureOptions) -> bool:
    """Whether file or user say that grey values are the DN of a sensor, which are in proportion to light."""
    stated = statements.black is not None or statements.white_dn is not None
    return not coloured and (options.of_sensor or stated)


def _is_bare(statements: FileStatements, options: PictureOptions) -> bool:
    """Whether neither black level nor colour filter is known of grey values."""
    # That a curve has a black level says nothing of a colour filter.
    by_curve = isinstance(options.encoding, Companding)
    has_black = (options.override("black_level_dn") if by_curve else options.black_level_dn) is not None
    known = statements.black is not None or statements.light_table is not None or has_black
    has_filter = options.pixel_format is not None and pixel_format(options.pixel_format).colour_filter is not None
    return not (known or has_filter or options.bayer)


#: Steps of light of which rounding is 1 %, and the share of darker pixels that is named.
_FEW_STEPS, _DARK = 50, 0.01
#: Scale of light that was made of colours, or by a table.
_OF_LIGHT = Scale(16, 65535.0)
_log = logging.getLogger(__name__)

#: Endings of the names of camera RAW files that LibRaw reads.
RAW_SUFFIXES = (
    ".3fr", ".arw", ".cr2", ".cr3", ".crw", ".dcr", ".dng", ".erf", ".fff", ".iiq", ".kdc", ".mef", ".mos", ".mrw",
    ".nef", ".nrw", ".orf", ".pef", ".raf", ".rw2", ".rwl", ".sr2", ".srf", ".srw", ".x3f",
)  # fmt: skip
#: Endings of names whose bytes say what they are.
STATED_SUFFIXES = (".exr", ".jpeg", ".jpg", ".npy", ".npz", ".png", ".tif", ".tiff", *RAW_SUFFIXES)
#: Endings of names of what can be imported into a session: some cameras' RAW files end in .raw, and many write a JPEG
#: besides.
IMPORTED_SUFFIXES = (*IMAGE_SUFFIXES, *RAW_SUFFIXES, ".raw")


#: Files that are left out and named.
_MOST_NAMED = 5


def picture_paths(
    paths: Sequence[str | PathLike[str]], suffixes: Sequence[str] = (*STATED_SUFFIXES, *DUMP_SUFFIXES)
) -> list[Path]:
    """Files to read: those given, and of folders the images they hold, by name with numbers in order.

    A file that is given itself is kept whatever it is, so that reading it says what is wrong with it. What a folder
    holds besides is left out, with a warning in the log.

    Parameters
    ----------
    paths : sequence of path
        Files and folders.
    suffixes : sequence of str
        Endings of the names of images, in lower case.

    Raises
    ------
    InputError
        If a folder holds no image, or cannot be read.

    Examples
    --------
    >>> from pathlib import Path
    >>> from labcdp.files import picture_paths
    >>> Path("night").mkdir()
    >>> for name in ("b.png", "a.tif"):
    ...     Path("night", name).touch()
    >>> [path.name for path in picture_paths(["night"])]
    ['a.tif', 'b.png']
    """
    files: list[Path] = []
    for path in map(Path, paths):
        files += _in_folder(path, suffixes) if path.is_dir() else [path]
    return list(dict.fromkeys(files))


def _in_folder(folder: Path, suffixes: Sequence[str]) -> list[Path]:
    with reading(folder, "a folder you can read"):
        files = [path for path in folder.iterdir() if path.is_file() and not path.name.startswith(".")]
    images = [path for path in files if path.suffix.lower() in suffixes]
    others = sorted(path.name for path in set(files) - set(images))
    if others:
        named = ", ".join(others[:_MOST_NAMED]) + (", ..." if len(others) > _MOST_NAMED else "")
        text = "%s: %d files skipped, since their names are not those of pictures: %s"
        _log.warning(text, folder, len(others), named)
    if not images:
        raise InputError(f"{folder} contains no images: choose a folder that does, or give files")
    return sorted(images, key=_natural)


def _natural(path: Path) -> list[tuple[int, int, str]]:
    """Key that sorts img2 before img10."""
    parts = re.split(r"(\d+)", path.name.lower())
    return [(1, int(part), part) if part.isdecimal() else (0, 0, part) for part in parts]
