"""Import of a session: readings of a file, and pictures written as the frames of the session."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ..core.errors import InputError, SessionError
from ..core.frame import Frame, pixels_sha256
from ..core.reading import Reading
from ..core.result import Finding, FindingValue, warning
from ..drivers.file_meter import FileMeter
from ..drivers.manual import MeterAccuracy, stated_accuracy
from ..drivers.minolta.data_sheet import MeterDataSheet
from ..drivers.minolta.models import DRIVERS
from ..session import Session, SessionConfiguration
from ..session.records import EXPOSURES, FrameRecord
from .import_check import ImportFile, check_files, read_import_file


@dataclass(frozen=True)
class ReadingList:
    """Readings of a file.

    Parameters
    ----------
    readings : tuple of (str, Reading)
        Each with its patch; equal ones with equal times are one.
    has_times : bool
        Whether the file says when they were taken.
    findings : tuple of Finding
        Findings for the user.
    """

    readings: tuple[tuple[str, Reading], ...]
    has_times: bool
    findings: tuple[Finding, ...]

    def new(self, session: Session) -> list[tuple[str, Reading]]:
        """Return the readings that a session lacks; of equal ones without a time as many as it has fewer."""

        def key(patch: str, reading: Reading) -> tuple[object, ...]:
            return patch, reading.value, reading.unit, *([reading.timestamp] if self.has_times else [])

        known = Counter(key(record.patch, record.reading) for record in session.readings())
        new = []
        for patch, reading in self.readings:
            known[key(patch, reading)] -= 1
            if known[key(patch, reading)] < 0:
                new.append((patch, reading))
        return new


def read_readings(configuration: SessionConfiguration, path: Path) -> ReadingList:
    """Read a list of readings, for all patches of the target and no others; raises InputError."""
    described = configuration.meter
    driver = DRIVERS.get(described.model) if described.entry == "serial" else None
    sheet = None if driver is None else driver.data_sheet
    accuracy = stated_accuracy(described)
    if sheet is not None:
        accuracy = MeterAccuracy(sheet.scale_half_width_rel, sheet.repeatability_rel, 1)
    with FileMeter(path, described.identity, accuracy) as meter:
        by_patch, has_times = meter.readings, meter.has_times
    names = [patch.name for patch in configuration.target.patches]
    for name in by_patch:
        if name not in names:
            raise InputError(f"{path} has readings of patch {name!r}, the target has {', '.join(names)}: correct one")
    for name in names:
        if name not in by_patch:
            raise InputError(f"{path} has no reading of patch {name!r}: add one, or take the patch from the target")
    finest = min(reading.resolution for readings in by_patch.values() for reading in readings)
    copied: dict[str, int] = {}
    result = []
    for patch, readings in by_patch.items():
        once = list({(r.value, r.unit, r.timestamp): r for r in readings}.values()) if has_times else readings
        if len(once) < len(readings):
            copied[patch] = len(readings) - len(once)
        result += [(patch, reading if sheet is None else _with_digits(reading, sheet, finest)) for reading in once]
    values: dict[str, FindingValue] = {"path": str(path), "count": sum(copied.values()), "patches": [*copied]}
    return ReadingList(tuple(result), has_times, (warning("lines-repeated", **values),) if copied else ())


def _with_digits(reading: Reading, sheet: MeterDataSheet, finest: float) -> Reading:
    """Resolution by the data sheet, with the decimals of the finest number of the list.

    Spreadsheets drop trailing zeros, and rounding affects all numbers of a list.
    """
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

    Everything is read and checked before the first byte is written. Frames with the same pixels, and readings with the
    same value and time, are not added again, so an interrupted import can be repeated.

    Parameters
    ----------
    configuration : SessionConfiguration
        Bench and target. Its ``plan.pixel_format`` applies to TIFF and PNG files; RAW files contain theirs.
    path : Path
        The session's folder; new, or created with the same configuration.
    files : sequence of ImportFile
        The pictures.
    readings : Path
        CSV file or spreadsheet of readings, as `labcdp.drivers.file_meter.FileMeter` reads it.
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
    given = read_readings(configuration, readings)
    checked, frame, findings = check_files(configuration, files, report)
    exists = path.is_dir() and any(path.iterdir())
    with Session.open(path, writable=True) if exists else Session.create(path, configuration) as session:
        if session.configuration != configuration:
            raise SessionError(
                f"{path} was made with another configuration: give that one ({path / 'session.toml'}), or a new folder"
            )
        known = _known(session, frame, report)
        _require_their_temperature(session, known, checked)
        lacking = [(key, file) for key, file in checked.items() if key not in known]
        _write_frames(session, lacking, configuration, frame, report)
        new_readings = given.new(session)
        for patch, reading in new_readings:
            session.add_reading(reading, patch)
        exposures_s = sorted({record.exposure_s for record in session.frames("light")})
        if configuration.plan.exposures_s is None and session.exposures_s != tuple(exposures_s):
            session.add_event(EXPOSURES, {"exposures_s": exposures_s})
        session.require_files()
    return Imported(
        frames=len(lacking),
        readings=len(new_readings),
        known_frames=len(checked) - len(lacking),
        known_readings=len(given.readings) - len(new_readings),
        findings=(*given.findings, *findings),
    )


def _known(session: Session, frame: Frame, report: Callable[[str, int, int], None]) -> dict[str, FrameRecord]:
    """Frames in a session by their keys; they must have the same settings."""
    records = session.frames()
    for record in records[:1]:
        height, width = record.shape
        there = f"{record.camera}, {width} x {height} pixels, {record.pixel_format}"
        here = f"{frame.camera}, {frame.shape[1]} x {frame.shape[0]} pixels, {frame.pixel_format}"
        if there != here:
            raise InputError(f"{session.path} holds frames of {there}, the pictures are of {here}: choose a new folder")
    known = {}
    for done, record in enumerate(records, start=1):
        known[pixels_sha256(session.load(record))] = record
        report("comparing", done, len(records))
    return known


def _require_their_temperature(
    session: Session, known: Mapping[str, FrameRecord], checked: Mapping[str, ImportFile]
) -> None:
    """Refuse a temperature of frames that are in a session with another one, or with none."""
    for key, file in checked.items():
        if key not in known or file.temperature_c is None:
            continue
        there = known[key].metadata["temperature_c"]
        if there != file.temperature_c:
            stated = "without a temperature" if there is None else f"with {there:g} °C"
            raise InputError(
                f"{file.path} is in {session.path} {stated}, and given with {file.temperature_c:g} °C: give a new "
                "folder"
            )


def _write_frames(
    session: Session,
    lacking: Sequence[tuple[str, ImportFile]],
    configuration: SessionConfiguration,
    first: Frame,
    report: Callable[[str, int, int], None],
) -> None:
    begun = len(session.frames())
    for start in range(0, len(lacking), _BATCH):
        batch = lacking[start : start + _BATCH]
        frames, sources = [], []
        for number, (key, file) in enumerate(batch, start=begun + start + 1):
            read = read_import_file(file, configuration)
            if pixels_sha256(read.frame) != key:
                raise SessionError(f"{file.path} changed while it was imported: import it again")
            sources.append({"file": str(file.path), "sha256": read.sha256})
            # The nominal black level of the first for all; the dark signal is taken from the dark frames.
            black_dn, pattern = first.black_level_dn, first.black_pattern
            frame = replace(read.frame, frame_id=number, black_level_dn=black_dn, black_pattern=pattern)
            frames.append((frame, file.role, file.patch))
        records = session.add_frames(frames)
        numbered = [{"number": r.number, **source} for r, source in zip(records, sources, strict=True)]
        session.add_event("imported", {"files": numbered})
        report("writing", start + len(batch), len(lacking))
