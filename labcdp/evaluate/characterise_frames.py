"""What the frames of a session say about the camera alone: darkness, and patches of steady light."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..calibration import CameraState
from ..calibration.emva.statistics import FrameStatistics, FrameSums, NoiseParts
from ..calibration.planes import plane_region, split
from ..errors import CalibrationError
from ..frame import Frame
from ..roi import Roi
from ..session import FrameRecord, Session
from .recorded import by_patch

#: Colour plane of a Bayer sensor that is characterised: of the planes the one with the most light from any source.
COLOUR_PLANE = "Gr"
#: Dark frames of one exposure whose temperatures differ by more, in kelvin, are taken apart.
_SAME_TEMPERATURE_K = 1.0


@dataclass(frozen=True, eq=False)
class DarkLevel:
    """Dark frames of one exposure and temperature.

    Parameters
    ----------
    exposure_s : float
        Exposure time.
    temperature_c : float or None
        Mean temperature, if known.
    statistics : FrameStatistics
        Over the whole sensor.
    mean_dn : ndarray of float32, shape (height, width)
        Mean image.
    noise : NoiseParts
        What temporal noise leaves in it.
    """

    exposure_s: float
    temperature_c: float | None
    statistics: FrameStatistics
    mean_dn: NDArray[np.float32]
    noise: NoiseParts


@dataclass(frozen=True, eq=False)
class PatchLevel:
    """One patch at one exposure.

    Parameters
    ----------
    region : Roi
        The patch, in pixels of the image or of the colour plane.
    exposure_s : float
        Exposure time.
    temperature_c : float or None
        Mean temperature, if known.
    statistics : FrameStatistics
        Over the region.
    mean_dn : ndarray of float, shape (n,)
        Mean of each pixel of the region.
    """

    region: Roi
    exposure_s: float
    temperature_c: float | None
    statistics: FrameStatistics
    mean_dn: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SessionFrames:
    """All frames of a session, measured.

    Parameters
    ----------
    state : CameraState
        Camera and settings, of the colour plane if there is one.
    darks : list of DarkLevel
        In rising order of exposure, then of temperature.
    patches : list of PatchLevel
        In rising order of exposure.
    flags : tuple of str
        What was left out.
    """

    state: CameraState
    darks: Sequence[DarkLevel]
    patches: Sequence[PatchLevel]
    flags: tuple[str, ...]


def measure_frames(session: Session, report: Callable[[int, int], None]) -> SessionFrames:
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
    records, flags = _of_one_gain(session.frames())
    reader = _Reader(session, len(records), report)
    patches = [patch.region() for patch in session.configuration.target.patches]
    darks = [
        _dark(reader, group)
        for exposure in _by_exposure(records, "dark")
        for group in _by_temperature(exposure)
        if len(group) > 1
    ]
    if not darks:
        raise CalibrationError(
            "the session has no exposure with at least 2 dark frames: cover the lens and go on with the acquisition"
        )
    levels = []
    for exposure in _by_exposure(records, "light"):
        for shown, group in by_patch(exposure).items():
            if len(group) > 1:
                levels += _patches(reader, group, [patch for patch in patches if shown in (None, patch.name)])
    assert reader.state is not None
    return SessionFrames(reader.state, darks, levels, tuple(flags))


class _Reader:
    """Reads frames, tells progress, and sees that camera and settings stay the same."""

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


def _dark(reader: _Reader, records: Sequence[FrameRecord]) -> DarkLevel:
    sums = None
    for frame in reader.frames(records):
        sums = sums or FrameSums(frame.saturation_dn)
        sums.add(frame.dn)
    assert sums is not None
    return DarkLevel(
        records[0].exposure_s,
        _mean_temperature(records),
        sums.result(),
        sums.mean_image().astype(np.float32),
        sums.noise_of_mean(),
    )


def _patches(reader: _Reader, records: Sequence[FrameRecord], regions: Sequence[Roi]) -> list[PatchLevel]:
    sums: list[FrameSums] = []
    for frame in reader.frames(records):
        if not sums:
            regions = [plane_region(region) for region in regions] if reader.of_plane else regions
            sums = [FrameSums(frame.saturation_dn) for _ in regions]
        for region, one in zip(regions, sums, strict=True):
            one.add(region.select(frame.dn))
    return [
        PatchLevel(region, records[0].exposure_s, _mean_temperature(records), one.result(), one.mean_image())
        for region, one in zip(regions, sums, strict=True)
    ]


def _of_one_gain(records: Sequence[FrameRecord]) -> tuple[list[FrameRecord], list[str]]:
    """Frames of the gain that has the most: all quantities belong to one gain."""
    gains = Counter(record.gain_db for record in records)
    if len(gains) < 2:
        return list(records), []
    gain_db = gains.most_common(1)[0][0]
    others = ", ".join(f"{gain:g} dB" for gain in sorted(gains) if gain != gain_db)
    return [record for record in records if record.gain_db == gain_db], [
        f"the session has several gains: all values are for {gain_db:g} dB, the frames at {others} were left out"
    ]


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


def _mean_temperature(records: Sequence[FrameRecord]) -> float | None:
    known = [value for record in records if (value := _temperature(record)) is not None]
    return float(np.mean(known)) if known else None


def _temperature(record: FrameRecord) -> float | None:
    value = record.metadata.get("temperature_c")
    return None if value is None else float(value)
