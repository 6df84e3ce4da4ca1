"""What the frames of a session say about the camera alone: dark signal, and patches of steady light."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...calibration import CameraState
from ...calibration.frames.measure import MeasuredFrames, measure_frames, measure_whole
from ...calibration.frames.planes import plane_region
from ...core.errors import CalibrationError
from ...core.finding import Finding, info
from ...session import FrameRecord, Session
from ..bench.recorded import SessionReader, by_exposure, by_patch, planes_of

#: Colour plane of a Bayer sensor that is characterised: of the planes the one with the most light from any source.
COLOUR_PLANE = "Gr"
#: Dark frames of one exposure whose temperatures differ by more, in kelvin, are taken apart.
_SAME_TEMPERATURE_K = 1.0


@dataclass(frozen=True, eq=False)
class SessionFrames:
    """All frames of a session, measured.

    Parameters
    ----------
    state : CameraState
        Camera and settings, of the colour plane if there is one.
    darks : list of MeasuredFrames
        In rising order of exposure, then of temperature.
    patches : list of MeasuredFrames
        By region, in rising order of exposure.
    findings : tuple of Finding
        What was left out.
    """

    state: CameraState
    darks: Sequence[MeasuredFrames]
    patches: Sequence[MeasuredFrames]
    findings: tuple[Finding, ...]


def measure_session(session: Session, report: Callable[[int, int], None]) -> SessionFrames:
    """Measure the frames of a session, one at a time.

    Parameters
    ----------
    session : Session
        To read.
    report : callable
        Called with the number of frames read, and of all frames.

    Raises
    ------
    SessionError
        If a file is missing or altered.
    CalibrationError
        If there are no dark frames, fewer than two frames of all that is alike, or the camera or its settings change.
    InputError
        If a patch lies outside the image.
    """
    records, findings = _of_one_gain(session.frames())
    reader = SessionReader(report, len(records))
    plane = None if planes_of(session) == (None,) else COLOUR_PLANE
    patches = [patch.region() for patch in session.configuration.target.patches]
    darks = [
        measure_whole(reader.frames(session, group, plane))
        for exposure in by_exposure(records, "dark").values()
        for group in _by_temperature(exposure)
        if len(group) > 1
    ]
    if not darks:
        raise CalibrationError(
            "the session has no exposure with at least 2 dark frames: cover the lens and resume the acquisition"
        )
    levels = []
    for exposure in by_exposure(records, "light").values():
        for shown, group in by_patch(exposure).items():
            if len(group) > 1:
                seen = [patch for patch in patches if shown in (None, patch.name)]
                regions = seen if plane is None else [plane_region(patch) for patch in seen]
                levels += measure_frames(reader.frames(session, group, plane), regions)
    for level in (*darks[1:], *levels):
        darks[0].state.require(level.state, "the dark frames", f"the set of frames at {level.exposure_s:g} s")
    return SessionFrames(darks[0].state, darks, levels, tuple(findings))


def _of_one_gain(records: Sequence[FrameRecord]) -> tuple[list[FrameRecord], list[Finding]]:
    """Frames of the gain that has the most: all quantities belong to one gain."""
    gains = Counter(record.gain_db for record in records)
    if len(gains) < 2:
        return list(records), []
    gain_db = gains.most_common(1)[0][0]
    others = [gain for gain in sorted(gains) if gain != gain_db]
    kept = [record for record in records if record.gain_db == gain_db]
    return kept, [info("other-gains-left-out", gain_db=gain_db, left_out_db=others)]


def _by_temperature(records: Sequence[FrameRecord]) -> list[list[FrameRecord]]:
    """Split frames where the temperature has changed; those without a temperature come together."""
    known = sorted((t, r.sequence, r) for r in records if (t := _temperature(r)) is not None)
    groups: list[list[FrameRecord]] = []
    first = -np.inf
    for temperature, _, record in known:
        if temperature > first + _SAME_TEMPERATURE_K:
            groups.append([])
            first = temperature
        groups[-1].append(record)
    unknown = [record for record in records if _temperature(record) is None]
    return [*groups, unknown] if unknown else groups


def _temperature(record: FrameRecord) -> float | None:
    value = record.metadata.get("temperature_c")
    return None if value is None else float(value)
