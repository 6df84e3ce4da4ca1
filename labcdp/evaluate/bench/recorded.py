"""How the frames of a session are sorted, and what was before the camera."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import count
from typing import TypeVar

from ...calibration import AnyCalibration, LensIdentity
from ...core.errors import CalibrationError, InputError
from ...core.frame import PLANES, Frame, pixels_sha256
from ...core.result import Finding, warning
from ...session import EventRecord, FrameRecord, MeterCertificate, ReadingRecord, Role, Session, SessionConfiguration
from ...session.records import SIMULATED_BENCH

Report = Callable[[int, int], None]
Loader = Callable[[Session, Iterable[FrameRecord]], Iterator[Frame]]
_Key = TypeVar("_Key")
#: Of a session that was interrupted before its target was seen.
NO_LIGHT = "the session has no light frames: uncover the lens and resume the acquisition"


def frame_loader(report: Report, total: int) -> Loader:
    """Return a function that loads frames of a session one at a time, and reports how many of all were loaded."""
    numbers = count(1)

    def load(session: Session, records: Iterable[FrameRecord]) -> Iterator[Frame]:
        for record in records:
            yield session.load(record)
            report(next(numbers), total)

    return load


def require_patches(names: Iterable[str], known: Sequence[str], purpose: str) -> None:
    """Raise InputError for the first name that is not known."""
    unknown = sorted(set(names) - set(known))
    if unknown:
        raise InputError(f"there is no patch {unknown[0]!r} {purpose}: choose from {', '.join(known)}")


def require_distinct(sessions: Sequence[Session]) -> None:
    """Refuse sessions that share frames or readings: given twice, they would count as measured twice.

    Frames are the same if their pixels and exposures are, whatever their files and times. Readings are the same if
    their value and time are.

    Raises
    ------
    InputError
        If two sessions share any.
    """
    seen: dict[str, Session] = {}
    for session in sessions if len(sessions) > 1 else ():
        keys = pixel_hashes(session.load(record) for record in session.frames())
        keys += [f"{record.patch}\n{record.reading.value} {record.reading.timestamp}" for record in session.readings()]
        shared = [seen[key] for key in keys if key in seen]
        if shared:
            simulated = any(isinstance(r, EventRecord) and r.kind == SIMULATED_BENCH for r in session.records)
            other = "; the simulated bench has other noise with another seed in its file" if simulated else ""
            raise InputError(
                f"{len(shared)} of the {len(keys)} frames and readings of session {session.path} are also in "
                f"{shared[0].path}: nothing new was measured; give each session once, and no copy of it{other}"
            )
        seen |= dict.fromkeys(keys, session)


def pixel_hashes(frames: Iterable[Frame]) -> list[str]:
    """Hashes of the pixels of frames, but not of those of one value throughout: others may be alike."""
    return [pixels_sha256(frame) for frame in frames if frame.dn.min() < frame.dn.max()]


def noted(frames: Iterable[Frame], hashes: set[str]) -> Iterator[Frame]:
    """Yield frames, and note hashes of their pixels; simulated cameras have the same noise whenever they begin."""
    for frame in frames:
        if not frame.camera.simulated:
            hashes.update(pixel_hashes([frame]))
        yield frame


def measured_in(session: Session, calibration: AnyCalibration) -> bool:
    """Whether a calibration is of this session, also if parts of it were taken again since."""
    measured = calibration.provenance.measured
    return any(isinstance(record, ReadingRecord) and record.reading.timestamp == measured for record in session.records)


def configured_lens(configuration: SessionConfiguration) -> LensIdentity:
    """Return the configured lens as a calibration keeps it."""
    lens = configuration.lens
    return LensIdentity(
        lens.model,
        lens.serial or "",
        lens.focal_length_m,
        lens.f_number,
        lens.focus_distance_m,
        lens.refocus_rel,
        lens.stability_rel,
    )


def lens_findings(lens: LensIdentity, other: LensIdentity) -> list[Finding]:
    """Return a finding if only one of two lenses that are taken for the same has a serial number."""
    serial = lens.serial or other.serial
    return [warning("lens-serial-open", serial, model=lens.model)] if lens.serial_is_open(other) else []


def certificate_from_calibration(calibration: AnyCalibration, session: Session) -> MeterCertificate | None:
    """Return the certificate a calibration was made with, if it holds for a session that states none."""
    scale, meter = calibration.meter_scale, session.configuration.meter
    certificate = scale.certificate
    if certificate is None or meter.certificate is not None:
        return None
    if replace(scale.meter, simulated=False) != meter.identity:
        return None
    holds = all(certificate.holds_at(record.reading.timestamp) for record in session.readings())
    return certificate if holds else None


def planes_of(session: Session) -> tuple[str | None, ...]:
    """Colour planes of a session's frames, or None for the one of a monochrome sensor."""
    return (None,) if settings_frame(session).colour_filter is None else PLANES


def settings_frame(session: Session) -> Frame:
    """Return the first frame of a session without its pixels; raises CalibrationError if there is none."""
    records = session.frames()
    if not records:
        raise CalibrationError("the session has no frames: start the acquisition")
    return session.settings(records[0])


def by_exposure(records: Session | Iterable[FrameRecord], role: Role) -> dict[float, list[FrameRecord]]:
    """Frames of a role, of a session or some of them, by exposure in seconds, shortest first."""
    frames = records.frames(role) if isinstance(records, Session) else [r for r in records if r.role == role]
    return dict(sorted(_grouped(frames, lambda record: record.exposure_s).items()))


def by_patch(records: Iterable[FrameRecord]) -> dict[str | None, list[FrameRecord]]:
    """Frames by the patch shown; None stands for the whole target."""
    return _grouped(records, lambda record: record.patch)


def _grouped(records: Iterable[FrameRecord], key: Callable[[FrameRecord], _Key]) -> dict[_Key, list[FrameRecord]]:
    groups: dict[_Key, list[FrameRecord]] = {}
    for record in records:
        groups.setdefault(key(record), []).append(record)
    return groups


def frames_showing(session: Session, exposure_s: float, patches: Iterable[str]) -> dict[str, FrameRecord]:
    """Return, by patch, the first frame of an exposure that shows it."""
    records = by_exposure(session, "light")[exposure_s]
    return {name: next(record for record in records if record.patch in (None, name)) for name in patches}
