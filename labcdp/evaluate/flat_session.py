"""Fall-off and defects of a camera from a session that shows it uniform light."""

from __future__ import annotations

import logging
from collections.abc import Callable

from ..calibration.defects import find_defects
from ..calibration.flat_field import measure_fall_off
from ..calibration.pixel_statistics import PixelStatistics, pixel_statistics
from ..calibration.planes import split
from ..errors import CalibrationError
from ..session import Role, Session
from .corrections import Corrections
from .recorded import by_exposure, lens_of, planes_of

_log = logging.getLogger(__name__)


def measure_corrections(
    session: Session,
    source_unevenness_rel: float,
    report: Callable[[int, int], None] = lambda _done, _total: None,
) -> dict[str | None, Corrections]:
    """Measure fall-off and defects of each plane from frames of a uniform source.

    Parameters
    ----------
    session : Session
        Recorded as any other, with a uniform source that fills the image in the place of the target, and dark frames.
    source_unevenness_rel : float
        Relative standard uncertainty of the source's uniformity.
    report : callable
        Called with the number of exposures read, and of all.

    Raises
    ------
    CalibrationError
        As `labcdp.calibration.flat_field.measure_fall_off`.
    SessionError
        If a file is missing or altered.
    """
    planes = planes_of(session)
    roles: tuple[Role, ...] = ("light", "dark")
    total = len(planes) * sum(len(by_exposure(session, role)) for role in roles)
    done = 0
    result: dict[str | None, Corrections] = {}
    for plane in planes:
        statistics: dict[Role, list[PixelStatistics]] = {role: [] for role in roles}
        for role in roles:
            for records in by_exposure(session, role).values():
                frames = (session.load(record) for record in records)
                statistics[role].append(pixel_statistics(f if plane is None else split(f)[plane] for f in frames))
                done += 1
                report(done, total)
        lights, darks = statistics["light"], statistics["dark"]
        fall_off = measure_fall_off(lights, darks, source_unevenness_rel)
        name = "" if plane is None else f"plane {plane}: "
        _log.info("%s%s", name, fall_off.reason)
        for warning in fall_off.warnings:
            _log.warning("%s%s", name, warning)
        unclipped = [light for light in lights if light.clipped.mean() < 0.01] or lights
        # Hot pixels show best in the longest darkness, dead ones in the brightest light.
        defects = find_defects(
            max(darks, key=lambda s: s.exposure_s), max(unclipped, key=lambda s: float(s.mean_dn.mean()))
        )
        result[plane] = Corrections(fall_off.chosen, defects)
    return result


def require_same_optics(session: Session, flat: Session) -> None:
    """Refuse a flat field of another camera or lens.

    Raises
    ------
    CalibrationError
        If camera, image size, pixel format, lens or f-number differ.
    """
    mine, theirs = (one.load(one.frames()[0]) for one in (session, flat))
    for what, a, b in (
        ("camera", str(mine.camera), str(theirs.camera)),
        ("image size", f"{mine.shape[1]} x {mine.shape[0]}", f"{theirs.shape[1]} x {theirs.shape[0]}"),
        ("pixel format", mine.pixel_format, theirs.pixel_format),
        ("lens", str(lens_of(session.configuration)), str(lens_of(flat.configuration))),
    ):
        if a != b:
            raise CalibrationError(
                f"the {what} of the flat field's session is {b}, that of the session {a}: record the flat field with "
                "the same camera and lens"
            )
