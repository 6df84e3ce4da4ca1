"""The image that regions are drawn on: DN, luminance and display."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import floor
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.finding import Finding, unique
from ...core.luminance import Invalid, LuminanceMap
from ...report.digits import significant
from .shape_edit import ImageSize

if TYPE_CHECKING:
    from ...core.frame import Frame
    from ...evaluate.picture.light.picture import PictureConversion
    from ...files.picture.picture import Picture

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
    luminance : LuminanceMap
        Luminance, in `unit`.
    unit : str
        ``cd/m^2``, or ``relative`` for an uncalibrated camera.
    findings : tuple of Finding
        Findings of the conversion.
    """

    name: str
    values: NDArray[Any]
    is_dn: bool
    colour_filter: str | None
    luminance: LuminanceMap
    unit: str
    findings: tuple[Finding, ...] = ()

    @classmethod
    def of(cls, picture: Picture, conversion: PictureConversion) -> PageImage:
        """Convert a picture; raises CalibrationError and InputError as the conversion does."""
        frame = picture.frame
        values = picture.light if frame is None else frame.dn
        assert values is not None, "a picture has a frame or light"
        return cls(
            name=picture.path.name,
            values=values,
            is_dn=frame is not None,
            colour_filter=None if frame is None else frame.colour_filter,
            luminance=conversion.luminance(picture),
            unit=conversion.unit_of(picture),
            findings=unique(conversion.findings(picture)),
        )

    @classmethod
    def of_frame(cls, name: str, frame: Frame, conversion: PictureConversion) -> PageImage:
        """Convert a frame; raises CalibrationError if it is not of the calibrated camera, setting or size."""
        return cls(name, frame.dn, True, frame.colour_filter, conversion.convert(frame), conversion.unit)

    @property
    def size(self) -> ImageSize:
        """Width and height in pixels."""
        return self.values.shape[1], self.values.shape[0]

    @cached_property
    def display(self) -> NDArray[Any]:
        """Displayed values, shape (height, width), half of it for a Bayer frame: one pixel for four."""
        if self.colour_filter is None:
            return self.values
        height, width = (length // 2 * 2 for length in self.values.shape)
        blocks = self.values[:height, :width].reshape(height // 2, 2, width // 2, 2)
        mean: NDArray[np.float32] = blocks.mean(axis=(1, 3), dtype=np.float32)
        return mean

    @cached_property
    def saturated(self) -> NDArray[np.bool_]:
        """Mask of saturated pixels, shape (height, width)."""
        flags: NDArray[np.bool_] = np.not_equal(self.luminance.invalid & np.uint8(Invalid.SATURATED), 0)
        step = self.luminance.step
        if step == 1:
            return flags
        full: NDArray[np.bool_] = np.zeros(self.values.shape, dtype=np.bool_)
        repeated = flags.repeat(step, axis=0).repeat(step, axis=1)[: full.shape[0], : full.shape[1]]
        full[: repeated.shape[0], : repeated.shape[1]] = repeated
        return full

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
        at = tuple(
            min(place // self.luminance.step, n - 1)
            for place, n in zip((row, column), self.luminance.shape, strict=True)
        )
        light = significant(float(self.luminance.luminance_cd_m2[at]))
        parts.append(f"{light} cd/m²" if self.unit == "cd/m^2" else f"light {light}")
        flags = int(self.luminance.invalid[at])
        parts += [text for reason, text in _REASONS.items() if flags & reason]
        return " · ".join(parts)

    def _colour(self, row: int, column: int) -> str:
        if self.colour_filter is None:
            return ""
        first = self.colour_filter
        second = {"RG": "GB", "GB": "RG", "GR": "BG", "BG": "GR"}[first]
        return f" ({(first, second)[row % 2][column % 2]})"
