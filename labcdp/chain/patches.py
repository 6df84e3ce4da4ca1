"""Scene: the luminance in front of the camera, one value in cd/m^2 for each pixel."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from .parameters import check_number, check_whole


def luminance_map(luminance_cd_m2: ArrayLike) -> NDArray[np.float32]:
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
        If it is not a non-empty 2-D array of finite numbers of at least 0.
    """
    scene = np.asarray(luminance_cd_m2, dtype=np.float32)
    if scene.ndim != 2 or scene.size == 0:
        raise InputError(f"a scene is a non-empty 2-D map of luminance in cd/m^2, got the shape {scene.shape}")
    # A NaN makes the minimum NaN, which is not >= 0.
    if not (scene.min() >= 0 and scene.max() < np.inf):
        raise InputError(
            f"a scene has luminance from {scene.min():g} to {scene.max():g} cd/m^2: give finite numbers of at least 0"
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
        check_number("luminance_cd_m2", self.luminance_cd_m2, "cd/m^2", 0)


def with_patches(background_cd_m2: ArrayLike, patches: Iterable[Patch]) -> NDArray[np.float32]:
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
        right, bottom = patch.x + patch.width, patch.y + patch.height
        if right > width or bottom > height:
            raise InputError(
                f"a patch spans x {patch.x} to {right}, y {patch.y} to {bottom}, but the scene is "
                f"{width} x {height} pixels: move it inside"
            )
        scene[patch.y : bottom, patch.x : right] = patch.luminance_cd_m2
    return scene


@dataclass(frozen=True)
class PatchScene:
    """A target of rectangular patches on a uniform background; without patches, a flat field.

    Parameters
    ----------
    width, height : int
        Size in pixels.
    background_cd_m2 : float
        Luminance of the background in cd/m^2.
    patches : tuple of Patch
        The rectangles.

    Raises
    ------
    InputError
        If a value is out of its range.
    """

    width: int
    height: int
    background_cd_m2: float
    patches: tuple[Patch, ...] = ()

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            check_whole(name, getattr(self, name), "pixels", 1)
        check_number("background_cd_m2", self.background_cd_m2, "cd/m^2", 0)

    def luminance_cd_m2(self) -> NDArray[np.float32]:
        """Luminance for each pixel, shape (height, width); raises InputError as `with_patches`."""
        return with_patches(np.full((self.height, self.width), self.background_cd_m2, np.float32), self.patches)
