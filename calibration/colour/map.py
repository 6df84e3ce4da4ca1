"""Luminance maps of Bayer frames: combinations of the maps of their planes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.frame import Frame
from ...core.luminance import RANGE_MARGIN, WHOLE, CommonError, Invalid, LuminanceMap, PixelErrors, Window
from ..errors.uncertainty import student_factor
from ..frames.planes import split
from .conversion import ColourConverter, errors_of_plane, joined
from .mismatch import mismatch_errors

#: Groups of pixels on each side whose mean is the colour of the light.
_NEIGHBOURS = 6


def to_luminance(converter: ColourConverter, frame: Frame, window: Window = WHOLE) -> LuminanceMap:
    """Convert a Bayer frame to luminance, one value for each group of 2 x 2 pixels.

    Parameters
    ----------
    converter : ColourConverter
        Of the camera.
    frame : Frame
        Frame with the colour filter of the calibration, shape (height, width).
    window : Window
        Rows and columns of the map to be computed.

    Returns
    -------
    LuminanceMap
        Of shape (height // 2, width // 2), with ``step`` 2. A pixel is saturated, or a defect, if one of its planes is.

    Raises
    ------
    CalibrationError
        If the frame has no colour filter, or is of another camera or setting.
    """
    frames = split(frame)
    shape = next(iter(frames.values())).shape
    wide, inner = zip(*(_widened(part, n) for part, n in zip(window, shape, strict=True)), strict=True)
    maps = [plane.to_luminance(frames[f"{plane.state.plane}"], wide) for plane in converter.planes]
    return _Combined(converter, maps, inner).map()


def _widened(part: slice, n: int) -> tuple[slice, slice]:
    """Rows, or columns, with the neighbours that tell the colour of the light, and where among them the rows are."""
    start, stop, _ = part.indices(n)
    first = max(start - _NEIGHBOURS, 0)
    return slice(first, min(stop + _NEIGHBOURS, n)), slice(start - first, stop - first)


@dataclass(frozen=True, eq=False)
class _Combined:
    """Map of a frame, of the maps of its planes; all but the luminance is computed on demand."""

    converter: ColourConverter
    maps: Sequence[LuminanceMap]
    inner: Window

    def map(self) -> LuminanceMap:
        converter = self.converter
        return LuminanceMap(
            self._luminance()[self.inner],
            PixelErrors(
                lambda: self._random_rel()[self.inner],
                slow_rel=hypot(
                    converter.field_rel, converter.scatter_rel * student_factor(converter.scatter_dof or inf)
                ),
                slow_cd_m2=np.sqrt(self._sum_of_squares([one.slow_cd_m2 for one in self.maps]))[self.inner],
                fixed_rel=max(one.fixed_rel for one in self.maps),
                fixed_cd_m2=lambda: np.sqrt(self._sum_of_squares([one.fixed_cd_m2 for one in self.maps]))[self.inner],
            ),
            self._common,
            lambda: self._invalid()[self.inner],
            step=2,
        )

    def _luminance(self) -> NDArray[np.floating[Any]]:
        total = np.zeros(self.maps[0].shape, dtype=np.float32)
        for weight, one in zip(self.converter.weights, self.maps, strict=True):
            total += np.float32(weight) * one.luminance_cd_m2
        return total

    def _magnitude(self, window: Window = WHOLE) -> NDArray[np.floating[Any]]:
        magnitude: NDArray[np.floating[Any]] = np.maximum(np.abs(self._luminance()[window]), np.float32(1e-30))
        return magnitude

    def _random_rel(self) -> NDArray[np.floating[Any]]:
        variance = self._sum_of_squares([one.luminance_cd_m2 * one.random_rel for one in self.maps])
        random_rel: NDArray[np.floating[Any]] = np.sqrt(variance) / self._magnitude()
        return random_rel

    def _sum_of_squares(self, of_planes: Sequence[NDArray[np.floating[Any]] | float]) -> NDArray[np.floating[Any]]:
        """Variance of the weighted sum of independent errors of the planes."""
        variance = np.zeros(self.maps[0].shape, dtype=np.float32)
        for weight, one in zip(self.converter.weights, of_planes, strict=True):
            variance += np.square(np.float32(weight) * one)
        return variance

    def _common(self, of_inner: Window) -> tuple[CommonError, ...]:
        planes = self.converter.planes
        inside = [range(n)[wide][part] for n, wide, part in zip(self.maps[0].shape, self.inner, of_inner, strict=True)]
        window = slice(inside[0].start, inside[0].stop), slice(inside[1].start, inside[1].stop)
        by_plane = np.stack([one.luminance_cd_m2[window] for one in self.maps], axis=-1)
        magnitude = self._magnitude(window)
        shares = [w * by_plane[..., i] / magnitude for i, w in enumerate(self.converter.weights)]
        seen = self._colours(window)
        level = np.maximum(np.abs(seen @ np.array(self.converter.weights, np.float32)), np.float32(1e-30))
        errors = [CommonError("fit", seen @ row / level) for row in self.converter.weight_errors]
        kept = [errors_of_plane(plane, one.common_in(window)) for plane, one in zip(planes, self.maps, strict=True)]
        errors += joined(kept, shares)
        errors += mismatch_errors(self.converter.by_colour(seen), self.converter.spectral_rel)
        return tuple(errors)

    def _colours(self, window: Window) -> NDArray[np.floating[Any]]:
        """Luminances by the planes without their noise, which is no colour of the light: means of neighbours."""
        import cv2

        around, inner = zip(
            *(_widened(part, n) for part, n in zip(window, self.maps[0].shape, strict=True)), strict=True
        )
        size = 2 * _NEIGHBOURS + 1
        means = [cv2.blur(one.luminance_cd_m2[around], (size, size))[inner] for one in self.maps]
        return np.stack(means, axis=-1)

    def _invalid(self) -> NDArray[np.uint8]:
        luminance, margin = self._luminance(), RANGE_MARGIN * self._random_rel() * self._magnitude()
        low, high = self.converter.range_cd_m2
        invalid = np.where(luminance < 0, Invalid.BELOW_BLACK, 0).astype(np.uint8)
        invalid[(luminance + margin < low) | (luminance - margin > high)] |= np.uint8(Invalid.OUTSIDE_CALIBRATED)
        for one in self.maps:
            invalid |= one.invalid & np.uint8(Invalid.SATURATED | Invalid.DEFECT)
        return invalid
