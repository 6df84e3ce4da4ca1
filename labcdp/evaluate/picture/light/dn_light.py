"""From DN to light by a table: what a camera specification, and no knowledge at all, have in common."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....core.frame import Frame
from ....core.luminance import WHOLE, CommonError, Invalid, LuminanceMap, Window
from ....core.vignetting import Vignetting

_Maps = NDArray[np.float32]
_Light = NDArray[np.float32] | NDArray[np.float64]
#: Pixels that are looked up at a time: few enough to stay in the processor's cache.
_BLOCK = 2**15
#: Rows and columns of the two green pixels in each group of 2 x 2, by the pattern of the colour filter.
_GREEN = {"RG": ((0, 1), (1, 0)), "BG": ((0, 1), (1, 0)), "GR": ((0, 0), (1, 1)), "GB": ((0, 0), (1, 1))}


@dataclass(frozen=True, eq=False)
class DnLight:
    """Light of each DN.

    Parameters
    ----------
    light : ndarray of float32 or float64, shape (n,)
        Light by DN, on the optical axis, as seen through the windscreen but divided by its transmittance. The map has
        the same type.
    noise : ndarray of float32, shape (n,)
        Standard deviation of a pixel's light by DN.
    steps : ndarray of float32, shape (n,)
        Difference of light from a DN to the next, by DN.
    flags : ndarray of uint8, shape (n,)
        `Invalid` flags by DN.
    vignetting : Vignetting or None
        Vignetting, None for none.
    glare_fraction : float
        Veiling light over mean light of the scene.
    common : tuple of CommonError
        Errors that all pixels share.
    """

    light: _Light
    noise: _Maps
    steps: _Maps
    flags: NDArray[np.uint8]
    vignetting: Vignetting | None = None
    glare_fraction: float = 0.0
    common: tuple[CommonError, ...] = ()

    def map_of(self, frame: Frame, window: Window = WHOLE) -> LuminanceMap:
        """Light of a frame, or of some rows and columns of its map.

        Parameters
        ----------
        frame : Frame
            Grey, or behind a Bayer pattern; of the latter the mean of the two green pixels counts for each group of
            2 x 2.
        window : Window
            Rows and columns of the map.

        Returns
        -------
        LuminanceMap
            With ``step`` 2 for a Bayer pattern.
        """
        inverse_v = None if self.vignetting is None else _inverse_v(self.vignetting, frame.shape)
        glare = self._glare(frame, inverse_v)
        step = 1 if frame.colour_filter is None else 2
        parts = [
            _Part(frame.dn[place][window], None if inverse_v is None else inverse_v[place][window])
            for place in _places(frame)
        ]
        light = _mean([part.of(self.light) for part in parts])
        if glare:
            light = light - np.float32(glare)

        def random_rel() -> _Maps:
            squares = [np.square(part.of(self.noise)) for part in parts]
            with np.errstate(divide="ignore"):
                return np.asarray(np.sqrt(_mean(squares) / len(parts)) / np.abs(light), dtype=np.float32)

        def invalid() -> NDArray[np.uint8]:
            flags: NDArray[np.uint8] = np.bitwise_or.reduce([looked_up(self.flags, part.dn) for part in parts])
            flags[light < 0] |= Invalid.BELOW_BLACK.value
            if frame.clipped is not None:
                flags[frame.clipped[window]] |= Invalid.SATURATED.value
            return flags

        def dn_step(of_map: Window) -> _Light:
            return _mean([part.within(of_map).of(self.steps) for part in parts])

        return LuminanceMap(light, random_rel, self.common, invalid, step=step, dn_step=dn_step)

    def _glare(self, frame: Frame, inverse_v: _Maps | None) -> float:
        """Veiling light: behind the windscreen is t (L + g mean(L)), whose mean over the image is t (1 + g) mean(L)."""
        if self.glare_fraction == 0:
            return 0.0
        means = [
            _Part(frame.dn[place], None if inverse_v is None else inverse_v[place]).of(self.light).mean(dtype=float)
            for place in _places(frame)
        ]
        return float(np.mean(means)) * self.glare_fraction / (1 + self.glare_fraction)


@dataclass(frozen=True, eq=False)
class _Part:
    """Pixels of a frame that make a map, alone or with those of another part."""

    dn: NDArray[np.unsignedinteger[Any]]
    inverse_v: _Maps | None

    def within(self, window: Window) -> _Part:
        return _Part(self.dn[window], None if self.inverse_v is None else self.inverse_v[window])

    def of(self, table: _Light) -> _Light:
        values = looked_up(table, self.dn)
        if self.inverse_v is not None:
            values *= self.inverse_v
        return values


def looked_up(table: NDArray[Any], dn: NDArray[np.unsignedinteger[Any]]) -> NDArray[Any]:
    """Values of a table at the DN; DN beyond it get its last value."""
    if dn.dtype == np.uint8 and table.size == 256 and dn.strides[1] == 1:
        import cv2

        return np.asarray(cv2.LUT(dn, table))
    values = np.empty(dn.shape, table.dtype)
    rows = max(_BLOCK // dn.shape[1], 1) if dn.size else 1
    for start in range(0, dn.shape[0], rows):
        block = slice(start, start + rows)
        np.take(table, dn[block], out=values[block], mode="clip")
    return values


def _places(frame: Frame) -> list[tuple[slice, slice]]:
    if frame.colour_filter is None:
        return [WHOLE]
    height, width = (n // 2 * 2 for n in frame.shape)
    return [(slice(y, height, 2), slice(x, width, 2)) for y, x in _GREEN[frame.colour_filter]]


def _mean(values: list[_Light]) -> _Light:
    return values[0] if len(values) == 1 else (values[0] + values[1]) / np.float32(2)


#: Fall-offs of the last image sizes, which a video asks for again and again.
_KEPT: dict[tuple[Vignetting, tuple[int, int]], _Maps] = {}


def _inverse_v(vignetting: Vignetting, shape: tuple[int, int]) -> _Maps:
    key = (vignetting, shape)
    if key not in _KEPT:
        if len(_KEPT) >= 4:
            _KEPT.clear()
        _KEPT[key] = np.reciprocal(vignetting.relative_illuminance(shape)).astype(np.float32)
    return _KEPT[key]
