"""Calibration of a camera with colour filters: its planes, and their combination to luminance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import hypot

import numpy as np

from ...core.finding import Finding
from ...core.frame import Frame
from ...core.luminance import WHOLE, LuminanceMap, Window
from ...core.spectral.mismatch import Source
from ...core.spectral.table import SpectralTable
from ..findings import LeftOut
from ..frames.observations import CameraState
from ..meter import MeterScale
from ..model import PatchResidual
from ..setup import LensIdentity, Provenance
from .conversion import ColourConverter
from .map import to_luminance


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
        """Convert a Bayer frame; see `labcdp.calibration.colour.map.to_luminance`."""
        return to_luminance(self, frame, window)
