"""Scenes as maps of luminance in front of the camera, and patches laid over them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.errors import InputError
from ..parameters import check_number, check_whole

FloatMap = NDArray[np.float32]

#: Highest luminance of a scene: well above the sun's 1.6e9 cd/m^2, and low enough that no stage leaves float32.
HIGHEST_CD_M2 = 1e12


def luminance_map(luminance_cd_m2: ArrayLike) -> FloatMap:
    """Return any luminance map as the chain takes it.

    Parameters
    ----------
    luminance_cd_m2 : array_like, shape (height, width)
        Luminance in cd/m^2.

    Returns
    -------
    ndarray of float32, shape (height, width)

    Raises
    ------
    InputError
        If it is not a non-empty 2-D array of numbers from 0 to `HIGHEST_CD_M2`.
    """
    with np.errstate(over="ignore"):
        scene = np.asarray(luminance_cd_m2, dtype=np.float32)
    if scene.ndim != 2 or scene.size == 0:
        raise InputError(f"a scene is a non-empty 2-D map of luminance in cd/m^2, got the shape {scene.shape}")
    # A NaN makes the minimum NaN, which is not >= 0.
    if not (scene.min() >= 0 and scene.max() <= HIGHEST_CD_M2):
        raise InputError(
            f"a scene has luminance from {scene.min():g} to {scene.max():g} cd/m^2: give numbers from 0 to "
            f"{HIGHEST_CD_M2:g}"
        )
    return scene


@dataclass(frozen=True)
class Patch:
    """A rectangle of one luminance.

    Parameters
    ----------
    x, y : int
        Column and row of its upper left pixel.
    width, height : int
        Size in pixels.
    luminance_cd_m2 : float
        Luminance in cd/m^2.

    Raises
    ------
    InputError
        If a value is out of its range.
    """

    x: int
    y: int
    width: int
    height: int
    luminance_cd_m2: float

    def __post_init__(self) -> None:
        for name in ("x", "y"):
            check_whole(name, getattr(self, name), "pixels", 0)
        for name in ("width", "height"):
            check_whole(name, getattr(self, name), "pixels", 1)
        check_number("luminance_cd_m2", self.luminance_cd_m2, "cd/m^2", 0, HIGHEST_CD_M2)

    @property
    def rows(self) -> slice:
        """Its rows."""
        return slice(self.y, self.y + self.height)

    @property
    def columns(self) -> slice:
        """Its columns."""
        return slice(self.x, self.x + self.width)

    def check_inside(self, width: int, height: int) -> None:
        """Refuse a patch that does not lie inside a scene of this size; raises InputError."""
        right, bottom = self.x + self.width, self.y + self.height
        if right > width or bottom > height:
            raise InputError(
                f"a patch spans x {self.x} to {right}, y {self.y} to {bottom}, but the scene is "
                f"{width} x {height} pixels: move it inside"
            )


def with_patches(background_cd_m2: ArrayLike, patches: Iterable[Patch]) -> FloatMap:
    """Lay rectangles over a luminance map; a later patch covers an earlier one.

    Parameters
    ----------
    background_cd_m2 : array_like, shape (height, width)
        Luminance around the patches in cd/m^2.
    patches : iterable of Patch
        The rectangles.

    Returns
    -------
    ndarray of float32, shape (height, width)

    Raises
    ------
    InputError
        If the background is not a scene (see `luminance_map`) or a patch does not lie inside it.
    """
    scene = luminance_map(background_cd_m2).copy()
    height, width = scene.shape
    for patch in patches:
        patch.check_inside(width, height)
        scene[patch.rows, patch.columns] = patch.luminance_cd_m2
    return scene
