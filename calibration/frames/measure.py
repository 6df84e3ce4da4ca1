"""Measuring the pixels of frames of one exposure, in regions or as a whole; colour planes of Bayer frames."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from datetime import datetime
from functools import cached_property
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.clock import exposure_text
from ...core.dn import look_up
from ...core.errors import CalibrationError
from ...core.frame import COLOUR_FILTERS, PLANES, BlackPattern, Frame, plane_positions
from ...core.roi import Roi
from .defects import DefectMap
from .observations import CameraState, Observation
from .rounding import quantisation_variance_dn2
from .statistics import Level, LineVariances

_log = logging.getLogger(__name__)

#: Fewest frames: temporal noise comes from differences between them.
MIN_FRAMES = 2
#: Pixels whose arrays fit in the processor's cache.
_BLOCK = 2**16
_NO_DEFECTS: Mapping[str | None, DefectMap | None] = {}
#: Change of the device temperature over the frames of one exposure that is reported: with a dark current that doubles
#: every 6 to 10 degC it changes the dark current by about a tenth.
TEMPERATURE_DRIFT_C = 1.0


@dataclass(frozen=True, eq=False, kw_only=True)
class MeasuredFrames(Observation):
    """The frames of one exposure, in a region or as a whole: their level, and mean images.

    Parameters
    ----------
    image_dn, variance_image_dn2 : ndarray of float32 or float64, shape (height, width)
        Mean, and variance over the frames (n - 1; 0 for a single frame), of each pixel.
    used : ndarray of bool, shape (height, width)
        The pixels that all else is about.
    clipped : ndarray of bool, shape (height, width)
        Pixels that were saturated or at 0 DN in at least one frame.
    temporal : LineVariances
        Over the frames, changes common to all pixels excluded (EMVA 1288 Release 4.0 Linear).
    recorded : datetime or None
        When the first frame was recorded; None if unknown.
    region : Roi or None
        The region; None for the whole image.
    """

    image_dn: NDArray[np.floating[Any]]
    variance_image_dn2: NDArray[np.floating[Any]]
    used: NDArray[np.bool_]
    clipped: NDArray[np.bool_]
    temporal: LineVariances
    recorded: datetime | None = None
    region: Roi | None = None

    @property
    def level(self) -> Level:
        """The level without images."""
        return Level(**{part.name: getattr(self, part.name) for part in fields(Level)})

    @property
    def window(self) -> tuple[slice, slice]:
        """Rows and columns of the image that the images show."""
        return (slice(None), slice(None)) if self.region is None else self.region.window(self.state.image_shape)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the window."""
        return self.image_dn.shape[0], self.image_dn.shape[1]

    @cached_property
    def n_lines(self) -> tuple[float, float]:
        """Effective numbers of columns and of rows in the mean: those of a rectangle, fewer for other shapes."""
        columns, rows = (float(self.n_pixels**2 / np.sum(self.used.sum(axis=axis) ** 2.0)) for axis in (0, 1))
        return columns, rows

    @cached_property
    def temporal_parts(self) -> LineVariances:
        """Noise of single pixels, columns and rows, at least 0."""
        columns, rows = self.n_lines
        parts = self.temporal.parts(self.n_pixels / columns, self.n_pixels / rows)
        return LineVariances(*(max(part, 0.0) for part in (parts.pixel, parts.column, parts.row)))

    @cached_property
    def spatial_variance_dn2(self) -> float:
        """Variance of the pixels' means, less what temporal noise leaves in it; at least 0."""
        variance = float(np.var(self.image_dn[self.used], ddof=1, dtype=np.float64))
        return max(variance - self.temporal_variance_dn2 / self.n_frames, 0.0)

    @cached_property
    def typical_variance_dn2(self) -> float:
        """Variance over the frames of a typical pixel: the mean without the noisiest thousandth."""
        limit = np.quantile(self.variance_image_dn2, 0.999)
        return float(np.minimum(self.variance_image_dn2, limit).mean(dtype=np.float64))

    @property
    def pixel_mean_variance_dn2(self) -> float:
        """Variance of the mean of a typical pixel, by noise and rounding."""
        rounding_dn2 = quantisation_variance_dn2(self.typical_variance_dn2, self.step_dn)
        return self.typical_variance_dn2 / self.n_frames + rounding_dn2


class FrameSums:
    """Accumulates the frames of one exposure, or the same window of each.

    Parameters
    ----------
    state : CameraState
        Camera and settings of the frames.
    exposure_s : float
        Their exposure time.
    used : ndarray of bool, shape (height, width), or None
        Pixels of the window to use, None for all.
    region : Roi or None
        The region whose window it is; None for the whole image.
    """

    def __init__(
        self,
        state: CameraState,
        exposure_s: float,
        used: NDArray[np.bool_] | None = None,
        region: Roi | None = None,
    ) -> None:
        self.state, self.exposure_s = state, exposure_s
        self._used, self._region = used, region
        # Integers of 16 bits are summed exactly in integers, wider and expanded values in float64: exact to 53 bits.
        is_wide = state.has_hand_overs
        self._sum_type: type[np.number[Any]] = np.float64 if is_wide else np.int32
        self._image_type: type[np.floating[Any]] = np.float64 if is_wide else np.float32
        self._square_type: type[np.number[Any]] = np.float64 if is_wide else np.int64
        self._first: NDArray[Any] | None = None
        self._columns: list[NDArray[Any]] = []
        self._rows: list[NDArray[Any]] = []
        self._saturated = self._black = self._bits = 0
        self._steps_dn2 = 0.0

    @property
    def window(self) -> tuple[slice, slice]:
        """Rows and columns of the image that count."""
        return (slice(None), slice(None)) if self._region is None else self._region.window(self.state.image_shape)

    def add(self, dn: NDArray[np.unsignedinteger[Any]]) -> None:
        """Add the values of a frame, shape (height, width); of companded data the codes."""
        first, curve = self._first, self.state.companding
        if first is None:
            self._first = dn.copy() if curve is None else look_up(curve.linear_by_dn, dn)
            self._total = np.zeros(dn.shape, self._sum_type)
            self._squares = np.zeros(dn.shape, self._square_type)
            self._clipped = np.zeros(dn.shape, dtype=np.bool_)
        columns, rows = np.zeros(dn.shape[1], self._square_type), np.empty(dn.shape[0], self._square_type)
        for part in blocks(dn.shape):
            codes = dn[part]
            values = codes if curve is None else look_up(curve.linear_by_dn, codes)
            if first is not None:
                # Differences to the first frame: their squares do not cancel.
                change = np.subtract(values, first[part], dtype=self._sum_type)
                self._total[part] += change
                self._squares[part] += np.square(change, dtype=self._square_type)
            saturated, black = values >= self.state.saturation_dn, codes == 0
            self._clipped[part] |= saturated | black
            if self._used is not None:
                used = self._used[part]
                codes = np.where(used, codes, codes.dtype.type(0))
                values = codes if curve is None else np.where(used, values, 0.0)
                saturated, black = saturated & used, black & used
            columns += values.sum(axis=0, dtype=self._square_type)
            rows[part] = values.sum(axis=1, dtype=self._square_type)
            self._saturated += int(np.count_nonzero(saturated))
            self._black += int(np.count_nonzero(black))
            self._bits |= int(np.bitwise_or.reduce(codes, axis=None))
            if curve is not None:
                squares = np.square(look_up(curve.steps_by_dn, codes))
                self._steps_dn2 += float(squares.sum(where=True if self._used is None else used))
        self._columns.append(columns)
        self._rows.append(rows)

    @property
    def n_frames(self) -> int:
        """How many were added."""
        return len(self._rows)

    def result(self, temperature_c: float | None = None, recorded: datetime | None = None) -> MeasuredFrames:
        """Return what was added, at least one frame, with the mean temperature and the time of the first frame."""
        assert self._first is not None
        n, shape = self.n_frames, self._first.shape
        used = np.ones(shape, np.bool_) if self._used is None else self._used
        size = int(np.count_nonzero(used))
        image_dn, variance_dn2 = (np.empty(shape, self._image_type) for _ in range(2))
        squares = 0.0
        for part in blocks(shape):
            total = self._total[part]
            # Sums of the squared deviations from each pixel's own mean.
            deviations = np.maximum(self._squares[part] - np.square(total, dtype=np.float64) / n, 0)
            squares += float(deviations.sum(where=used[part]))
            image_dn[part] = self._first[part] + total / n
            variance_dn2[part] = deviations / max(n - 1, 1)
        frame_means = np.array([rows.sum() for rows in self._rows]) / size
        common = size * float(np.sum((frame_means - frame_means.mean()) ** 2))
        temporal_dn2 = max(squares - common, 0.0) / (max(size - 1, 1) * max(n - 1, 1))
        of_lines = [
            _line_variance(np.array(sums), used.sum(axis=axis), frame_means)
            for axis, sums in ((0, self._columns), (1, self._rows))
        ]
        return MeasuredFrames(
            exposure_s=self.exposure_s,
            state=self.state,
            temperature_c=temperature_c,
            recorded=recorded,
            region=self._region,
            image_dn=image_dn,
            variance_image_dn2=variance_dn2,
            used=used,
            clipped=self._clipped,
            mean_dn=float(frame_means.mean()),
            temporal_variance_dn2=temporal_dn2,
            n_pixels=size,
            frame_means_dn=tuple(frame_means.tolist()),
            temporal=LineVariances(temporal_dn2, *of_lines),
            saturated_share=self._saturated / (size * n),
            black_share=self._black / (size * n),
            multiple=min(self._bits & -self._bits, 16) if self._bits else 1,
            step_dn=sqrt(self._steps_dn2 / (size * n)) if self.state.companding is not None else 1.0,
        )


def blocks(shape: tuple[int, ...]) -> Iterator[slice]:
    """Yield rows of an image, as many as fit in the processor's cache."""
    step = max(_BLOCK // max(shape[1], 1), 1)
    return (slice(start, start + step) for start in range(0, shape[0], step))


def _line_variance(sums: NDArray[Any], counts: NDArray[np.int64], frame_means: NDArray[np.float64]) -> float:
    """Variance over the frames of the means of columns or rows, less the mean of the frame."""
    if len(frame_means) < 2:
        return 0.0
    filled = counts > 0
    means = sums[:, filled] / counts[filled] - frame_means[:, None]
    return float(means.var(axis=0, ddof=1).mean())


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
    return measure_planes(frames, (None,), regions, {None: defects})[None]


def measure_planes(
    frames: Iterable[Frame],
    planes: Sequence[str | None],
    regions: Sequence[Roi] | None = None,
    defects: Mapping[str | None, DefectMap | None] = _NO_DEFECTS,
) -> dict[str | None, list[MeasuredFrames]]:
    """Measure frames of one exposure in each of their colour planes; as `measure_frames`.

    Parameters
    ----------
    frames, regions
        As for `measure_frames`; regions in pixels of the whole image.
    planes : sequence of str, or of None
        Planes of a Bayer sensor; None alone for a monochrome one.
    defects : mapping of (str or None) to (DefectMap or None)
        Pixels to leave out, by plane.
    """
    first: Frame | None = None
    states: dict[str | None, CameraState] = {}
    sums: dict[str | None, list[FrameSums]] = {}
    temperatures: list[float | None] = []
    for frame in frames:
        first = first or frame
        split_frame = {} if planes[0] is None else split(frame)
        for plane in planes:
            pixels = frame if plane is None else split_frame[plane]
            state = CameraState.of(pixels)
            if plane not in sums:
                parts = regions if plane is None or regions is None else [plane_region(region) for region in regions]
                states[plane] = state
                sums[plane] = _sums(state, frame.exposure_s, parts, defects.get(plane))
            states[plane].require(state, "the first frame", f"frame {frame.frame_id}")
            for part in sums[plane]:
                part.add(pixels.dn[part.window])
        if frame.exposure_s != first.exposure_s:
            raise CalibrationError(
                f"frame {frame.frame_id} has an exposure of {exposure_text(frame.exposure_s)}, the first frame "
                f"{exposure_text(first.exposure_s)}: give frames of one exposure at a time"
            )
        temperatures.append(frame.temperature_c)
    if first is None:
        raise CalibrationError(f"there is no frame: give at least {MIN_FRAMES} frames of one exposure")
    taken = _mean_temperature(temperatures, first.exposure_s), first.timestamp
    return {plane: [part.result(*taken) for part in parts] for plane, parts in sums.items()}


def measure_whole(frames: Iterable[Frame], defects: DefectMap | None = None) -> MeasuredFrames:
    """Measure the whole image in frames of one exposure; as `measure_frames`."""
    return measure_frames(frames, None, defects)[0]


def _sums(
    state: CameraState, exposure_s: float, regions: Sequence[Roi] | None, defects: DefectMap | None
) -> list[FrameSums]:
    shape = state.image_shape
    sound = None if defects is None else ~defects.mask(shape)
    if regions is None:
        return [FrameSums(state, exposure_s, sound)]
    used = [region.mask(shape) & (True if sound is None else sound[region.window(shape)]) for region in regions]
    return [FrameSums(state, exposure_s, *part) for part in zip(used, regions, strict=True)]


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
    """Split a Bayer frame, or one with clear pixels in the place of green ones, into its four planes.

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
    positions = plane_positions(frame.colour_filter)
    black = {plane: _black_of_plane(frame, *positions[plane]) for plane in PLANES}
    even = frame.dn[: height // 2 * 2, : width // 2 * 2]
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
    pattern = state.pixel_format.removeprefix("Bayer")[:2]
    positions = plane_positions(pattern) if pattern in COLOUR_FILTERS else {}
    row, column = positions.get(state.plane or "", (0.5, 0.5))
    return column / 2 - 0.25, row / 2 - 0.25


def plane_region(roi: Roi) -> Roi:
    """Return a region in pixels of the planes: a group of 2 x 2 pixels is included if its centre is."""
    return Roi(roi.name, tuple((x / 2, y / 2) for x, y in roi.corners))
