"""A checkerboard, of squares of any number of samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.errors import InputError
from ..parameters import check_number, check_whole
from ..point_spread import pixel_means
from .flat import Level, Mask, Sized
from .patches import HIGHEST_CD_M2, FloatMap


@dataclass(frozen=True)
class Checkerboard(Sized):
    """Dark and bright squares; the upper left one is dark. With squares of one pixel, the scene of the 2018 thesis.

    Parameters
    ----------
    width, height : int
        Size in pixels.
    luminance_cd_m2 : float
        Luminance of the dark squares in cd/m^2.
    contrast : float
        Weber contrast K, above 0 (1.0 is 100 %); the bright squares have (1 + K) times the dark luminance.
    square_px : int or float
        Side of a square in pixels: whole samples, so a whole number without oversampling.
    oversampling : int
        Samples on each side of a pixel, 1 to 64.

    Raises
    ------
    InputError
        If a value is out of its range, or the scene is too small for a bright square.
    """

    luminance_cd_m2: float
    contrast: float
    square_px: float = 1
    oversampling: int = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        check_whole("oversampling", self.oversampling, "samples", 1, 64)
        check_number("luminance_cd_m2", self.luminance_cd_m2, "cd/m^2", 0, HIGHEST_CD_M2)
        check_number("contrast", self.contrast, "(a fraction; 1.0 is 100 %)", 0, 99, above=True)
        if self.oversampling == 1:
            check_whole("square_px", self.square_px, "pixels", 1)
        check_number("square_px", self.square_px, "pixels", 1 / self.oversampling)
        if abs(self.square_px * self.oversampling - self._square_samples) > 1e-6:
            raise InputError(
                f"square_px is {self.square_px:g}: give a multiple of 1/{self.oversampling} pixels, the sampling"
            )
        if self.bright_cd_m2 > HIGHEST_CD_M2:
            raise InputError(
                f"contrast is {self.contrast}: the bright squares would have {self.bright_cd_m2:g} cd/m^2, give at "
                f"most {HIGHEST_CD_M2:g}"
            )
        if max(self.width, self.height) <= self.square_px:
            raise InputError(
                f"square_px is {self.square_px}, and a scene of {self.width} x {self.height} pixels then is one "
                "square: give smaller squares"
            )

    @property
    def bright_cd_m2(self) -> float:
        """Luminance of the bright squares in cd/m^2."""
        return self.luminance_cd_m2 * (1 + self.contrast)

    def luminance_map(self) -> FloatMap:
        """Luminance of each sample in cd/m^2, shape (height * oversampling, width * oversampling)."""
        dark, bright = np.float32(self.luminance_cd_m2), np.float32(self.bright_cd_m2)
        return np.where(self.is_bright(), bright, dark)

    def regions(self) -> Mapping[str, Mask]:
        """Return all dark squares as ``dark`` and all bright ones as ``bright``; a pixel is what most of it is."""
        share = pixel_means(self.is_bright().astype(np.float32), self.oversampling)
        return {"dark": share < 0.5, "bright": share > 0.5}

    def levels(self) -> Sequence[Level]:
        """Return the level of the dark and that of the bright squares."""
        # Samples in odd rows and columns of squares; a square is bright where one of the two is odd.
        height, width = (size * self.oversampling for size in self.shape)
        odd_rows, odd_columns = (self._odd(size) for size in (height, width))
        bright = odd_rows * (width - odd_columns) + odd_columns * (height - odd_rows)
        share = bright / (width * height)
        return Level("dark", self.luminance_cd_m2, 1 - share), Level("bright", self.bright_cd_m2, share)

    def pairs(self) -> Sequence[tuple[str, str]]:
        """Return the one pair; dark signal has none."""
        return (("dark", "bright"),) if self.luminance_cd_m2 > 0 else ()

    def is_bright(self) -> Mask:
        """Which samples are bright, shape (height * oversampling, width * oversampling)."""
        sides = (size * self.oversampling for size in self.shape)
        rows, columns = (np.arange(size) // self._square_samples % 2 for size in sides)
        return (rows[:, None] ^ columns).astype(bool)

    @property
    def _square_samples(self) -> int:
        return round(self.square_px * self.oversampling)

    def _odd(self, size: int) -> int:
        """Return how many samples of a side lie in every second square."""
        square = self._square_samples
        whole, rest = divmod(size, 2 * square)
        return whole * square + max(0, rest - square)
