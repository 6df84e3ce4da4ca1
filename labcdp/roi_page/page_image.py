"""The image that regions are drawn on: its DN, its luminance, and what it looks like."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import floor
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..luminance import Invalid, LuminanceMap
from ..report.digits import significant
from .shape_edit import ImageSize

if TYPE_CHECKING:
    from ..evaluate.light import PictureConversion
    from ..sources.picture import Picture

#: What is said of a pixel under the pointer that is not valid.
_REASONS = {
    Invalid.SATURATED: "saturated",
    Invalid.BELOW_BLACK: "below the black",
    Invalid.OUTSIDE_CALIBRATED: "outside the calibrated range",
    Invalid.DEFECT: "defect",
    Invalid.INCONSISTENT: "different between the exposures",
}


@dataclass(frozen=True, eq=False)
class PageImage:
    """An image as the page needs it.

    Parameters
    ----------
    name : str
        Name of the file.
    values : ndarray of uint8, uint16 or float32, shape (height, width)
        DN, or the values of a float file.
    is_dn : bool
        Whether they are DN.
    colour_filter : str or None
        Of a Bayer frame.
    luminance : LuminanceMap
        The same light as luminance, in `unit`.
    unit : str
        ``cd/m^2``, or ``relative`` where nothing is known of the camera.
    warnings : tuple of str
        What to mind about the conversion.
    """

    name: str
    values: NDArray[Any]
    is_dn: bool
    colour_filter: str | None
    luminance: LuminanceMap
    unit: str
    warnings: tuple[str, ...] = ()

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
            warnings=tuple(dict.fromkeys((*picture.notes, *conversion.warnings(picture)))),
        )

    @property
    def size(self) -> ImageSize:
        """Width and height in pixels."""
        return self.values.shape[1], self.values.shape[0]

    @cached_property
    def display(self) -> NDArray[Any]:
        """What is shown, shape (height, width) or, of a Bayer frame, half of it: one pixel for four."""
        if self.colour_filter is None:
            return self.values
        height, width = (length // 2 * 2 for length in self.values.shape)
        blocks = self.values[:height, :width].reshape(height // 2, 2, width // 2, 2)
        mean: NDArray[np.float32] = blocks.mean(axis=(1, 3), dtype=np.float32)
        return mean

    @cached_property
    def saturated(self) -> NDArray[np.bool_]:
        """Which pixels are saturated, shape (height, width)."""
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
        """Unit as a person reads it, as the end of "mean ..."."""
        return "cd/m²" if self.unit == "cd/m^2" else "relative light"

    def readout(self, x: float, y: float) -> str:
        """Say what is at a place (x, y) of the image: pixel, DN, luminance, and whether it is valid."""
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
