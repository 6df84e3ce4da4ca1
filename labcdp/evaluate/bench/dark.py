"""Defects and the dark pattern from the dark frames that sessions have anyway."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...calibration.dark.library import DarkLibrary, dark_library
from ...calibration.defects import DefectMap, find_defects
from ...calibration.frames.measure import MeasuredFrames, measure_whole
from ...core.finding import Finding, info
from ...session import Session
from .corrections import Corrections, PlaneCorrections
from .recorded import Report, SessionReader, by_exposure


def with_dark_frames(
    corrections: PlaneCorrections, sessions: Sequence[Session], report: Report = lambda _done, _total: None
) -> dict[str | None, Corrections]:
    """Add what the dark frames of sessions show: hot and noisy pixels, and the pattern of the dark signal.

    The pattern is added only where taking it off leaves less than it removes at an exposure of the light frames, and
    only if all sessions have one gain, as it grows with the gain.

    Parameters
    ----------
    corrections : mapping of (str or None) to Corrections
        By colour plane, None for a monochrome sensor; those of another source of dark frames are replaced.
    sessions : sequence of Session
        Sessions of one camera; dark frames at several temperatures determine the temperature dependence.
    report : callable
        Called with the number of frames read, and of all.

    Raises
    ------
    SessionError
        If a file is missing or altered.
    CalibrationError
        If frames of one exposure differ in camera or setting.
    """
    reader = SessionReader(report, len(corrections) * sum(len(session.frames("dark")) for session in sessions))
    light_s = sorted({t for session in sessions for t in by_exposure(session, "light")})
    result: dict[str | None, Corrections] = {}
    for plane, own in corrections.items():
        darks = [
            measure_whole(reader.frames(session, records, plane))
            for session in sessions
            for records in by_exposure(session, "dark").values()
        ]
        defects, of_defects = _defects(own, darks)
        library, of_library = _library(darks, defects, light_s)
        findings = (*own.findings, *of_defects, *of_library)
        result[plane] = replace(own, defects=defects, dark_library=library, findings=findings)
    return result


def _defects(own: Corrections, darks: Sequence[MeasuredFrames]) -> tuple[DefectMap | None, list[Finding]]:
    repeated = [dark for dark in darks if dark.statistics.n_frames > 1]
    if not repeated:
        return own.defects, []
    # Hot pixels show best in the longest dark signal.
    found = find_defects(max(repeated, key=lambda dark: dark.exposure_s).statistics)
    if found.n_pixels == 0:
        return own.defects, []
    return found if own.defects is None else own.defects.joined(found), [info("hot-pixels", count=found.n_pixels)]


def _library(
    darks: Sequence[MeasuredFrames], defects: DefectMap | None, light_s: Sequence[float]
) -> tuple[DarkLibrary | None, list[Finding]]:
    if not any(dark.statistics.n_frames > 1 for dark in darks) or len({dark.state.gain_db for dark in darks}) > 1:
        return None, []
    library = dark_library(darks, defects)
    worth = [t for t in light_s if library.worth_applying(t)]
    return library if worth else None, [library.verdict(max(worth or light_s))]
