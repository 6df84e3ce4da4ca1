"""Scenes that a formula gives: step charts and checkerboards."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from ...core.disk.files import shown
from ...core.errors import InputError
from ..parameters import HIGHEST_CD_M2, Contrast, Luminance, Number, Oversampling, Sized, Whole
from ..point_spread import pixel_means
from .scene import FloatMap, Level, Levelled, Mask, checked_contrasts, darker_first, named_apart
from .spectra import RegionSpectrum, checked_spectra


@dataclass(frozen=True)
class StepChart(Levelled):
    """Upright stripes of equal width, each of one luminance; neighbours are the pairs that are evaluated.

    Parameters
    ----------
    width, height : int
        Size in pixels.
    luminances_cd_m2 : sequence of float
        Luminance of each stripe from left to right in cd/m^2, at least one.
    names : sequence of str
        Name of each stripe; none for ``step 1``, ``step 2``, ...
    contrasts : sequence of (str, str)
        Names of the stripes whose contrasts are evaluated; none for those of neighbours.
    spectra : tuple of RegionSpectrum
        Spectra of stripes that are not those of the chain.

    Raises
    ------
    InputError
        If a value is out of its range, there are more stripes than columns, names are not one a stripe and different,
        or a contrast names none.

    Examples
    --------
    >>> from labcdp.chain import StepChart
    >>> chart = StepChart(90, 30, luminances_cd_m2=(1.0, 10.0, 100.0))
    >>> [level.luminance_cd_m2 for level in chart.levels()]
    [1.0, 10.0, 100.0]
    """

    luminances_cd_m2: tuple[float, ...]
    names: tuple[str, ...] = ()
    contrasts: tuple[tuple[str, str], ...] = ()
    spectra: tuple[RegionSpectrum, ...] = field(default=(), metadata={"table": RegionSpectrum})

    def __post_init__(self) -> None:
        super().__post_init__()
        given: Any = self.luminances_cd_m2
        given = given.tolist() if isinstance(given, np.ndarray) else given
        if isinstance(given, str) or not isinstance(given, Sequence) or not 1 <= len(given) <= self.width:
            raise InputError(
                f"luminances_cd_m2 is {shown(given)}: give a list of 1 to {self.width} luminances, one a stripe",
                key="luminances_cd_m2",
            )
        for luminance in given:
            Number("cd/m²", 0, HIGHEST_CD_M2).check("luminances_cd_m2", luminance)
        object.__setattr__(self, "luminances_cd_m2", tuple(float(luminance) for luminance in given))
        if not isinstance(self.names, list | tuple) or len(self.names) not in (0, len(given)):
            raise InputError(
                f"names is {shown(self.names)}: give a list of {len(given)} names, one a stripe", key="names"
            )
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "contrasts", checked_contrasts(self.contrasts, self._names))
        object.__setattr__(self, "spectra", checked_spectra(self.spectra, self._names))

    def layout(self) -> tuple[Mapping[str, float], NDArray[np.intp]]:
        """Return each stripe by its name."""
        count = len(self.luminances_cd_m2)
        stripe_of_column = np.arange(self.width) * count // self.width
        return dict(zip(self._names, self.luminances_cd_m2, strict=True)), stripe_of_column[None, :]

    @property
    def _names(self) -> list[str]:
        return named_apart(self.names or [""] * len(self.luminances_cd_m2), "step")

    def pairs(self) -> Sequence[tuple[str, str]]:
        """Return the chosen pairs, or each stripe with its right neighbour where their luminances differ."""
        if self.contrasts:
            return darker_first(self.contrasts, self.layout()[0], bool(self.spectra))
        ordered = [sorted(pair, key=lambda step: step[1]) for pair in pairwise(self.layout()[0].items())]
        return tuple((dark[0], bright[0]) for dark, bright in ordered if dark[1] < bright[1])


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
    spectra : tuple of RegionSpectrum
        Spectra of ``dark`` and ``bright`` squares that are not those of the chain.

    Raises
    ------
    InputError
        If a value is out of its range, or the scene is too small for a bright square.

    Examples
    --------
    >>> from labcdp.chain import Checkerboard
    >>> scene = Checkerboard(64, 48, luminance_cd_m2=10.0, contrast=0.5, square_px=16)
    >>> scene.bright_cd_m2, scene.luminance_map().shape
    (15.0, (48, 64))
    """

    luminance_cd_m2: Luminance
    contrast: Annotated[float, Contrast("(a fraction; 1.0 is 100 %)", 0, 99, above=True)]
    square_px: float = 1
    oversampling: Oversampling = 1
    spectra: tuple[RegionSpectrum, ...] = field(default=(), metadata={"table": RegionSpectrum})

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "spectra", checked_spectra(self.spectra, ["dark", "bright"]))
        number = Whole if self.oversampling == 1 else Number
        number("pixels", 1 / self.oversampling).check("square_px", self.square_px)
        if abs(self.square_px * self.oversampling - self._square_samples) > 1e-6:
            raise InputError(
                f"square_px is {self.square_px:g}: give a multiple of 1/{self.oversampling} pixels, the sampling",
                key="square_px",
            )
        if self.bright_cd_m2 > HIGHEST_CD_M2:
            raise InputError(
                f"contrast is {self.contrast}: the bright squares would have {self.bright_cd_m2:g} cd/m², give at "
                f"most {HIGHEST_CD_M2:g}",
                key="contrast",
            )
        if max(self.width, self.height) <= self.square_px:
            raise InputError(
                f"square_px is {self.square_px}, and a scene of {self.width} x {self.height} pixels then is one "
                "square: give smaller squares",
                key="square_px",
            )

    @property
    def bright_cd_m2(self) -> float:
        """Luminance of the bright squares in cd/m²."""
        return self.luminance_cd_m2 * (1 + self.contrast)

    def luminance_map(self) -> FloatMap:
        """Luminance of each sample in cd/m², shape (height * oversampling, width * oversampling)."""
        dark, bright = np.float32(self.luminance_cd_m2), np.float32(self.bright_cd_m2)
        return np.where(self.is_bright(), bright, dark)

    def regions(self) -> Mapping[str, Mask]:
        """Return all dark squares as ``dark`` and all bright ones as ``bright``; a pixel is what most of it is."""
        share = pixel_means(self.is_bright().astype(np.float32), self.oversampling)
        return {"dark": share < 0.5, "bright": share > 0.5}

    def levels(self) -> Sequence[Level]:
        """Return the level of the dark and that of the bright squares."""
        # A sample is bright where one of row and column is odd.
        rows, columns = self._odd()
        odd_rows, odd_columns = int(rows.sum()), int(columns.sum())
        bright = odd_rows * (columns.size - odd_columns) + odd_columns * (rows.size - odd_rows)
        share = bright / (columns.size * rows.size)
        return Level("dark", self.luminance_cd_m2, 1 - share), Level("bright", self.bright_cd_m2, share)

    def pairs(self) -> Sequence[tuple[str, str]]:
        """Return the pair of dark and bright squares; empty if they do not differ."""
        samples = (np.arange(size * self.oversampling) // self._square_samples % 2 for size in self.shape)
        rows, columns = (axis.reshape(-1, self.oversampling).mean(axis=1) - 0.5 for axis in samples)
        # A pixel is bright where odd squares have most of its rows or most of its columns, and not of both.
        darkness = np.outer((rows.min(), rows.max()), (columns.min(), columns.max()))
        return (("dark", "bright"),) if self.luminance_cd_m2 > 0 and darkness.min() < 0 < darkness.max() else ()

    def is_bright(self) -> Mask:
        """Which samples are bright, shape (height * oversampling, width * oversampling)."""
        rows, columns = self._odd()
        return (rows[:, None] ^ columns).astype(bool)

    @property
    def _square_samples(self) -> int:
        return round(self.square_px * self.oversampling)

    def _odd(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return 1 for the rows, and the columns, of samples that lie in every second row or column of squares."""
        height, width = (np.arange(size * self.oversampling) // self._square_samples % 2 for size in self.shape)
        return height, width
