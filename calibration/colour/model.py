"""Calibration of a camera with colour filters: its planes, and their combination to luminance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import hypot, inf
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.frame import Frame
from ...core.luminance import RANGE_MARGIN, WHOLE, CommonError, Invalid, LuminanceMap, Window
from ...core.result import Finding
from ...core.spectra import Source, SpectralTable
from ..fit_records import LeftOut
from ..frames.measure import split
from ..frames.observations import CameraState
from ..model import Calibration, PatchResidual, calibration_table
from ..setup import LensIdentity, MeterScale, Provenance
from ..uncertainty import student_factor
from .conversion import CalibratedColourCamera

_Map: TypeAlias = NDArray[np.floating[Any]]
#: Groups of pixels on each side whose mean is the colour of the light.
_NEIGHBOURS = 6


def _widened(window: Window, shape: tuple[int, int]) -> tuple[Window, Window]:
    """Rows and columns with the neighbours that tell the colour of the light, and where among them the window is."""
    wide, inner = [], []
    for part, n in zip(window, shape, strict=True):
        start, stop, _ = part.indices(n)
        first = max(start - _NEIGHBOURS, 0)
        wide.append(slice(first, min(stop + _NEIGHBOURS, n)))
        inner.append(slice(start - first, stop - first))
    return (wide[0], wide[1]), (inner[0], inner[1])


class _CombinedMap(LuminanceMap):
    """Map of a frame by the maps of its planes, of the part `inner` of theirs."""

    def __init__(self, camera: CalibratedColourCamera, maps: Sequence[LuminanceMap], inner: Window) -> None:
        self._camera, self._maps, self._inner, self.step = camera, maps, inner, 2
        self._luminance = np.zeros(maps[0].shape, dtype=np.float32)
        for weight, plane in zip(camera.weights, maps, strict=True):
            self._luminance += np.float32(weight) * plane.luminance_cd_m2
        self.luminance_cd_m2 = self._luminance[inner]
        # Of grey light.
        shares = np.array(camera.weights) / sum(camera.weights)
        self.fixed_rel = float(np.linalg.norm(shares * [plane.fixed_rel for plane in maps]))
        self.slow_rel = hypot(camera.field_rel, camera.scatter_rel * student_factor(camera.scatter_dof or inf))
        self._slow_cd_m2 = self._combined([plane.slow_cd_m2 for plane in maps])[inner]

    @cached_property
    def random_rel(self) -> _Map:
        return self._pixel_rel[self._inner]

    @cached_property
    def fixed_cd_m2(self) -> _Map:
        return self._combined([plane.fixed_cd_m2 for plane in self._maps])[self._inner]

    @property
    def _magnitude(self) -> _Map:
        return np.maximum(np.abs(self._luminance), np.float32(1e-30))

    @property
    def _pixel_rel(self) -> _Map:
        return self._combined([plane.luminance_cd_m2 * plane.random_rel for plane in self._maps]) / self._magnitude

    def _combined(self, of_planes: Sequence[_Map | float]) -> _Map:
        """Return the standard uncertainty of the weighted sum, of independent ones of the planes."""
        variance = np.zeros(self._maps[0].shape, dtype=np.float32)
        for weight, u in zip(self._camera.weights, of_planes, strict=True):
            variance += np.square(np.float32(weight) * u)
        return np.sqrt(variance)

    def common_in(self, window: Window) -> tuple[CommonError, ...]:
        """Return the common errors of some rows and columns of the map."""
        shape = self._maps[0].shape
        rows, columns = (range(n)[a][b] for n, a, b in zip(shape, self._inner, window, strict=True))
        window = slice(rows.start, rows.stop), slice(columns.start, columns.stop)
        magnitude = self._magnitude[window]
        weighted = zip(self._camera.weights, self._maps, strict=True)
        shares = [weight * plane.luminance_cd_m2[window] / magnitude for weight, plane in weighted]
        of_planes = [plane.common_in(window) for plane in self._maps]
        return self._camera.common_errors(self._colours(window), of_planes, shares)

    def _colours(self, window: Window) -> _Map:
        """Luminances by the planes without their noise, which is no colour of the light: means of neighbours."""
        import cv2

        around, inner = _widened(window, self._maps[0].shape)
        size = 2 * _NEIGHBOURS + 1
        means = [cv2.blur(plane.luminance_cd_m2[around], (size, size))[inner] for plane in self._maps]
        return np.stack(means, axis=-1)

    @cached_property
    def invalid(self) -> NDArray[np.uint8]:
        luminance, margin = self._luminance, RANGE_MARGIN * self._pixel_rel * self._magnitude
        low, high = self._camera.range_cd_m2
        invalid = np.where(luminance < 0, Invalid.BELOW_BLACK, 0).astype(np.uint8)
        invalid[(luminance + margin < low) | (luminance - margin > high)] |= np.uint8(Invalid.OUTSIDE_CALIBRATED)
        for plane in self._maps:
            invalid |= plane.invalid & np.uint8(Invalid.SATURATED | Invalid.DEFECT)
        return invalid[self._inner]


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
class ColourCalibration(CalibratedColourCamera):
    """A calibrated colour camera and its evidence.

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

    Examples
    --------
    >>> from labcdp.calibration import Calibration, ColourCalibration
    >>> def luminance_weights(calibration: Calibration | ColourCalibration) -> dict[str | None, float]:
    ...     planes = (plane.state.plane for plane in calibration.planes)
    ...     return dict(zip(planes, calibration.weights, strict=True))
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
    def stability_rel(self) -> float:
        """Relative standard uncertainty of the responsivity by another day, and by another temperature."""
        return self.planes[0].stability_rel

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

    def dark_spread_cd_m2(self, frame: Frame) -> float:
        """Return what dark signal non-uniformity and drift of the black level make of a dark pixel's luminance."""
        return hypot(*(w * plane.dark_spread_cd_m2(frame) for w, plane in zip(self.weights, self.planes, strict=True)))

    def to_luminance(self, frame: Frame, window: Window = WHOLE) -> LuminanceMap:
        """Convert a Bayer frame to luminance, one value for each group of 2 x 2 pixels.

        Parameters
        ----------
        frame : Frame
            Frame with the colour filter of the calibration, shape (height, width).
        window : Window
            Rows and columns of the map to be computed.

        Returns
        -------
        LuminanceMap
            Of shape (height // 2, width // 2), with ``step`` 2. A pixel is saturated, or a defect, if one of its planes
            is.

        Raises
        ------
        CalibrationError
            If the frame has no colour filter, or is of another camera or setting.
        """
        frames = split(frame)
        wide, inner = _widened(window, next(iter(frames.values())).shape)
        maps = [plane.to_luminance(frames[f"{plane.state.plane}"], wide) for plane in self.planes]
        return _CombinedMap(self, maps, inner)


AnyCalibration: TypeAlias = Calibration | ColourCalibration
