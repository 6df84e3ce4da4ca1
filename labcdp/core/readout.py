"""Which part of the sensor a frame shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar


@dataclass(frozen=True)
class Readout:
    """Part of the sensor that a frame shows, in pixels of the frame, and how it was read out.

    Two are equal if the pixel at the same row and column of their frames is the same of the sensor.

    Parameters
    ----------
    x, y : float
        First column and row (SFNC OffsetX, OffsetY); colour planes of an odd offset have half pixels.
    binning, decimation : (int, int)
        Columns and rows that became one pixel.
    mirrored : (bool, bool)
        Whether columns and rows are in reverse order (SFNC ReverseX, ReverseY).
    sensor_size : (float, float) or None
        Width and height of the largest region (SFNC WidthMax, HeightMax); None if unknown.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    x: float = 0
    y: float = 0
    binning: tuple[int, int] = (1, 1)
    decimation: tuple[int, int] = (1, 1)
    mirrored: tuple[bool, bool] = (False, False)
    sensor_size: tuple[float, float] | None = field(default=None, compare=False)

    def __str__(self) -> str:
        pairs = (("binning", self.binning), ("decimation", self.decimation))
        extra = [f"{name} {across} x {down}" for name, (across, down) in pairs if (across, down) != (1, 1)]
        extra += [f"{axis} mirrored" for axis, turned in zip(("columns", "rows"), self.mirrored, strict=True) if turned]
        return ", ".join([f"from column {self.x:g} and row {self.y:g}", *extra])

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Readout:
        """Make it of the values of its fields; JSON has lists where they are tuples."""
        known: dict[str, Any] = {k: tuple(value) if isinstance(value, list) else value for k, value in values.items()}
        return cls(**known)

    @property
    def of_planes(self) -> Readout:
        """That of the colour planes of a Bayer frame, in their pixels."""
        size = self.sensor_size and (self.sensor_size[0] / 2, self.sensor_size[1] / 2)
        return Readout(self.x / 2, self.y / 2, self.binning, self.decimation, self.mirrored, size)

    @property
    def of_bayer(self) -> Readout:
        """That of the Bayer frame whose planes have this one."""
        size = self.sensor_size and (self.sensor_size[0] * 2, self.sensor_size[1] * 2)
        return Readout(self.x * 2, self.y * 2, self.binning, self.decimation, self.mirrored, size)

    def axis_px(self, shape: tuple[int, int]) -> tuple[float, float] | None:
        """Middle of the sensor, (x, y) in pixels of a frame of `shape`; None if it is that of the frame, or unknown."""
        if self.sensor_size is None:
            return None
        x, y = self.sensor_size[0] / 2 - self.x, self.sensor_size[1] / 2 - self.y
        return None if (y, x) == (shape[0] / 2, shape[1] / 2) else (x, y)

    def window_in(
        self, shape: tuple[int, int], whole: Readout, whole_shape: tuple[int, int]
    ) -> tuple[slice, slice] | None:
        """Return where a frame of `shape` lies in a larger one; None if it is no part of it, or read out otherwise."""
        row, column = self.y - whole.y, self.x - whole.x
        inside = 0 <= row <= whole_shape[0] - shape[0] and 0 <= column <= whole_shape[1] - shape[1]
        # Cameras differ in whether the offset is that before or after mirroring.
        turned = any((*self.mirrored, *whole.mirrored))
        alike = (self.binning, self.decimation) == (whole.binning, whole.decimation) and not turned
        if not (inside and alike and row == int(row) and column == int(column)):
            return None
        return slice(int(row), int(row) + shape[0]), slice(int(column), int(column) + shape[1])
