"""Flare: stray light of a camera beside a source, in cd/m², over the illuminance, and over the source itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import isfinite, log10, nan, pi
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError
from ..core.luminance import WHOLE, Invalid, LuminanceMap
from ..core.quantity import Quantity, as_number
from ..core.roi import Roi
from .arrays import light_array

_Array = NDArray[np.float64]
#: Rings of the radial profile for each factor of 10 of the radius.
_RINGS = 16
#: Least share of a block that lies beside the source.
_LEAST_SHARE = 0.5
#: Share of the brightest light of a source from which a pixel belongs to it.
_OF_SOURCE = 0.5


@dataclass(frozen=True, eq=False)
class StrayLight:
    """Stray light in one unit.

    Parameters
    ----------
    mean, worst : Quantity
        Mean of all pixels beside the source, and of the block with the most.
    profile : Quantity of ndarray, shape (rings,)
        Mean of rings about the source.
    blocks : Quantity of ndarray, shape (rows, columns)
        Mean of each block; nan where more than half of it is source.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp import Roi
    >>> from labcdp.metrics import flare
    >>> stray = flare(np.full((64, 96), 2.0), [Roi.rectangle("lamp", 32, 16, 16, 16)]).light
    >>> stray.mean.value, int(np.isnan(stray.blocks.value).sum())
    (2.0, 1)
    """

    mean: Quantity
    worst: Quantity
    profile: Quantity[_Array]
    blocks: Quantity[_Array]

    def scaled(self, factor: float, u_rel: float, unit: str) -> StrayLight:
        """Return it in another unit: times a factor with a relative standard uncertainty.

        Examples
        --------
        >>> import numpy as np
        >>> from labcdp import Roi
        >>> from labcdp.metrics import flare
        >>> light = np.full((60, 80), 2.0)
        >>> stray = flare(light, [Roi.rectangle("lamp", 30, 20, 10, 10)]).light
        >>> stray.scaled(0.5, 0.01, "").mean.value
        1.0
        """

        def changed(quantity: Quantity[Any]) -> Quantity[Any]:
            value = factor * quantity.value
            return Quantity(value, as_number(np.hypot(factor * quantity.u, u_rel * value)), unit)

        return StrayLight(changed(self.mean), changed(self.worst), changed(self.profile), changed(self.blocks))


@dataclass(frozen=True, eq=False)
class Flare:
    """Flare of a camera.

    Parameters
    ----------
    light : StrayLight
        Stray light in the unit of the picture.
    intensity : StrayLight or None
        pi times the stray luminance over the illuminance at the camera: its share of the luminance that a white
        diffuser in place of the camera would have.
    normalised : StrayLight or None
        Stray light over that of the source itself.
    centre_px : (float, float)
        Middle (x, y) of the source in pixels of the image.
    radius_px : ndarray of float, shape (rings,)
        Mean distance of the pixels of each ring from that.
    block_px : int
        Side of a block in pixels of the image.
    worst_px : (float, float)
        Middle (x, y) of the block with the most stray light.
    over_ring : ndarray of float, shape (rows, columns)
        Light of each block over that of the rings at its pixels; a ghost has much more than 1.
    saturated_share : float
        Share of the pixels beside the source that are saturated, whose light is a bound only.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp import Roi
    >>> from labcdp.metrics import flare
    >>> y, x = np.mgrid[:120, :160]
    >>> light = 5 / (1 + np.hypot(x - 79.5, y - 59.5) ** 2 / 100)
    >>> found = flare(light, [Roi.rectangle("lamp", 70, 50, 20, 20)], block_px=8)
    >>> found.centre_px, bool((np.diff(found.light.profile.value) < 0).all())
    ((80.0, 60.0), True)
    """

    light: StrayLight
    intensity: StrayLight | None
    normalised: StrayLight | None
    centre_px: tuple[float, float]
    radius_px: _Array
    block_px: int
    worst_px: tuple[float, float]
    over_ring: _Array
    saturated_share: float


def flare(
    light: ArrayLike | LuminanceMap,
    source: Sequence[Roi],
    *,
    unit: str = "",
    background: ArrayLike | LuminanceMap | None = None,
    illuminance_lx: Quantity | None = None,
    direct: ArrayLike | LuminanceMap | None = None,
    attenuation: Quantity | None = None,
    block_px: int = 16,
) -> Flare:
    """Measure the stray light that a source makes beside itself.

    Parameters
    ----------
    light : array_like of float, shape (height, width), or LuminanceMap
        Picture with the source, linear; of several exposures merged where they saturate.
    source : sequence of Roi
        Regions of the source, in pixels of the image, which are left out; for a lamp and what is bright about it.
    unit : str
        Unit of the light; `illuminance_lx` needs ``cd/m²``.
    background : array_like or LuminanceMap or None
        The same without the source, which is subtracted; None for none.
    illuminance_lx : Quantity or None
        Illuminance by the source in the plane of the camera's entrance, for `Flare.intensity`.
    direct : array_like or LuminanceMap or None
        The source itself in the same unit, at the same place, for `Flare.normalised`.
    attenuation : Quantity or None
        Factor by which a filter before the direct picture dims: 10 to the power of its optical density; None for none.
    block_px : int
        Side of the blocks of the map, in pixels of the image.

    Returns
    -------
    Flare

    Raises
    ------
    InputError
        If shapes differ, the source holds no pixel or leaves none, or an argument is out of its range.

    Notes
    -----
    Uncertainties: of a mean the noise of its pixels, by the differences of neighbouring ones, and of a map what its
    calibration leaves: the errors that all pixels share, and slow changes across the image. Those that picture and
    background, or picture and direct picture, share cancel as far as they are alike.

    Light of the source is the median of the pixels in its regions from half of the brightest on.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp import Roi
    >>> from labcdp.core.quantity import Quantity
    >>> from labcdp.metrics import flare
    >>> stray = np.full((120, 160), 0.4)  # cd/m²
    >>> lamp = [Roi.rectangle("lamp", 70, 50, 20, 20)]
    >>> found = flare(stray, lamp, unit="cd/m²", illuminance_lx=Quantity(400.0, 8.0))
    >>> round(found.intensity.mean.value, 6), round(np.pi * 0.4 / 400, 6)
    (0.003142, 0.003142)
    """
    picture = _as_map(light, "the picture")
    dark = None if background is None else _as_map(background, "the background", picture.shape)
    places = _Places.of(picture, source, block_px)
    means = [_group_means(picture, group) for group in places.groups]
    if dark is not None:
        means = [part.less(_group_means(dark, group)) for part, group in zip(means, places.groups, strict=True)]
    worst = int(np.nanargmax(np.where(places.block_is_free, means[2].value, -np.inf)))
    stray, normalised = _stray_light(means, places, worst, unit), None
    if direct is not None:
        seen = _source_means(_as_map(direct, "the direct picture", picture.shape), places.source)
        dims = attenuation or Quantity(1.0, 0.0)
        over = [part.over(seen) for part in means]
        normalised = _stray_light(over, places, worst, "").scaled(1 / dims.value, dims.u / dims.value, "")
    intensity = None if illuminance_lx is None else _intensity(stray, illuminance_lx)
    saturated = float(np.mean((picture.invalid[places.usable] & Invalid.SATURATED) > 0))
    step = picture.step
    x_px, y_px = places.block_middle(worst)
    over_ring = stray.blocks.value / places.block_means(_at_radius(places, means[1].value)).reshape(places.block_shape)
    return Flare(
        stray, intensity, normalised, (step * places.centre[0], step * places.centre[1]), step * places.ring_radius,
        step * places.side, (step * x_px, step * y_px), over_ring, saturated,
    )  # fmt: skip


def attenuation_db(ratio: float) -> float:
    """Return the attenuation of a normalised stray light, 10 log10 of its inverse, at least 0 dB; nan below 0.

    Examples
    --------
    >>> from labcdp.metrics.stray_light import attenuation_db
    >>> attenuation_db(1e-4)
    40.0
    """
    return max(-10 * log10(ratio), 0.0) if ratio > 0 else nan


def _intensity(stray: StrayLight, illuminance_lx: Quantity) -> StrayLight:
    """Pi L / E, of a diffuser of reflectance 1 under the illuminance E."""
    if stray.mean.unit != "cd/m²":
        raise InputError("the illuminance is given, but the light has no scale: give light in cd/m², by a calibration")
    if not (isfinite(illuminance_lx.value) and illuminance_lx.value > 0):
        raise InputError(f"the illuminance is {illuminance_lx.value:g} lx: give a number above 0")
    return stray.scaled(pi / illuminance_lx.value, illuminance_lx.u / illuminance_lx.value, "")


def _as_map(light: ArrayLike | LuminanceMap, name: str, shape: tuple[int, int] | None = None) -> LuminanceMap:
    if not isinstance(light, LuminanceMap):
        values = light_array(light, name)
        if values.ndim != 2:
            raise InputError(f"{name} has the shape {values.shape}: give rows of pixels")
        light = LuminanceMap(values, np.zeros(values.shape), (), np.zeros(values.shape, np.uint8))
    if shape is not None and light.shape != shape:
        raise InputError(
            f"{name} has {light.shape[1]} x {light.shape[0]} pixels, the picture {shape[1]} x {shape[0]}: give one size"
        )
    return light


@dataclass(frozen=True, eq=False)
class _Places:
    """Pixels beside a source, in pixels of a map: all of them, in rings about it, and in blocks."""

    source: NDArray[np.bool_]
    usable: NDArray[np.bool_]
    centre: tuple[float, float]
    side: int

    @classmethod
    def of(cls, light: LuminanceMap, source: Sequence[Roi], block_px: int) -> _Places:
        """Return the places of a picture; raises InputError if the source leaves none."""
        if block_px < light.step:
            raise InputError(f"the blocks have {block_px} pixels a side: give at least {light.step}")
        inside = np.zeros(light.shape, dtype=np.bool_)
        for roi in source:
            region = light.scaled(roi)
            inside[region.window(light.shape)] |= region.mask(light.shape)
        usable = ~inside & np.isfinite(light.luminance_cd_m2) & ((light.invalid & Invalid.DEFECT) == 0)
        if not inside.any() or not usable.any():
            raise InputError("the regions of the source hold all pixels, or none: draw them about the source alone")
        y, x = np.nonzero(inside)
        return cls(inside, usable, (float(x.mean()) + 0.5, float(y.mean()) + 0.5), block_px // light.step)

    @cached_property
    def radius(self) -> _Array:
        """Distance of each pixel from the middle of the source."""
        y, x = (np.arange(size) + 0.5 for size in self.usable.shape)
        radius: _Array = np.maximum(np.hypot(x - self.centre[0], y[:, None] - self.centre[1]), 0.1)
        return radius

    @cached_property
    def ring(self) -> NDArray[np.intp]:
        """Number of the ring of each pixel: rings of equal ratio, at least a pixel wide."""
        near, far = float(self.radius[self.usable].min()), float(self.radius[self.usable].max())
        edges = [near]
        while edges[-1] <= far:
            edges.append(max(edges[-1] * 10 ** (1 / _RINGS), edges[-1] + 1))
        number = np.clip(np.searchsorted(edges, self.radius, side="right") - 1, 0, len(edges) - 2)
        # Without rings that hold no pixel.
        _, number[self.usable] = np.unique(number[self.usable], return_inverse=True)
        return number

    @property
    def ring_radius(self) -> _Array:
        """Mean distance of the pixels of each ring."""
        ring = self.ring[self.usable]
        radius: _Array = np.bincount(ring, self.radius[self.usable]) / np.bincount(ring)
        return radius

    @property
    def block_shape(self) -> tuple[int, int]:
        """Rows and columns of blocks; those at the lower and right edge may be smaller."""
        height, width = self.usable.shape
        return -(-height // self.side), -(-width // self.side)

    @cached_property
    def block(self) -> NDArray[np.intp]:
        """Number of the block of each pixel."""
        rows, columns = (np.arange(size) // self.side for size in self.usable.shape)
        return np.asarray(rows[:, None] * self.block_shape[1] + columns, dtype=np.intp)

    @cached_property
    def block_is_free(self) -> NDArray[np.bool_]:
        """Which blocks lie beside the source for the most part, shape (blocks,)."""
        size = np.bincount(self.block.ravel())
        free: NDArray[np.bool_] = np.bincount(self.block[self.usable], minlength=size.size) >= _LEAST_SHARE * size
        return free

    def block_means(self, values: _Array) -> _Array:
        """Mean of the usable pixels of each block, shape (blocks,); nan without any."""
        at, n_blocks = self.block[self.usable], int(self.block.max()) + 1
        with np.errstate(invalid="ignore"):
            means: _Array = np.bincount(at, values[self.usable], n_blocks) / np.bincount(at, minlength=n_blocks)
        return means

    def block_middle(self, number: int) -> tuple[float, float]:
        """Middle (x, y) of a block."""
        row, column = divmod(number, self.block_shape[1])
        y, x = (
            (at * self.side + min((at + 1) * self.side, size)) / 2
            for at, size in zip((row, column), self.usable.shape, strict=True)
        )
        return x, y

    @property
    def groups(self) -> list[NDArray[np.intp]]:
        """Number of the group of each pixel, -1 for none: all pixels as one, rings, and blocks."""
        return [np.where(self.usable, group, -1) for group in (0, self.ring, self.block)]


def _at_radius(places: _Places, profile: _Array) -> _Array:
    """Profile at the radius of each pixel; nan where it is not above 0, as between a ring of noise and others."""
    lit = profile > 0
    if not lit.any():
        return np.full(places.radius.shape, nan)
    # A straight line in logarithms, as the profiles of most lenses nearly are.
    return np.exp(np.interp(np.log(places.radius), np.log(places.ring_radius[lit]), np.log(profile[lit])))


def _stray_light(means: Sequence[_Means], places: _Places, worst: int, unit: str) -> StrayLight:
    """Return the means of all pixels, of the worst block, of rings, and of blocks."""
    whole, rings, blocks = means
    value, u = (np.where(places.block_is_free, part, nan) for part in (blocks.value, blocks.u))
    return StrayLight(
        Quantity(float(whole.value[0]), float(whole.u[0]), unit),
        Quantity(float(value[worst]), float(u[worst]), unit),
        Quantity(rings.value, rings.u, unit),
        Quantity(value.reshape(places.block_shape), u.reshape(places.block_shape), unit),
    )


@dataclass(frozen=True, eq=False)
class _Means:
    """Means of groups of pixels, with their errors in the unit of the light.

    Parameters
    ----------
    value, noise, slow : ndarray of float, shape (n,)
        Mean, its standard uncertainty by noise, and by what differs from place to place.
    common : dict of str to ndarray of float, shape (n,)
        Error by each one that all share, for one standard uncertainty of it.
    """

    value: _Array
    noise: _Array
    slow: _Array
    common: dict[str, _Array]

    @property
    def u(self) -> _Array:
        """Standard uncertainty."""
        squares = self.noise**2 + self.slow**2 + sum((error**2 for error in self.common.values()), start=np.zeros(()))
        u: _Array = np.sqrt(squares)
        return u

    def over(self, other: _Means) -> _Means:
        """Return the means over a single other one; what both share cancels as far as it is alike."""
        ratio = self.value / other.value[0]
        noise, slow = (
            np.hypot(part, ratio * of_other[0]) / abs(other.value[0])
            for part, of_other in ((self.noise, other.noise), (self.slow, other.slow))
        )
        common = {}
        for name in self.common.keys() | other.common.keys():
            error, of_other = self.common.get(name, np.zeros(1)), other.common.get(name, np.zeros(1))
            if np.isfinite(error).all() or np.isfinite(of_other).all():
                common[name] = (error - ratio * of_other[0]) / other.value[0]
            # An unknown scale that both have cancels.
        return _Means(ratio, noise, slow, common)

    def less(self, other: _Means) -> _Means:
        """Return the differences from others of the same groups."""
        none = np.zeros(self.value.shape)
        names = self.common.keys() | other.common.keys()
        common = {name: self.common.get(name, none) - other.common.get(name, none) for name in names}
        return _Means(self.value - other.value, np.hypot(self.noise, other.noise), self.slow, common)


def _group_means(light: LuminanceMap, group: NDArray[np.intp]) -> _Means:
    chosen = group >= 0
    at, n_groups = group[chosen], int(group.max()) + 1
    count = np.maximum(np.bincount(at, minlength=n_groups), 1)
    values = np.asarray(light.luminance_cd_m2, dtype=np.float64)

    def mean(of: ArrayLike) -> _Array:
        each = np.broadcast_to(np.asarray(of, dtype=np.float64), values.shape)[chosen]
        result: _Array = np.bincount(at, np.where(np.isfinite(each), each, 0.0), n_groups) / count
        return result

    value = mean(values)
    common: dict[str, _Array] = {}
    for number, error in enumerate(light.common_in(WHOLE)):
        is_known = np.ndim(error.relative) > 0 or np.isfinite(error.relative)
        # Of a guessed camera the scale is not known.
        common[f"{error.source} {number}"] = mean(error.relative * values) if is_known else np.full(n_groups, nan)
    slow = np.hypot(light.slow_rel * np.abs(value), mean(light.slow_cd_m2))
    return _Means(value, np.sqrt(_noise_variance(values, group, n_groups) / count), slow, common)


def _noise_variance(values: _Array, group: NDArray[np.intp], n_groups: int) -> _Array:
    """Variance of a pixel in each group, by the differences of neighbours; that of all where a group has none."""
    differences = values[:, 1:] - values[:, :-1]
    near = (group[:, 1:] == group[:, :-1]) & (group[:, 1:] >= 0) & np.isfinite(differences)
    at, squares = group[:, 1:][near], np.square(differences[near]) / 2
    count = np.bincount(at, minlength=n_groups)
    whole = float(squares.mean()) if squares.size else nan
    return np.where(count > 0, np.bincount(at, squares, n_groups) / np.maximum(count, 1), whole)


def _source_means(direct: LuminanceMap, inside: NDArray[np.bool_]) -> _Means:
    """Light of a source: the median of its pixels, with the errors of their mean."""
    values = np.where(inside, np.asarray(direct.luminance_cd_m2, dtype=np.float64), nan)
    if np.any((direct.invalid[inside] & Invalid.SATURATED) > 0):
        raise InputError("the direct picture of the source is saturated: shorten its exposure, or take a denser filter")
    brightest = float(np.nanmax(values)) if np.isfinite(values).any() else 0.0
    if not brightest > 0:
        raise InputError("the direct picture has no light in the regions of the source: check that it is in its place")
    of_source = values >= _OF_SOURCE * brightest
    means = _group_means(direct, np.where(of_source, 0, -1))
    return replace(means, value=np.array([np.median(values[of_source])]))
