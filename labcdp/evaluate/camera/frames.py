"""What the frames of a session say about the camera alone: dark signal, and patches of steady light."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ...calibration import CameraState
from ...calibration.frames.measure import MeasuredFrames, measure_frames, measure_whole
from ...calibration.frames.planes import plane_region, split
from ...core.errors import CalibrationError
from ...core.finding import Finding, info
from ...core.frame import Frame
from ...session import FrameRecord, Session
from ..bench.recorded import by_patch

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
    reader = _Reader(session, len(records), report)
    patches = [patch.region() for patch in session.configuration.target.patches]
    darks = [
        measure_whole(reader.frames(group))
        for exposure in _by_exposure(records, "dark")
        for group in _by_temperature(exposure)
        if len(group) > 1
    ]
    if not darks:
        raise CalibrationError(
            "the session has no exposure with at least 2 dark frames: cover the lens and resume the acquisition"
        )
    levels = []
    for exposure in _by_exposure(records, "light"):
        for shown, group in by_patch(exposure).items():
            if len(group) > 1:
                seen = [patch for patch in patches if shown in (None, patch.name)]
                regions = [plane_region(patch) for patch in seen] if reader.of_plane else seen
                levels += measure_frames(reader.frames(group), regions)
    assert reader.state is not None
    return SessionFrames(reader.state, darks, levels, tuple(findings))


class _Reader:
    """Reads frames, reports progress, and checks that camera and settings do not change."""

    def __init__(self, session: Session, total: int, report: Callable[[int, int], None]) -> None:
        self._session = session
        self._total = total
        self._report = report
        self._done = 0
        self.state: CameraState | None = None

    def frames(self, records: Iterable[FrameRecord]) -> Iterable[Frame]:
        for record in records:
            frame = self._session.load(record)
            if frame.colour_filter is not None:
                frame = split(frame)[COLOUR_PLANE]
            state = CameraState.of(frame)
            if self.state is None:
                self.state = state
            self.state.require(state, "the first frame", f"frame {record.number}")
            self._done += 1
            self._report(self._done, self._total)
            yield frame

    @property
    def of_plane(self) -> bool:
        return self.state is not None and self.state.plane is not None


def _of_one_gain(records: Sequence[FrameRecord]) -> tuple[list[FrameRecord], list[Finding]]:
    """Frames of the gain that has the most: all quantities belong to one gain."""
    gains = Counter(record.gain_db for record in records)
    if len(gains) < 2:
        return list(records), []
    gain_db = gains.most_common(1)[0][0]
    others = [gain for gain in sorted(gains) if gain != gain_db]
    kept = [record for record in records if record.gain_db == gain_db]
    return kept, [info("other-gains-left-out", gain_db=gain_db, left_out_db=others)]


def _by_exposure(records: Iterable[FrameRecord], role: str) -> list[list[FrameRecord]]:
    groups: dict[float, list[FrameRecord]] = {}
    for record in records:
        if record.role == role:
            groups.setdefault(record.exposure_s, []).append(record)
    return [groups[exposure_s] for exposure_s in sorted(groups)]


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
