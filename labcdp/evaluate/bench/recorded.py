"""How the frames of a session are sorted, and what was before the camera."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ...calibration import AnyCalibration, LensIdentity
from ...core.frame import PLANES
from ...session import FrameRecord, MeterCertificate, Role, Session, SessionConfiguration

Report = Callable[[int, int], None]


def lens_of(configuration: SessionConfiguration) -> LensIdentity:
    """Return the configured lens as a calibration keeps it."""
    lens = configuration.lens
    return LensIdentity(
        lens.model, lens.serial, lens.focal_length_m, lens.f_number, lens.focus_distance_m, lens.refocus_rel
    )


def certificate_of(calibration: AnyCalibration, session: Session) -> MeterCertificate | None:
    """Return the certificate a calibration was made with, if it is for the meter of a session that states none."""
    scale, meter = calibration.meter_scale, session.configuration.meter
    date = None if meter.calibration_date is None else meter.calibration_date.isoformat()
    own = (scale.meter.model, scale.meter.serial, scale.meter.calibration_date)
    return scale.certificate if meter.certificate is None and own == (meter.model, meter.serial, date) else None


def planes_of(session: Session) -> tuple[str | None, ...]:
    """Colour planes of a session's frames, or None for the one of a monochrome sensor."""
    first = session.load(session.frames()[0])
    return (None,) if first.colour_filter is None else PLANES


def by_exposure(session: Session, role: Role) -> dict[float, list[FrameRecord]]:
    """Frames of a role by exposure in seconds, shortest first."""
    groups: dict[float, list[FrameRecord]] = {}
    for record in session.frames(role):
        groups.setdefault(record.exposure_s, []).append(record)
    return dict(sorted(groups.items()))


def by_patch(records: Sequence[FrameRecord]) -> dict[str | None, list[FrameRecord]]:
    """Frames by the patch shown; None stands for the whole target."""
    groups: dict[str | None, list[FrameRecord]] = {}
    for record in records:
        groups.setdefault(record.patch, []).append(record)
    return groups


def shows(record: FrameRecord, patch: str) -> bool:
    """Whether a patch can be seen in a frame."""
    return record.patch in (None, patch)
