"""Calibration of a camera with colour filters: its planes, and their combination to luminance."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..frame import Frame
from ..luminance import WHOLE, LuminanceMap, Window
from ..spectral_mismatch import Source
from ..spectral_table import SpectralTable
from .findings import LeftOut
from .model import Calibration, PatchResidual
from .observations import CameraState
from .readings import MeterScale
from .setup import LensIdentity, Provenance


@dataclass(frozen=True)
class CombinationStep:
    """One way to make luminance of the planes.

    Parameters
    ----------
    name : str
        ``combination``, or the colour that is used alone.
    leave_one_out_rel : float
        Root mean square of the relative deviations of patches from a fit without them.
    chosen : bool
        Whether the calibration uses it.
    reason : str
        Why it was chosen, or was not, in plain words.
    """

    name: str
    leave_one_out_rel: float
    chosen: bool
    reason: str


@dataclass(frozen=True)
class ColourCalibration:
    """DN to cd/m^2 for a camera with colour filters: L = sum of w_p L_p over the planes p.

    L_p is the luminance by the plane's own calibration, so with its rate S_p = h_p(DN - d_p) / (t V) and responsivity
    R_p it is L = sum of (w_p / R_p) S_p at each group of 2 x 2 pixels.

    Parameters
    ----------
    planes : tuple of Calibration
        In the order R, Gr, Gb, B; fitted to the patches that share one spectrum.
    weights : tuple of float
        w, one a plane; the greens have the same. They sum to about 1.
    weight_covariance : tuple of tuple of float
        Covariance of the weights, without the meter's scale.
    spectral_rel : float
        Relative standard deviation of a patch by its colour, per unit of colourfulness (standard deviation over mean of
        the L_p of red, green and blue): what no weights make fit.
    scatter_rel : float
        Relative standard deviation between patches of the planes' fits that nothing explains.
    range_cd_m2 : (float, float)
        Lowest and highest luminance of the patches.
    residuals, held_out : tuple of PatchResidual
        Patches of the fit, and patches it was not shown, by the combination.
    left_out : tuple of LeftOut
        What the combination does not use, and why.
    ladder : tuple of CombinationStep
        The combination and each colour alone.
    sensitivity : SpectralTable or None
        Relative spectral sensitivity of the combination, None if those of the planes are not known.
    f1_prime : float or None
        Its f1', as a fraction.
    warnings : tuple of str
        What the user should know; those of the planes begin with the plane's name.

    Raises
    ------
    InputError
        If the numbers of planes, weights and covariances differ, or the range is not ascending.
    """

    planes: tuple[Calibration, ...]
    weights: tuple[float, ...]
    weight_covariance: tuple[tuple[float, ...], ...]
    spectral_rel: float
    scatter_rel: float
    range_cd_m2: tuple[float, float]
    residuals: tuple[PatchResidual, ...]
    held_out: tuple[PatchResidual, ...]
    left_out: tuple[LeftOut, ...]
    ladder: tuple[CombinationStep, ...]
    sensitivity: SpectralTable | None
    f1_prime: float | None
    warnings: tuple[str, ...]

    def __post_init__(self) -> None:
        n = len(self.planes)
        if n == 0 or len(self.weights) != n or np.shape(self.weight_covariance) != (n, n):
            raise InputError(
                f"a colour calibration of {n} planes has {len(self.weights)} weights and a covariance of shape "
                f"{np.shape(self.weight_covariance)}: give one weight a plane"
            )
        low, high = self.range_cd_m2
        if not 0 < low <= high < float("inf"):
            raise InputError(f"range_cd_m2 is {low:g} to {high:g}: give two positive luminances, the lower first")

    @property
    def state(self) -> CameraState:
        """Camera and settings, of whole frames."""
        states = [plane.state for plane in self.planes]
        height, width = states[0].image_shape
        return replace(
            states[0],
            image_shape=(2 * height, 2 * width),
            saturation_dn=min(state.saturation_dn for state in states),
            black_level_dn=float(np.mean([state.black_level_dn for state in states])),
            plane=None,
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
        """The meter, and the half width of its scale error, common to all luminances."""
        return self.planes[0].meter_scale

    @property
    def provenance(self) -> Provenance:
        """Where it comes from."""
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

    def to_luminance(self, frame: Frame, window: Window = WHOLE) -> LuminanceMap:
        """Convert a Bayer frame to luminance, one value for each group of 2 x 2 pixels.

        Parameters
        ----------
        frame : Frame
            With the colour filter of the calibration, shape (height, width).
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
        from .colour_conversion import to_luminance

        return to_luminance(self, frame, window)

    @property
    def weight_errors(self) -> NDArray[np.float64]:
        """Independent errors of the weights for one standard uncertainty, one a row, shape (n, planes)."""
        values, vectors = np.linalg.eigh(np.array(self.weight_covariance))
        kept = values > 1e-12 * max(values.max(), 1e-30)
        rows: NDArray[np.float64] = (vectors[:, kept] * np.sqrt(values[kept])).T
        return rows
