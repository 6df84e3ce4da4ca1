"""Pictures to import: read, and checked against each other and against the configuration."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ..core.errors import InputError, SessionError
from ..core.frame import CameraIdentity, Frame
from ..core.pixel_format import pixel_format
from ..core.reading import Reading
from ..core.result import Finding, info, warning
from ..drivers.csv_meter import CsvMeter
from ..drivers.manual import MeterAccuracy, stated_accuracy
from ..drivers.minolta_ls.protocol import LS100, LS110
from ..files import IMAGE_SUFFIXES, FileFrame, PictureOptions, read_image, read_raw
from ..session import MeterConfiguration, Role, Session, SessionConfiguration
from ..session.records import EXPOSURES

#: Relative difference of f-numbers and focal lengths explained by rounding; third stops differ by 12 %.
_LENS_TOLERANCE_REL = 0.05
#: Largest difference of black levels as a share of saturation: many cameras measure it for each picture.
_BLACK_TOLERANCE = 0.01


@dataclass(frozen=True)
class ImportFile:
    """One picture to import.

    Parameters
    ----------
    path : Path
        The file.
    role : {'light', 'dark'}
        Whether it shows the target or was taken with the lens covered.
    patch : str or None
        The patch it shows, where patches were shown one by one.
    exposure_s : float or None
        Exposure time, if not in the file.
    """

    path: Path
    role: Role
    patch: str | None = None
    exposure_s: float | None = None


@dataclass(frozen=True)
class CheckedFile:
    """A checked file; its pixels are read again for writing, to limit memory."""

    file: ImportFile
    key: str


def check_files(
    configuration: SessionConfiguration,
    files: Sequence[ImportFile],
    report: Callable[[str, int, int], None],
) -> tuple[list[CheckedFile], Frame, list[Finding]]:
    """Read all files once; returns them, the first frame, which represents all settings, and findings."""
    _require_presentation(configuration, files)
    first: FileFrame | None = None
    seen: dict[str, ImportFile] = {}
    findings: list[Finding] = []
    counts: dict[tuple[Role, str | None, float], int] = {}
    levels: dict[float, dict[Role, list[float]]] = {}
    for done, file in enumerate(files, start=1):
        read = read_picture(file, configuration)
        if first is None:
            first = read
            _require_bench(configuration, first)
        _require_alike(first, read)
        key = frame_key(read.frame)
        if key in seen:
            same = seen[key]
            if (same.role, same.patch) != (file.role, file.patch):
                raise InputError(
                    f"{file.path} is the same picture as {same.path}, which is given as {_as_what(same)}: check which "
                    "one is wrong"
                )
            findings.append(info("picture-repeated", str(file.path), same_as=str(same.path)))
            continue
        seen[key] = file
        setting = (file.role, file.patch, read.frame.exposure_s)
        counts[setting] = counts.get(setting, 0) + 1
        levels.setdefault(read.frame.exposure_s, {}).setdefault(file.role, []).append(float(read.frame.dn.mean()))
        report("checking", done, len(files))
    if first is None:
        raise InputError("there is no picture to import: give --light and --dark")
    _require_light_brighter(levels)
    return [CheckedFile(file, key) for key, file in seen.items()], first.frame, findings + _too_few(counts)


def _require_light_brighter(levels: Mapping[float, Mapping[Role, Sequence[float]]]) -> None:
    """Refuse light and dark pictures that were confused."""
    both = {t: of for t, of in levels.items() if len(of) > 1}
    if both and all(max(of["light"]) < min(of["dark"]) for of in both.values()):
        exposure_s, of = max(both.items())
        raise InputError(
            f"the light pictures are darker than the dark ones (mean {max(of['light']):.4g} against "
            f"{min(of['dark']):.4g} DN at {exposure_s:g} s): give them the other way round"
        )


def _as_what(file: ImportFile) -> str:
    return file.role if file.patch is None else f"{file.role} of patch {file.patch!r}"


def _too_few(counts: Mapping[tuple[Role, str | None, float], int]) -> list[Finding]:
    findings = [
        warning("one-picture", "" if patch is None else f"patch {patch}", role=role, exposure_s=exposure_s)
        for (role, patch, exposure_s), n in counts.items()
        if n == 1
    ]
    if not any(role == "dark" for role, _, _ in counts):
        findings.append(warning("no-dark-pictures"))
    return findings


def _require_presentation(configuration: SessionConfiguration, files: Sequence[ImportFile]) -> None:
    one_by_one = configuration.target.presentation == "one by one"
    names = [patch.name for patch in configuration.target.patches]
    for file in files:
        if file.role != "light":
            continue
        if one_by_one and file.patch is None:
            raise InputError(
                f"{file.path} shows which patch? The target's patches are shown one by one: give --light PATCH=FILE"
            )
        if not one_by_one and file.patch is not None:
            raise InputError(
                f"{file.path} is given for patch {file.patch!r}, but the target's patches are shown together: give "
                '--light FILE, or set target.presentation = "one by one"'
            )
        if file.patch is not None and file.patch not in names:
            raise InputError(f"there is no patch {file.patch!r} for {file.path}: choose from {', '.join(names)}")


def read_picture(file: ImportFile, configuration: SessionConfiguration) -> FileFrame:
    """Read a picture, with missing settings from the configuration; raises InputError as `labcdp.files`."""
    camera = configuration.camera
    defaults = PictureOptions(
        exposure_s=file.exposure_s,
        gain_db=configuration.plan.gain_db,
        camera=CameraIdentity(camera.vendor or "unknown", camera.model or "unknown", camera.serial or "unknown"),
    )
    if file.path.suffix.lower() in IMAGE_SUFFIXES:
        return read_image(file.path, pixel_format(configuration.plan.pixel_format), defaults)
    return read_raw(file.path, defaults)


def _require_bench(configuration: SessionConfiguration, read: FileFrame) -> None:
    """Refuse a picture that is not of the configured camera, lens and target."""
    for name in ("vendor", "model", "serial"):
        wanted, found = getattr(configuration.camera, name), getattr(read.frame.camera, name)
        if wanted is not None and wanted.casefold() != found.casefold():
            raise InputError(
                f"{read.path} is by a camera with {name} {found!r}, the configuration says {wanted!r}: correct "
                f"camera.{name}, or give pictures of that camera"
            )
    lens = configuration.lens
    for name, found_value, wanted_value in (
        ("f_number", read.f_number, lens.f_number),
        ("focal_length_m", read.focal_length_m, lens.focal_length_m),
    ):
        if found_value is not None and abs(found_value / wanted_value - 1) > _LENS_TOLERANCE_REL:
            raise InputError(
                f"{read.path} was taken with {name} {found_value:g}, the configuration says {wanted_value:g}: correct "
                f"lens.{name}, or give pictures with this setting"
            )
    for patch in configuration.target.patches:
        patch.region().mask(read.frame.shape)


def _require_alike(first: FileFrame, read: FileFrame) -> None:
    """Refuse a picture that differs from the first in anything but exposure and light."""
    a, b = first.frame, read.frame
    for name, expected, found in (
        ("camera", str(a.camera), str(b.camera)),
        ("image size", f"{a.shape[1]} x {a.shape[0]}", f"{b.shape[1]} x {b.shape[0]}"),
        ("pixel format", a.pixel_format, b.pixel_format),
        ("bit depth", a.bit_depth, b.bit_depth),
        ("gain", f"{a.gain_db:.4g} dB", f"{b.gain_db:.4g} dB"),
        ("saturation", f"{a.saturation_dn:g} DN", f"{b.saturation_dn:g} DN"),
        ("f-number", first.f_number, read.f_number),
        ("focal length", first.focal_length_m, read.focal_length_m),
    ):
        if expected != found:
            raise InputError(
                f"{name} of {read.path} is {found}, that of {first.path} is {expected}: give pictures of one camera "
                "with one setting, and other exposures only"
            )
    mine, theirs = (one.black_level_dn or 0.0 for one in (a, b))
    if abs(mine - theirs) > _BLACK_TOLERANCE * a.saturation_dn:
        raise InputError(
            f"black level of {read.path} is {theirs:g} DN, that of {first.path} is {mine:g} DN: give pictures with one "
            "setting"
        )


def frame_key(frame: Frame) -> str:
    """Hash of pixels and exposure, unique to each picture by its noise."""
    digest = hashlib.sha256(f"{frame.shape} {frame.dn.dtype.name} {frame.exposure_s!r}".encode())
    digest.update(frame.dn.tobytes())
    return digest.hexdigest()


_DATA_SHEETS = {sheet.model: sheet for sheet in (LS100, LS110)}


def read_readings(configuration: SessionConfiguration, path: Path) -> tuple[list[tuple[str, Reading]], list[Finding]]:
    """Return the readings with their patches, each line once, and findings."""
    described = configuration.meter
    with CsvMeter(path, described.identity, _accuracy(described)) as meter:
        by_patch = meter.readings
    names = [patch.name for patch in configuration.target.patches]
    for name in by_patch:
        if name not in names:
            raise InputError(f"{path} has readings of patch {name!r}, the target has {', '.join(names)}: correct one")
    for name in names:
        if name not in by_patch:
            raise InputError(f"{path} has no reading of patch {name!r}: add one, or take the patch from the target")
    finest = min(reading.resolution for readings in by_patch.values() for reading in readings)
    findings = []
    result = []
    for patch, readings in by_patch.items():
        once = list({reading.raw: reading for reading in readings}.values())
        if len(once) < len(readings):
            count = len(readings) - len(once)
            findings.append(warning("lines-repeated", patch, path=str(path), count=count))
        result += [(patch, _with_digits(reading, described, finest)) for reading in once]
    return result, findings


def _accuracy(described: MeterConfiguration) -> MeterAccuracy:
    sheet = _DATA_SHEETS.get(described.model) if described.entry == "serial" else None
    if sheet is not None:
        return MeterAccuracy(sheet.scale_half_width_rel, sheet.repeatability_rel, 1)
    return stated_accuracy(described)


def _with_digits(reading: Reading, described: MeterConfiguration, finest: float) -> Reading:
    """Resolution by the data sheet, with the decimals of the finest number of the list.

    Spreadsheets drop trailing zeros, and rounding affects all numbers of a list.
    """
    sheet = _DATA_SHEETS.get(described.model) if described.entry == "serial" else None
    if sheet is None:
        return reading
    resolution = min(reading.resolution, max(finest, sheet.shown_resolution(reading.value)))
    digits = sheet.digit_error(reading.value, reading.unit)
    return replace(reading, resolution=resolution, digits_half_width=digits * resolution)


#: Number of frames written together.
_BATCH = 4


@dataclass(frozen=True)
class Imported:
    """Summary of an import.

    Parameters
    ----------
    frames, readings : int
        Numbers added to the session.
    known_frames, known_readings : int
        Numbers already in the session.
    findings : tuple of Finding
        Findings for the user.
    """

    frames: int
    readings: int
    known_frames: int
    known_readings: int
    findings: tuple[Finding, ...]


def import_session(
    configuration: SessionConfiguration,
    path: Path,
    files: Sequence[ImportFile],
    readings: Path,
    report: Callable[[str, int, int], None] = lambda _what, _done, _total: None,
) -> Imported:
    """Create a session from pictures and meter readings, or complete an existing one.

    Everything is read and checked before the first byte is written. Frames with the same pixels and readings with the
    same line are not added twice, so an interrupted import can be repeated.

    Parameters
    ----------
    configuration : SessionConfiguration
        Bench and target. Its ``plan.pixel_format`` applies to TIFF and PNG files; RAW files contain theirs.
    path : Path
        The session's folder; new, or created with the same configuration.
    files : sequence of ImportFile
        The pictures.
    readings : Path
        CSV file of readings, as `labcdp.drivers.csv_meter.CsvMeter` reads it.
    report : callable
        Called with a description, the amount done and the total.

    Raises
    ------
    InputError
        If a file cannot be used, files do not belong together or do not fit the configuration, or patches and readings
        do not match; nothing is then written.
    SessionError
        If the session cannot be written, or was created with another configuration.
    """
    given, findings = read_readings(configuration, readings)
    checked, frame, more = check_files(configuration, files, report)
    findings += more
    exists = path.is_dir() and any(path.iterdir())
    with Session.open(path, writable=True) if exists else Session.create(path, configuration) as session:
        if session.configuration != configuration:
            raise SessionError(
                f"{path} was made with another configuration: give that one ({path / 'session.toml'}), or a new folder"
            )
        known = _known(session, frame, report)
        lacking = [one for one in checked if one.key not in known]
        _write_frames(session, lacking, configuration, frame, report)
        new_readings = _lacking(session, given)
        for patch, reading in new_readings:
            session.add_reading(reading, patch)
        exposures_s = sorted({record.exposure_s for record in session.frames("light")})
        if configuration.plan.exposures_s is None and session.exposures_s != tuple(exposures_s):
            session.add_event(EXPOSURES, {"exposures_s": exposures_s})
    return Imported(
        frames=len(lacking),
        readings=len(new_readings),
        known_frames=len(checked) - len(lacking),
        known_readings=len(given) - len(new_readings),
        findings=tuple(findings),
    )


def _known(session: Session, frame: Frame, report: Callable[[str, int, int], None]) -> set[str]:
    """Keys of the frames in a session, which must have the same settings."""
    records = session.frames()
    for record in records[:1]:
        height, width = record.shape
        there = f"{record.camera}, {width} x {height} pixels, {record.pixel_format}"
        here = f"{frame.camera}, {frame.shape[1]} x {frame.shape[0]} pixels, {frame.pixel_format}"
        if there != here:
            raise InputError(f"{session.path} holds frames of {there}, the pictures are of {here}: give a new folder")
    keys = set()
    for done, record in enumerate(records, start=1):
        keys.add(frame_key(session.load(record)))
        report("comparing", done, len(records))
    return keys


def _write_frames(
    session: Session,
    lacking: Sequence[CheckedFile],
    configuration: SessionConfiguration,
    first: Frame,
    report: Callable[[str, int, int], None],
) -> None:
    begun = len(session.frames())
    for start in range(0, len(lacking), _BATCH):
        batch = lacking[start : start + _BATCH]
        frames, sources = [], []
        for number, one in enumerate(batch, start=begun + start + 1):
            read = read_picture(one.file, configuration)
            if frame_key(read.frame) != one.key:
                raise SessionError(f"{one.file.path} changed while it was imported: import it again")
            sources.append({"file": str(one.file.path), "sha256": read.sha256})
            frames.append((_levelled(read.numbered(number).frame, first), one.file.role, one.file.patch))
        records = session.add_frames(frames)
        numbered = [{"number": r.number, **source} for r, source in zip(records, sources, strict=True)]
        session.add_event("imported", {"files": numbered})
        report("writing", start + len(batch), len(lacking))


def _levelled(frame: Frame, first: Frame) -> Frame:
    """Give all frames the nominal black level of the first; the dark signal is taken from the dark frames."""
    return replace(frame, black_level_dn=first.black_level_dn, plane_black_levels_dn=first.plane_black_levels_dn)


def _lacking(session: Session, given: Iterable[tuple[str, Reading]]) -> list[tuple[str, Reading]]:
    known = {(record.patch, record.reading.raw) for record in session.readings()}
    return [(patch, reading) for patch, reading in given if (patch, reading.raw) not in known]
