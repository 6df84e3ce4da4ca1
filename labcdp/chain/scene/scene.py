"""Scenes as maps of luminance in front of the camera, and patches laid over them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Annotated, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.disk.files import shown
from ...core.errors import InputError
from ..parameters import HIGHEST_CD_M2, Luminance, Parameters, Sized, Whole
from .spectra import RegionSpectrum, checked_spectra

FloatMap = NDArray[np.float32]
Mask = NDArray[np.bool_]


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

    Examples
    --------
    >>> from labcdp.chain import luminance_map
    >>> luminance_map([[1, 2], [3, 4]]).dtype
    dtype('float32')
    """
    with np.errstate(over="ignore"):
        scene = np.asarray(luminance_cd_m2, dtype=np.float32)
    if scene.ndim != 2 or scene.size == 0:
        raise InputError(f"a scene is a non-empty 2-D map of luminance in cd/m², got the shape {scene.shape}")
    # A NaN makes the minimum NaN, which is not >= 0.
    if not (scene.min() >= 0 and scene.max() <= HIGHEST_CD_M2):
        raise InputError(
            f"a scene has luminance from {scene.min():g} to {scene.max():g} cd/m²: give numbers from 0 to "
            f"{HIGHEST_CD_M2:g}"
        )
    return scene


@dataclass(frozen=True)
class Patch(Parameters):
    """A rectangle of one luminance.

    Parameters
    ----------
    x, y : int
        Column and row of its upper left pixel.
    width, height : int
        Size in pixels.
    luminance_cd_m2 : float
        Luminance in cd/m^2.
    name : str
        Its name; empty for ``patch 1``, ``patch 2``, ... by its place among the patches.

    Raises
    ------
    InputError
        If a value is out of its range.

    Examples
    --------
    >>> from labcdp.chain import Patch, PatchScene
    >>> scene = PatchScene(40, 30, 1.0, (Patch(0, 0, 10, 10, 5.0, name="lamp"),))
    >>> float(scene.luminance_map().max())
    5.0
    """

    x: Annotated[int, Whole("pixels", 0)]
    y: Annotated[int, Whole("pixels", 0)]
    width: Annotated[int, Whole("pixels", 1)]
    height: Annotated[int, Whole("pixels", 1)]
    luminance_cd_m2: Luminance
    name: str = ""

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

    Examples
    --------
    >>> from labcdp.chain import Patch, with_patches
    >>> luminance = with_patches([[1.0] * 4] * 3, [Patch(0, 0, 2, 1, 9.0)])
    >>> luminance[0].tolist()
    [9.0, 9.0, 1.0, 1.0]
    """
    scene = luminance_map(background_cd_m2).copy()
    height, width = scene.shape
    for patch in patches:
        patch.check_inside(width, height)
        scene[patch.rows, patch.columns] = patch.luminance_cd_m2
    return scene


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

    Examples
    --------
    >>> from labcdp.chain import Flat
    >>> Flat(64, 48, luminance_cd_m2=10.0).levels()[0].luminance_cd_m2
    10.0
    """

    name: str
    luminance_cd_m2: float
    share: float


@runtime_checkable
class Scene(Protocol):
    """Protocol of scenes: frozen dataclasses of their parameters with a size and these methods.

    A scene sampled finer than the pixels has an attribute `oversampling`, the samples on each side of a pixel, and its
    luminance map as many times the size.

    Examples
    --------
    >>> from labcdp.chain import Flat, Scene
    >>> isinstance(Flat(64, 48, luminance_cd_m2=10.0), Scene)
    True
    """

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""

    def luminance_map(self) -> FloatMap:
        """Luminance in cd/m², shape (height, width)."""

    def regions(self) -> Mapping[str, Mask]:
        """Regions to be evaluated by name, masks of shape (height, width); may be empty."""

    def levels(self) -> Sequence[Level]:
        """All luminances of the scene with their share of its area; empty if they are not a few.

        A level of a region has the region's name.
        """

    def pairs(self) -> Sequence[tuple[str, str]]:
        """Names of the regions whose contrast is evaluated, the darker one first."""


def named_apart(names: Sequence[object], what: str, first: int = 1) -> list[str]:
    """Return names, of empty ones those by their numbers; raises InputError if one is no text or two are equal."""
    for name in names:
        if not isinstance(name, str):
            raise InputError(f"the name of a {what} is {shown(name)}: give a text")
    unique = [str(name) or f"{what} {number}" for number, name in enumerate(names, first)]
    twice = next((name for name in unique if unique.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"{twice!r} names two regions of the scene: give each {what} a name of its own")
    return unique


def checked_contrasts(contrasts: object, names: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """Return pairs of names, each once; raises InputError if they are none, or name no region."""
    if not isinstance(contrasts, list | tuple):
        raise InputError(f"contrasts is {shown(contrasts)}: give a list of pairs of names", key="contrasts")
    pairs: dict[tuple[str, str], None] = {}
    for pair in contrasts:
        if not isinstance(pair, list | tuple) or len(pair) != 2 or pair[0] == pair[1]:
            raise InputError(
                f"contrasts has {shown(pair)}: give two different names, for example ['P1', 'P2']", key="contrasts"
            )
        for name in pair:
            if name not in names:
                raise InputError(f"contrasts names {shown(name)}: choose from {', '.join(names)}", key="contrasts")
        pairs[str(pair[0]), str(pair[1])] = None
    return tuple(pairs)


def darker_first(
    pairs: Iterable[tuple[str, str]], luminances: Mapping[str, float], coloured: bool = False
) -> tuple[tuple[str, str], ...]:
    """Return the pairs that are seen and have a contrast, or may have one by colour, the darker region first."""
    seen = [pair for pair in pairs if all(name in luminances for name in pair)]
    ordered = [sorted(pair, key=lambda name: luminances[name]) for pair in seen]
    return tuple((dark, bright) for dark, bright in ordered if coloured or luminances[dark] < luminances[bright])


class Levelled(Sized):
    """A scene of regions of one luminance each."""

    def layout(self) -> tuple[Mapping[str, float], NDArray[np.intp]]:
        """Return names and luminances of the regions, and which of them each pixel is of, for all rows or columns."""
        raise NotImplementedError

    def luminance_map(self) -> FloatMap:
        """Luminance in cd/m², shape (height, width)."""
        luminances, owner = self.layout()
        return np.broadcast_to(np.array(list(luminances.values()), np.float32)[owner], self.shape).copy()

    def regions(self) -> Mapping[str, Mask]:
        """Return the regions that are seen."""
        luminances, owner = self.layout()
        masks = {name: owner == number for number, name in enumerate(luminances)}
        return {name: np.broadcast_to(mask, self.shape).copy() for name, mask in masks.items() if mask.any()}

    def levels(self) -> Sequence[Level]:
        """Return the level of each region."""
        luminances, owner = self.layout()
        shares = np.bincount(owner.ravel(), minlength=len(luminances)) / owner.size
        rows = zip(luminances.items(), shares.tolist(), strict=True)
        return tuple(Level(name, luminance, share) for (name, luminance), share in rows if share)


@dataclass(frozen=True)
class Flat(Levelled):
    """A field of one luminance.

    Parameters
    ----------
    width, height : int
        Size in pixels.
    luminance_cd_m2 : float
        Luminance in cd/m^2.
    spectra : tuple of RegionSpectrum
        Spectrum of ``field``, if it is not that of the chain.

    Raises
    ------
    InputError
        If a value is out of its range.

    Examples
    --------
    >>> from labcdp.chain import Flat
    >>> float(Flat(64, 48, luminance_cd_m2=10.0).luminance_map().mean())
    10.0
    """

    luminance_cd_m2: Luminance
    spectra: tuple[RegionSpectrum, ...] = field(default=(), metadata={"table": RegionSpectrum})

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "spectra", checked_spectra(self.spectra, ["field"]))

    def layout(self) -> tuple[Mapping[str, float], NDArray[np.intp]]:
        """Return the whole as ``field``."""
        return {"field": self.luminance_cd_m2}, np.zeros((1, 1), np.intp)

    def pairs(self) -> Sequence[tuple[str, str]]:
        """Return nothing: one luminance has no contrast."""
        return ()


@dataclass(frozen=True)
class PatchScene(Levelled):
    """A target of rectangular patches on a uniform background.

    Parameters
    ----------
    width, height : int
        Size in pixels.
    background_cd_m2 : float
        Luminance of the background in cd/m^2.
    patches : tuple of Patch
        The rectangles; a later one covers an earlier one.
    contrasts : sequence of (str, str)
        Names of the patches whose contrasts are evaluated; none for those of neighbouring luminances.
    spectra : tuple of RegionSpectrum
        Spectra of regions, by their names, that are not those of the chain.

    Raises
    ------
    InputError
        If a value is out of its range, a patch does not lie inside the scene, two have one name, or a contrast names
        none.

    Examples
    --------
    >>> from labcdp.chain import Patch, PatchScene
    >>> scene = PatchScene(40, 30, 1.0, (Patch(0, 0, 10, 10, 5.0, "a"), Patch(20, 0, 10, 10, 2.0, "b")), (("a", "b"),))
    >>> scene.pairs()
    (('b', 'a'),)
    """

    background_cd_m2: Luminance
    patches: tuple[Patch, ...] = field(default=(), metadata={"table": Patch})
    contrasts: tuple[tuple[str, str], ...] = ()
    spectra: tuple[RegionSpectrum, ...] = field(default=(), metadata={"table": RegionSpectrum})

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.patches, list | tuple) or not all(isinstance(patch, Patch) for patch in self.patches):
            raise InputError(f"patches is {shown(self.patches)}: give a list of labcdp.chain.Patch", key="patches")
        object.__setattr__(self, "patches", tuple(self.patches))
        for patch in self.patches:
            patch.check_inside(self.width, self.height)
        names = named_apart(["background", *(patch.name for patch in self.patches)], "patch", 0)
        object.__setattr__(self, "contrasts", checked_contrasts(self.contrasts, names))
        object.__setattr__(self, "spectra", checked_spectra(self.spectra, names))

    def layout(self) -> tuple[Mapping[str, float], NDArray[np.intp]]:
        """Return what is seen of the background, as ``background``, and of each patch by its name."""
        owner, luminances = np.zeros(self.shape, np.intp), {"background": self.background_cd_m2}
        for number, patch in enumerate(self.patches, 1):
            owner[patch.rows, patch.columns] = number
            luminances[patch.name or f"patch {number}"] = patch.luminance_cd_m2
        return luminances, owner

    def pairs(self) -> Sequence[tuple[str, str]]:
        """Return the chosen pairs, or each region with the next brighter one, patches only if two or more are seen."""
        levels = self.levels()
        if self.contrasts:
            luminances = {level.name: level.luminance_cd_m2 for level in levels}
            return darker_first(self.contrasts, luminances, bool(self.spectra))
        patches = [level for level in levels if level.name != "background"]
        neighbours = pairwise(sorted(patches if len(patches) > 1 else levels, key=lambda level: level.luminance_cd_m2))
        return tuple((a.name, b.name) for a, b in neighbours if a.luminance_cd_m2 < b.luminance_cd_m2)
