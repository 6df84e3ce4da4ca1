"""Measuring the pixels of frames of one exposure, in regions or as a whole; colour planes of Bayer frames."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

from numpy.typing import NDArray

from ...core.clock import exposure_text
from ...core.errors import CalibrationError
from ...core.frame import PLANES, BlackPattern, Frame
from ...core.roi import Roi
from .defects import DefectMap
from .observations import CameraState, Observation
from .statistics import FrameStatistics, FrameSums

_log = logging.getLogger(__name__)

#: Fewest frames: temporal noise comes from differences between them.
MIN_FRAMES = 2
#: Change of the device temperature over the frames of one exposure that is reported: with a dark current that doubles
#: every 6 to 10 degC it changes the dark current by about a tenth.
TEMPERATURE_DRIFT_C = 1.0
#: Row and column of each plane's pixel in the upper left 2 x 2 pixels, by the name of the pattern.
_POSITIONS: dict[str, dict[str, tuple[int, int]]] = {
    "RG": {"R": (0, 0), "Gr": (0, 1), "Gb": (1, 0), "B": (1, 1)},
    "GR": {"Gr": (0, 0), "R": (0, 1), "B": (1, 0), "Gb": (1, 1)},
    "GB": {"Gb": (0, 0), "B": (0, 1), "R": (1, 0), "Gr": (1, 1)},
    "BG": {"B": (0, 0), "Gb": (0, 1), "Gr": (1, 0), "R": (1, 1)},
}


@dataclass(frozen=True, eq=False, kw_only=True)
class MeasuredFrames(FrameStatistics, Observation):
    """The frames of one exposure, in a region or as a whole.

    Parameters
    ----------
    recorded : datetime or None
        When the first frame was recorded; None if unknown.
    region : Roi or None
        The region; None for the whole image.
    """

    recorded: datetime | None = None
    region: Roi | None = None

    @property
    def window(self) -> tuple[slice, slice]:
        """Rows and columns of the image that the statistics are of."""
        return (slice(None), slice(None)) if self.region is None else self.region.window(self.state.image_shape)


def measure_frames(
    frames: Iterable[Frame], regions: Sequence[Roi] | None = None, defects: DefectMap | None = None
) -> list[MeasuredFrames]:
    """Measure the pixels of frames of one exposure; the frames are processed one by one and not stored.

    Parameters
    ----------
    frames : iterable of Frame
        At least one, all of one exposure, camera and setting.
    regions : sequence of Roi or None
        What to measure; None for the whole image.
    defects : DefectMap or None
        Pixels to leave out.

    Raises
    ------
    CalibrationError
        If there is no frame, or frames differ in exposure, camera or setting, or are coloured.
    InputError
        If a region lies outside the image.
    """
    first: Frame | None = None
    temperatures: list[float | None] = []
    for frame in frames:
        if first is None:
            first, state = frame, CameraState.of(frame)
            windows, sums = _sums(frame, regions, defects)
        state.require(CameraState.of(frame), "the first frame", f"frame {frame.frame_id}")
        if frame.exposure_s != first.exposure_s:
            raise CalibrationError(
                f"frame {frame.frame_id} has an exposure of {exposure_text(frame.exposure_s)}, the first frame "
                f"{exposure_text(first.exposure_s)}: give frames of one exposure at a time"
            )
        temperatures.append(frame.temperature_c)
        for window, one in zip(windows, sums, strict=True):
            one.add(frame.dn[window])
    if first is None:
        raise CalibrationError(f"there is no frame: give at least {MIN_FRAMES} frames of one exposure")
    temperature_c = _mean_temperature(temperatures, first.exposure_s)
    taken: dict[str, Any] = {"exposure_s": first.exposure_s, "temperature_c": temperature_c, "state": state}
    return [
        MeasuredFrames(**vars(one.result()), **taken, recorded=first.timestamp, region=region)
        for region, one in zip([None] if regions is None else regions, sums, strict=True)
    ]


def measure_whole(frames: Iterable[Frame], defects: DefectMap | None = None) -> MeasuredFrames:
    """Measure the whole image in frames of one exposure; as `measure_frames`."""
    return measure_frames(frames, None, defects)[0]


def _sums(
    frame: Frame, regions: Sequence[Roi] | None, defects: DefectMap | None
) -> tuple[list[tuple[slice, slice]], list[FrameSums]]:
    sound = None if defects is None else ~defects.mask(frame.shape)
    if regions is None:
        return [(slice(None), slice(None))], [FrameSums(frame.saturation_dn, sound)]
    windows = [region.window(frame.shape) for region in regions]
    parts = [True if sound is None else sound[window] for window in windows]
    used = [region.mask(frame.shape) & part for region, part in zip(regions, parts, strict=True)]
    return windows, [FrameSums(frame.saturation_dn, mask) for mask in used]


def _mean_temperature(temperatures: Sequence[float | None], exposure_s: float) -> float | None:
    known = [t for t in temperatures if t is not None]
    if len(known) < len(temperatures):
        if known:
            _log.warning("some frames at %g s have no temperature: it is treated as unknown", exposure_s)
        return None
    if max(known) - min(known) > TEMPERATURE_DRIFT_C:
        text = "the camera's temperature went from %.1f to %.1f °C over the frames at %g s: let it warm up first"
        _log.warning(text, known[0], known[-1], exposure_s)
    return sum(known) / len(known)


def split(frame: Frame) -> dict[str, Frame]:
    """Split a Bayer frame into its four planes.

    Parameters
    ----------
    frame : Frame
        With a colour filter, shape (height, width). A last row or column without a partner is left out.

    Returns
    -------
    dict of str to Frame
        ``R``, ``Gr``, ``Gb`` and ``B``, each of shape (height // 2, width // 2), with the black level of its plane.

    Raises
    ------
    CalibrationError
        If the frame has no colour filter, or is a single row or column.
    """
    if frame.colour_filter is None:
        what = f"plane {frame.plane}" if frame.plane else "a monochrome sensor"
        raise CalibrationError(f"frame {frame.frame_id} is of {what}, it has no colour planes: use it as it is")
    height, width = frame.shape
    if height < 2 or width < 2:
        raise CalibrationError(
            f"frame {frame.frame_id} has {width} x {height} pixels: a Bayer frame has at least 2 x 2"
        )
    if height % 2 or width % 2:
        _log.info("frame %d has %d x %d pixels: the odd row or column is left out", frame.frame_id, width, height)
    black = {plane: _black_of_plane(frame, *_POSITIONS[frame.colour_filter][plane]) for plane in PLANES}
    even = frame.dn[: height // 2 * 2, : width // 2 * 2]
    positions = _POSITIONS[frame.colour_filter]
    return {
        plane: replace(
            frame,
            dn=_own(even[positions[plane][0] :: 2, positions[plane][1] :: 2]),
            black_level_dn=black[plane][0],
            black_pattern=black[plane][1],
            colour_filter=None,
            plane=plane,
            readout=frame.readout and frame.readout.in_larger_pixels(2),
        )
        for plane in PLANES
    }


def _black_of_plane(frame: Frame, row: int, column: int) -> tuple[float | None, BlackPattern | None]:
    """Black level of a plane, and the pattern around it."""
    if frame.black_level_dn is None or frame.black_pattern is None:
        return frame.black_level_dn, None
    height, width = (n // 2 * 2 for n in frame.shape)
    mean_dn, pattern = frame.black_pattern.of_plane((height, width), row, column)
    return frame.black_level_dn + mean_dn, pattern


def plane_of(frame: Frame, plane: str | None) -> Frame:
    """Return one plane of a Bayer frame, or with None the frame of a monochrome sensor itself."""
    return frame if plane is None else split(frame)[plane]


def _own(pixels: NDArray[Any]) -> NDArray[Any]:
    """Return a contiguous read-only copy, for repeated passes over the pixels."""
    copy = pixels.copy()
    copy.flags.writeable = False
    return copy


def plane_offset_px(state: CameraState) -> tuple[float, float]:
    """Middle (x, y) of a plane's pixels in their groups of 2 x 2, in pixels of the plane; 0 for a monochrome sensor."""
    positions = _POSITIONS.get(state.pixel_format.removeprefix("Bayer")[:2], {})
    row, column = positions.get(state.plane or "", (0.5, 0.5))
    return column / 2 - 0.25, row / 2 - 0.25


def plane_region(roi: Roi) -> Roi:
    """Return a region in pixels of the planes: a group of 2 x 2 pixels is included if its centre is."""
    return Roi(roi.name, tuple((x / 2, y / 2) for x, y in roi.corners))
