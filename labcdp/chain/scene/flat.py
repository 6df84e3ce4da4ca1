"""Scenes: what is in front of the camera, as a map of luminance with named uniform regions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from ...core.disk.quoting import shown
from ...core.errors import InputError
from ..parameters import LARGEST_SIDE, check_number, check_whole
from .patches import HIGHEST_CD_M2, FloatMap, Patch, with_patches

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Level:
    """One of the luminances a scene consists of.

    Parameters
    ----------
    name : str
        Name of its region.
    luminance_cd_m2 : float
        Luminance in cd/m^2.
    share : float
        Share of the scene's area.
    """

    name: str
    luminance_cd_m2: float
    share: float


@runtime_checkable
class Scene(Protocol):
    """Protocol of scenes: frozen dataclasses of their parameters with a size and these methods.

    A scene sampled finer than the pixels has an attribute `oversampling`, the samples on each side of a pixel, and its
    luminance map as many times the size.
    """

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""

    def luminance_map(self) -> FloatMap:
        """Luminance in cd/m^2, shape (height, width)."""

    def regions(self) -> Mapping[str, Mask]:
        """Regions to be evaluated by name, masks of shape (height, width); may be empty."""

    def levels(self) -> Sequence[Level]:
        """All luminances of the scene with their share of its area; empty if they are not a few.

        A level of a region has the region's name.
        """

    def pairs(self) -> Sequence[tuple[str, str]]:
        """Names of the regions whose contrast is evaluated, the darker one first."""


@dataclass(frozen=True)
class Sized:
    """A scene of a size.

    Parameters
    ----------
    width, height : int
        Size in pixels.

    Raises
    ------
    InputError
        If the size is not two whole numbers of pixels.
    """

    width: int
    height: int

    def __post_init__(self) -> None:
        check_whole("width", self.width, "pixels", 1, LARGEST_SIDE)
        check_whole("height", self.height, "pixels", 1, LARGEST_SIDE)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""
        return self.height, self.width


@dataclass(frozen=True)
class Flat(Sized):
    """A field of one luminance.

    Parameters
    ----------
    width, height : int
        Size in pixels.
    luminance_cd_m2 : float
        Luminance in cd/m^2.

    Raises
    ------
    InputError
        If a value is out of its range.
    """

    luminance_cd_m2: float

    def __post_init__(self) -> None:
        super().__post_init__()
        check_number("luminance_cd_m2", self.luminance_cd_m2, "cd/m^2", 0, HIGHEST_CD_M2)

    def luminance_map(self) -> FloatMap:
        """Luminance in cd/m^2, shape (height, width)."""
        return np.full(self.shape, self.luminance_cd_m2, np.float32)

    def regions(self) -> Mapping[str, Mask]:
        """Return the whole field as ``field``."""
        return {"field": np.ones(self.shape, bool)}

    def levels(self) -> Sequence[Level]:
        """Return the one level."""
        return (Level("field", self.luminance_cd_m2, 1.0),)

    def pairs(self) -> Sequence[tuple[str, str]]:
        """Return nothing: one luminance has no contrast."""
        return ()


@dataclass(frozen=True)
class StepChart(Sized):
    """Upright stripes of equal width, each of one luminance; neighbours are the pairs that are evaluated.

    Parameters
    ----------
    width, height : int
        Size in pixels.
    luminances_cd_m2 : sequence of float
        Luminance of each stripe from left to right in cd/m^2, at least one.

    Raises
    ------
    InputError
        If a value is out of its range, or there are more stripes than columns.
    """

    luminances_cd_m2: tuple[float, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        given: Any = self.luminances_cd_m2
        given = given.tolist() if isinstance(given, np.ndarray) else given
        if isinstance(given, str) or not isinstance(given, Sequence) or not 1 <= len(given) <= self.width:
            raise InputError(
                f"luminances_cd_m2 is {shown(given)}: give a list of 1 to {self.width} luminances, one a stripe"
            )
        for luminance in given:
            check_number("luminances_cd_m2", luminance, "cd/m^2", 0, HIGHEST_CD_M2)
        object.__setattr__(self, "luminances_cd_m2", tuple(float(luminance) for luminance in given))

    def luminance_map(self) -> FloatMap:
        """Luminance in cd/m^2, shape (height, width)."""
        stripes = np.array(self.luminances_cd_m2, np.float32)
        return np.broadcast_to(stripes[self._stripe_of_column()], self.shape).copy()

    def regions(self) -> Mapping[str, Mask]:
        """Return each stripe as ``step 1``, ``step 2``, ..."""
        stripe = self._stripe_of_column()
        return {name: np.broadcast_to(stripe == index, self.shape).copy() for index, name in enumerate(self._names())}

    def levels(self) -> Sequence[Level]:
        """Return the level of each stripe."""
        columns = np.bincount(self._stripe_of_column(), minlength=len(self.luminances_cd_m2))
        rows = zip(self._names(), self.luminances_cd_m2, columns, strict=True)
        return tuple(Level(name, luminance, float(count) / self.width) for name, luminance, count in rows)

    def pairs(self) -> Sequence[tuple[str, str]]:
        """Return each stripe with its right neighbour where their luminances differ."""
        steps = list(zip(self._names(), self.luminances_cd_m2, strict=True))
        ordered = [sorted(pair, key=lambda step: step[1]) for pair in pairwise(steps)]
        return tuple((dark[0], bright[0]) for dark, bright in ordered if dark[1] < bright[1])

    def _names(self) -> list[str]:
        return [f"step {number}" for number in range(1, len(self.luminances_cd_m2) + 1)]

    def _stripe_of_column(self) -> NDArray[np.int64]:
        return np.arange(self.width) * len(self.luminances_cd_m2) // self.width


@dataclass(frozen=True)
class PatchScene(Sized):
    """A target of rectangular patches on a uniform background.

    Parameters
    ----------
    width, height : int
        Size in pixels.
    background_cd_m2 : float
        Luminance of the background in cd/m^2.
    patches : tuple of Patch
        The rectangles; a later one covers an earlier one.

    Raises
    ------
    InputError
        If a value is out of its range or a patch does not lie inside the scene.
    """

    background_cd_m2: float
    patches: tuple[Patch, ...] = field(default=(), metadata={"table": Patch})

    def __post_init__(self) -> None:
        super().__post_init__()
        check_number("background_cd_m2", self.background_cd_m2, "cd/m^2", 0, HIGHEST_CD_M2)
        for patch in self.patches:
            patch.check_inside(self.width, self.height)

    def luminance_map(self) -> FloatMap:
        """Luminance in cd/m^2, shape (height, width)."""
        return with_patches(np.full(self.shape, self.background_cd_m2, np.float32), self.patches)

    def regions(self) -> Mapping[str, Mask]:
        """Return what is seen of the background and of each patch, as ``background``, ``patch 1``, ``patch 2``, ..."""
        owner = np.zeros(self.shape, np.int32)
        for number, patch in enumerate(self.patches, 1):
            owner[patch.rows, patch.columns] = number
        seen = {number: owner == number for number in range(len(self.patches) + 1)}
        return {self._name(number): mask for number, mask in seen.items() if mask.any()}

    def levels(self) -> Sequence[Level]:
        """Return the level of each region."""
        luminances = (self.background_cd_m2, *(patch.luminance_cd_m2 for patch in self.patches))
        levels = {self._name(number): luminance for number, luminance in enumerate(luminances)}
        return tuple(Level(name, levels[name], float(mask.mean())) for name, mask in self.regions().items())

    def pairs(self) -> Sequence[tuple[str, str]]:
        """Return each region with the next brighter one, patches only if two or more are seen."""
        levels = self.levels()
        patches = [level for level in levels if level.name != "background"]
        neighbours = pairwise(sorted(patches if len(patches) > 1 else levels, key=lambda level: level.luminance_cd_m2))
        return tuple((a.name, b.name) for a, b in neighbours if a.luminance_cd_m2 < b.luminance_cd_m2)

    def _name(self, number: int) -> str:
        return f"patch {number}" if number else "background"
