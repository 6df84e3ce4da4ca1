"""Defects and the pattern of the darkness from the dark frames that sessions have anyway."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

from ..calibration.dark_library import DarkLibrary, dark_library
from ..calibration.defects import DefectMap, find_defects
from ..calibration.pixel_statistics import PixelStatistics, pixel_statistics
from ..calibration.planes import split
from ..session import Session
from .corrections import Corrections, PlaneCorrections
from .recorded import Report, by_exposure

_log = logging.getLogger(__name__)


def with_darkness(
    corrections: PlaneCorrections, sessions: Sequence[Session], report: Report = lambda _done, _total: None
) -> dict[str | None, Corrections]:
    """Add what the dark frames of sessions show: hot and noisy pixels, and the pattern of the darkness.

    The pattern is added only where taking it off leaves less than it removes at an exposure of the light frames, and
    only if all sessions have one gain, as it grows with the gain.

    Parameters
    ----------
    corrections : mapping of (str or None) to Corrections
        By colour plane, None for a monochrome sensor; those of another source of dark frames are replaced.
    sessions : sequence of Session
        Of one camera; dark frames at several temperatures tell how the pattern grows with them.
    report : callable
        Called with the number of exposures read, and of all.

    Raises
    ------
    SessionError
        If a file is missing or altered.
    CalibrationError
        If frames of one exposure differ in camera or setting.
    """
    total = len(corrections) * sum(len(by_exposure(session, "dark")) for session in sessions)
    light_s = sorted({t for session in sessions for t in by_exposure(session, "light")})
    done = 0
    result: dict[str | None, Corrections] = {}
    for plane, own in corrections.items():
        darks: list[PixelStatistics] = []
        for session in sessions:
            for records in by_exposure(session, "dark").values():
                frames = (session.load(record) for record in records)
                darks.append(pixel_statistics(f if plane is None else split(f)[plane] for f in frames))
                done += 1
                report(done, total)
        name = "" if plane is None else f"plane {plane}: "
        defects = _defects(own, darks, name)
        result[plane] = replace(own, defects=defects, dark_library=_library(darks, defects, light_s, name))
    return result


def _defects(own: Corrections, darks: Sequence[PixelStatistics], name: str) -> DefectMap | None:
    repeated = [dark for dark in darks if dark.n_frames > 1]
    if not repeated:
        return own.defects
    # Hot pixels show best in the longest darkness.
    found = find_defects(max(repeated, key=lambda dark: dark.exposure_s))
    if found.n_pixels == 0:
        return own.defects
    _log.info("%sthe dark frames show %d hot or noisy pixels, which are left out", name, found.n_pixels)
    return found if own.defects is None else own.defects.joined(found)


def _library(
    darks: Sequence[PixelStatistics], defects: DefectMap | None, light_s: Sequence[float], name: str
) -> DarkLibrary | None:
    if not any(dark.n_frames > 1 for dark in darks) or len({dark.state.gain_db for dark in darks}) > 1:
        return None
    library = dark_library(darks, defects)
    worth = [t for t in light_s if library.worth_applying(t)]
    _log.info("%s%s", name, library.verdict(max(worth or light_s)))
    return library if worth else None
