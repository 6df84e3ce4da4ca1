"""Calibration of a camera with colour filters: its planes, and their combination to luminance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot, inf
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.frame import Frame
from ...core.luminance import RANGE_MARGIN, WHOLE, CommonError, Invalid, LuminanceMap, PixelErrors, Window
from ...core.result import Finding
from ...core.spectra import Source, SpectralTable
from ..findings import LeftOut
from ..frames.measure import split
from ..frames.observations import CameraState
from ..model import Calibration, PatchResidual, calibration_table
from ..setup import LensIdentity, MeterScale, Provenance
from ..uncertainty import student_factor
from .conversion import ColourConverter, errors_of_plane, joined, mismatch_errors

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


@dataclass(frozen=True)
class CombinationStep:
    """A candidate conversion of the planes to luminance.

    Parameters
    ----------
    name : str
        ``combination``, or a single colour.
    leave_one_out_rel : float
        Root mean square of the relative deviations of patches from a fit without them.
    chosen : bool
        Whether the calibration uses it.
    reason : Finding
        Why it was selected or not.
    """

    name: str
    leave_one_out_rel: float
    chosen: bool
    reason: Finding


@dataclass(frozen=True)
class ColourCalibration(ColourConverter):
    """A colour converter and its evidence.

    Parameters
    ----------
    residuals, held_out : tuple of PatchResidual
        Fitted and held-out patches, by the combination.
    left_out : tuple of LeftOut
        Data not used by the combination, with reasons.
    ladder : tuple of CombinationStep
        The combination and each colour alone.
    sensitivity : SpectralTable or None
        Relative spectral sensitivity of the combination, None if those of the planes are not known.
    f1_prime : float or None
        Its f1', as a fraction.
    findings : tuple of Finding
        Findings for the user; the subjects of those of a plane name it.
    """

    residuals: tuple[PatchResidual, ...]
    held_out: tuple[PatchResidual, ...]
    left_out: tuple[LeftOut, ...]
    ladder: tuple[CombinationStep, ...]
    sensitivity: SpectralTable | None
    f1_prime: float | None
    findings: tuple[Finding, ...]

    def __repr__(self) -> str:
        return f"<ColourCalibration of {self.state.camera}>"

    def _repr_html_(self) -> str:
        """Table for notebooks."""
        return calibration_table(self)

    @property
    def state(self) -> CameraState:
        """Camera and settings, of whole frames."""
        states = [plane.state for plane in self.planes]
        height, width = states[0].image_shape
        stated = [state.black_level_dn for state in states if state.black_level_dn is not None]
        return replace(
            states[0],
            image_shape=(2 * height, 2 * width),
            saturation_dn=min(state.saturation_dn for state in states),
            black_level_dn=float(np.mean(stated)) if stated else None,
            plane=None,
            readout=states[0].readout and states[0].readout.in_larger_pixels(1 / 2),
        )

    @property
    def lens(self) -> LensIdentity:
        """The lens."""
        return self.planes[0].lens

    @property
    def source_spectrum(self) -> str:
        """Light it is valid for."""
        return self.planes[0].source_spectrum

    @property
    def light(self) -> Source:
        """The spectrum it is valid for as measured, else its name."""
        return self.planes[0].light

    @property
    def meter_scale(self) -> MeterScale:
        """The meter, and the bound of its scale error, common to all luminances."""
        return self.planes[0].meter_scale

    @property
    def provenance(self) -> Provenance:
        """Provenance of the calibration."""
        return max((plane.provenance for plane in self.planes), key=lambda provenance: provenance.measured)

    @property
    def exposures_s(self) -> tuple[float, ...]:
        """Exposures that were used in any plane, ascending."""
        return tuple(sorted({t for plane in self.planes for t in plane.exposures_s}))

    @property
    def rate_weights(self) -> dict[str, float]:
        """w_p / R_p by the name of the plane, in (cd/m^2) / (DN/s): L is the sum of these times the rates S_p."""
        return {
            f"{plane.state.plane}": weight / plane.responsivity.responsivity_dn_s_cd_m2
            for plane, weight in zip(self.planes, self.weights, strict=True)
        }

    def dark_spread_cd_m2(self, frame: Frame) -> float:
        """Return what dark signal non-uniformity and drift of the black level make of a dark pixel's luminance."""
        return hypot(*(w * plane.dark_spread_cd_m2(frame) for w, plane in zip(self.weights, self.planes, strict=True)))

    def to_luminance(self, frame: Frame, window: Window = WHOLE) -> LuminanceMap:
        """Convert a Bayer frame; see `to_luminance`."""
        return to_luminance(self, frame, window)


AnyCalibration: TypeAlias = Calibration | ColourCalibration
