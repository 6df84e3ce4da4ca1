"""The image that regions are drawn on, a picture or a frame of a video: DN, luminance and display."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import floor, isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError, printable
from ...core.frame import filter_name
from ...core.luminance import WHOLE, Invalid, LuminanceMap, Window
from ...core.result import Finding, unique
from ...core.roi import Roi
from ...files.video.selection import Position, Selection
from ...files.video.source import VideoSource, frames_of
from ...metrics.region import RegionPixels
from ...report.text import Z_95, bounded, finding_text, significant, with_half_width
from .display import block_means

if TYPE_CHECKING:
    from ...core.frame import Frame
    from ...evaluate.picture.converter import Converter
    from ...files.picture import Picture


#: What converts some rows and columns of an image.
LightOf = Callable[[Window], LuminanceMap]
#: Text for an invalid pixel under the pointer.
_REASONS = {
    Invalid.SATURATED: "saturated",
    Invalid.BELOW_BLACK: "below the black",
    Invalid.OUTSIDE_CALIBRATED: "outside the calibrated range",
    Invalid.DEFECT: "defect",
    Invalid.INCONSISTENT: "different between the exposures",
}


@dataclass(frozen=True, eq=False)
class PageImage:
    """An image for the page.

    Parameters
    ----------
    name : str
        Name of the file.
    values : ndarray of uint8, uint16 or float32, shape (height, width)
        DN, or the values of a float file.
    is_dn : bool
        Whether the values are DN.
    colour_filter : str or None
        Colour filter pattern of a Bayer frame.
    light : LuminanceMap, or function of a window
        Luminance, in `unit`; or what converts some rows and columns of its map, so that nothing else is.
    unit : str
        ``cd/m^2``, or ``relative`` for an uncalibrated camera.
    findings : tuple of Finding
        Findings of the conversion.
    saturation_dn : float or None
        DN from which a pixel is saturated; None if only the map says it.
    simulated : bool
        Whether the camera was simulated.
    taken : (float, float) or None
        Exposure and gain of a live image.
    """

    name: str
    values: NDArray[Any]
    is_dn: bool
    colour_filter: str | None
    light: LuminanceMap | LightOf
    unit: str
    findings: tuple[Finding, ...] = ()
    saturation_dn: float | None = None
    simulated: bool = False
    taken: tuple[float, float] | None = None

    @classmethod
    def of(cls, picture: Picture, converter: Converter) -> PageImage:
        """Convert a picture; raises CalibrationError and InputError as the conversion does."""
        light, findings = converter.luminance(picture), unique(converter.findings(picture))
        name, unit = printable(picture.path.name), converter.unit_of(picture)
        if picture.frame is not None:
            return cls.from_frame(name, picture.frame, light, unit, findings)
        assert picture.light is not None, "a picture has a frame or light"
        return cls(name, picture.light, False, None, light, unit, findings)

    @classmethod
    def from_frame(
        cls, name: str, frame: Frame, light: LuminanceMap | LightOf, unit: str, findings: tuple[Finding, ...] = ()
    ) -> PageImage:
        """Join a frame with its luminance."""
        simulated = frame.camera.simulated
        return cls(name, frame.dn, True, frame.colour_filter, light, unit, findings, simulated=simulated)

    @classmethod
    def live(cls, frame: Frame, converter: Converter) -> PageImage:
        """Prepare to convert a frame; raises CalibrationError if it is not of the calibrated camera or setting."""
        convert = partial(converter.convert, frame)
        convert((slice(0, 1), slice(0, 1)))
        image = cls.from_frame("live", frame, convert, converter.unit)
        return replace(image, saturation_dn=frame.saturation_dn, taken=(frame.exposure_s, frame.gain_db))

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.values.shape[1], self.values.shape[0]

    @cached_property
    def luminance(self) -> LuminanceMap:
        """Luminance of all pixels, in `unit`."""
        return self.light if isinstance(self.light, LuminanceMap) else self.light(WHOLE)

    @property
    def step(self) -> int:
        """Pixels of the image, along each side, for one of the map."""
        if isinstance(self.light, LuminanceMap):
            return self.light.step
        return 1 if self.colour_filter is None else 2

    @cached_property
    def display(self) -> NDArray[Any]:
        """Displayed values, shape (height, width), half of it for a Bayer frame: one pixel for four."""
        if self.colour_filter is None:
            return self.values
        height, width = (length // 2 * 2 for length in self.values.shape)
        return block_means(self.values[:height, :width], 2)

    @cached_property
    def light_display(self) -> NDArray[np.float32]:
        """Displayed luminance, shape of the map: infinite where saturated, minus infinity where negative."""
        light = np.array(self.luminance.luminance_cd_m2, dtype=np.float32)
        light[light < 0] = -np.inf
        light[self.saturated if self.step == 1 else self._saturated_light] = np.inf
        return light

    def light_at(
        self, rows: NDArray[np.integer[Any]], columns: NDArray[np.integer[Any]]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.uint8]]:
        """Return the luminance of pixels of the map, its expanded uncertainty U (95 %), nan if unknown, and flags.

        That of saturated pixels is a bound, without U.
        """
        top, left = int(rows.min()), int(columns.min())
        window = slice(top, int(rows.max()) + 1), slice(left, int(columns.max()) + 1)
        part, inside = self._map_part(window)
        at = rows - top, columns - left

        def of(values: Any) -> NDArray[np.float64]:
            return np.asarray(np.broadcast_to(values, part.shape)[inside][at], dtype=np.float64)

        value, flags = of(part.luminance_cd_m2), part.invalid[inside][at]
        if self.unit != "cd/m^2":
            return value, np.full(value.shape, np.nan), flags
        relative = [of(u_rel) for u_rel in (part.random_rel, part.common_rel, part.slow_rel)]
        with np.errstate(invalid="ignore"):
            u = np.sqrt(np.square(value) * sum(map(np.square, relative)) + np.square(of(part.slow_cd_m2)))
        known = (u > 0) & (flags & np.uint8(Invalid.SATURATED) == 0)
        return value, np.where(known, Z_95 * u, np.nan), flags

    def pixels(self, roi: Roi) -> RegionPixels:
        """Return a region with its luminance; raises InputError as `evaluate_region`."""
        window, mask = self._window_and_mask(roi)
        part, inside = self._map_part(window)
        return RegionPixels.from_part(part, roi, window, mask, inside)

    def light_in(self, roi: Roi) -> NDArray[np.floating[Any]]:
        """Return the luminances of a region, shape (n,); raises InputError as `Roi.select`."""
        window, mask = self._window_and_mask(roi)
        part, inside = self._map_part(window)
        return part.luminance_cd_m2[inside][mask]

    def _window_and_mask(self, roi: Roi) -> tuple[Window, NDArray[np.bool_]]:
        """Return the bounding box of a region in the map, and its mask there."""
        region, (rows, columns) = roi.divided(self.step), self.values.shape
        shape = rows // self.step, columns // self.step
        roi.window((shape[0] * self.step, shape[1] * self.step))  # an error names pixels of the image, not of the map
        return region.window(shape), region.mask(shape)

    def _map_part(self, window: Window) -> tuple[LuminanceMap, Window]:
        """Return a map that has a window of the whole one, and where."""
        return (self.light, window) if isinstance(self.light, LuminanceMap) else (self.light(window), WHOLE)

    @cached_property
    def saturated(self) -> NDArray[np.bool_]:
        """Mask of saturated pixels, shape (height, width)."""
        if self.saturation_dn is not None:
            return np.asarray(np.greater_equal(self.values, self.saturation_dn))
        (height, width), step = self.values.shape, self.step
        flags = self._saturated_light.repeat(step, axis=0).repeat(step, axis=1)[:height, :width]
        # The last row or column of an odd number is in no pixel of the map.
        return np.pad(flags, ((0, height - flags.shape[0]), (0, width - flags.shape[1])))

    @property
    def _saturated_light(self) -> NDArray[np.bool_]:
        """Mask of saturated pixels of the map."""
        return np.asarray(np.not_equal(self.luminance.invalid & np.uint8(Invalid.SATURATED), 0))

    @property
    def unit_text(self) -> str:
        """Unit for display after "mean ..."."""
        return "cd/m²" if self.unit == "cd/m^2" else "relative light"

    def readout(self, x: float, y: float) -> str:
        """Describe a position (x, y) of the image: pixel, DN, luminance, and whether it is valid."""
        column, row = floor(x), floor(y)
        width, height = self.size
        if not (0 <= column < width and 0 <= row < height):
            return ""
        value = self.values[row, column]
        parts = [f"x {column}, y {row}"]
        if self.is_dn:
            parts.append(f"DN {int(value)}{self._colour(row, column)}")
        elif self.unit != "cd/m^2":
            parts.append(f"value {float(value):.6g}")
        at = tuple(min(index, n - n % self.step - 1) // self.step for index, n in ((row, height), (column, width)))
        value, expanded, flags = (values[0] for values in self.light_at(*(np.array([index]) for index in at)))
        light = with_half_width(value, expanded) if isfinite(expanded) else significant(value)
        if flags & Invalid.SATURATED:
            light = bounded(value, ">")
        parts.append(f"{light} cd/m²" if self.unit == "cd/m^2" else f"light {light}")
        parts += [text for reason, text in _REASONS.items() if flags & reason]
        return " · ".join(parts)

    def _colour(self, row: int, column: int) -> str:
        if self.colour_filter is None:
            return ""
        return f" ({filter_name(self.colour_filter)[2 * (row % 2) + column % 2]})"


def is_video(path: Path) -> bool:
    """Whether a path is treated as a video: a folder of images, a session, or a file with a video suffix."""
    from ...files.video.open import VIDEO_SUFFIXES

    return path.is_dir() or path.suffix.lower() in VIDEO_SUFFIXES


def video_image(path: Path, at: Position, converter: Converter) -> PageImage:
    """Convert a frame of a video as in an evaluation.

    Parameters
    ----------
    path : Path
        Video file, folder of numbered images, or recorded session.
    at : Position
        Frame to show; for a time, the first one at or after it.
    converter : Converter
        Conversion from DN to light, with camera settings missing in the video.

    Raises
    ------
    InputError
        If the video cannot be opened, the frame does not exist or is lost, or a required exposure is unknown.
    CalibrationError
        If the calibration is for another camera.
    """
    from ...evaluate.video.evaluate import converter_findings, opened_video

    source, converter = opened_video(path, converter)
    number, frame = _frame(source, at)
    name = printable(f"{path.name or path.resolve().name}, frame {number}")
    findings = unique((*source.findings, *converter_findings(converter, source)))
    return PageImage.from_frame(name, frame, converter.convert(frame), converter.unit, findings)


def _frame(source: VideoSource, at: Position) -> tuple[int, Frame]:
    """Return the selected frame and its number."""
    frame = next(frames_of(source, Selection(at)), None)
    if frame is None:
        n = 1 + max((entry.number for entry in source.entries()), default=-1)
        raise InputError(f"{source.path} has {n} frames, 0 to {n - 1}, and none at {at}: choose another with --frame")
    if frame.pixels is None or frame.fault is not None:
        fault = "" if frame.fault is None else finding_text(frame.fault)
        raise InputError(f"frame {frame.number} of {source.path}: {fault}; choose another with --frame")
    return frame.number, frame.pixels.frame
