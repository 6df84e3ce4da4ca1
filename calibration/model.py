"""Calibration: the fitted conversion from DN to cd/m^2."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot, isfinite

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError
from ..core.finding import Finding
from ..core.frame import Frame
from ..core.luminance import WHOLE, LuminanceMap, Window
from ..core.response import Response
from ..core.spectral.mismatch import Source
from ..core.spectral.table import SpectralTable
from ..core.vignetting import AnyVignetting
from .dark.library import DarkLibrary
from .dark.signal import DarkModel
from .defects import DefectMap
from .findings import FitTest, LeftOut, ModelStep
from .fit_error import FitError
from .frames.observations import CameraState
from .gains import GainSetting, index_of_gain
from .meter import MeterScale
from .noise import TemporalNoise
from .readings import MeasuredPatch
from .setup import LensIdentity, Provenance


@dataclass(frozen=True)
class ResponsivityFit:
    """Fit of the responsivity with its quality measures.

    Parameters
    ----------
    responsivity_dn_s_cd_m2 : float
        R at small signals, linearised DN per second and cd/m^2 on the optical axis (DN s^-1 / (cd m^-2)), at the
        calibration's own gain.
    random_rel : float
        Relative standard uncertainty of R without the meter's scale.
    chi_squared : float
        Sum of squared standardised residuals of the observations by the stated errors, correlations respected.
    degrees_of_freedom : int
        Observations (patches times exposures) less parameters.
    scatter_rel, scatter_dn : float
        Unexplained standard deviation of patches and observations relative to the luminance, and of observations in DN.
        0 if the stated errors suffice.
    intercept_dn_s, intercept_standard_uncertainty_dn_s : float or None
        Free intercept, fitted as a test only; None if all patches have about the same luminance.
    glare_cd_m2 : float
        Glare that the fit found: as it depends on the scene, it is the standard uncertainty of any luminance.
    dof, scatter_dof : float or None
        Degrees of freedom of `random_rel` and `scatter_rel` (Welch and Satterthwaite); None if they are known.
    """

    responsivity_dn_s_cd_m2: float
    random_rel: float
    chi_squared: float
    degrees_of_freedom: int
    scatter_rel: float
    scatter_dn: float
    intercept_dn_s: float | None
    intercept_standard_uncertainty_dn_s: float | None
    dof: float | None = None
    scatter_dof: float | None = None
    glare_cd_m2: float = 0.0

    @property
    def reduced_chi_squared(self) -> float:
        """chi^2 over its degrees of freedom; about 1 if the stated errors are correct."""
        return self.chi_squared / self.degrees_of_freedom


@dataclass(frozen=True)
class PatchResidual(MeasuredPatch):
    """One row of the residual table.

    Parameters
    ----------
    residual_rel : float
        Relative deviation of the camera from the meter.
    standardised_residual : float
        Residual over its standard deviation by the stated errors.
    centre_px : (float, float)
        Middle (x, y) of the patch's region in the image.
    leave_one_out_rel : float or None
        Camera over meter, minus 1, by a fit without this patch; for a held-out patch the same as `residual_rel`; None
        if the other patches do not suffice for a fit.
    """

    residual_rel: float
    standardised_residual: float
    centre_px: tuple[float, float]
    leave_one_out_rel: float | None


def range_of(rows: Sequence[PatchResidual]) -> tuple[float, float]:
    """Lowest and highest luminance of patches, by meter or camera."""
    luminances = [value for row in rows for value in (row.reading_cd_m2, row.luminance_cd_m2)]
    return min(luminances), max(luminances)


@dataclass(frozen=True)
class Calibration:
    """DN to cd/m^2 for one camera, setting and lens: h(DN - d(t, T)) = R t V(x, y) L.

    Parameters
    ----------
    state : CameraState
        Camera, pixel format, bit depth, image size and gain it is valid for.
    lens : LensIdentity
        The lens.
    source_spectrum : str
        Light it is valid for.
    meter_scale : MeterScale
        The meter, its certificate or data sheet, and the error that is common to all luminances.
    responsivity : ResponsivityFit
        R.
    response : Response
        Linearisation h of the DN above dark.
    fit_errors : tuple of FitError
        Independent errors of R, h, the gains and the dark signal; see `labcdp.calibration.errors.common`.
    dark : DarkModel
        d(t, T) at the calibration's own gain, `state.gain_db`.
    noise : TemporalNoise
        Noise of a pixel at this gain.
    gains : tuple of GainSetting
        The other gains it is valid for too; empty for one gain.
    vignetting : AnyVignetting or None
        V, None for 1.
    defects : DefectMap or None
        Pixels that must not be used.
    dark_library : DarkLibrary or None
        Dark pattern to subtract from each frame.
    range_cd_m2 : (float, float)
        Lowest and highest luminance of the patches.
    range_net_dn : (float, float)
        Lowest and highest DN above dark of the fit.
    exposures_s : tuple of float
        Exposures that were used, ascending.
    residuals : tuple of PatchResidual
        One row for each patch of the fit.
    held_out : tuple of PatchResidual
        Held-out patches.
    left_out : tuple of LeftOut
        Data not used by the fit, with reasons.
    ladder : tuple of ModelStep
        Candidate models.
    tests : tuple of FitTest
        Checks of the model's assumptions.
    findings : tuple of Finding
        Findings for the user.
    provenance : Provenance
        Provenance.

    measured_spectrum : SpectralTable or None
        Spectral power of that light, if measured.

    Raises
    ------
    InputError
        If the responsivity is not positive, the range not ascending, or there is no exposure or residual.
    """

    state: CameraState
    lens: LensIdentity
    source_spectrum: str
    meter_scale: MeterScale
    responsivity: ResponsivityFit
    response: Response
    fit_errors: tuple[FitError, ...]
    dark: DarkModel
    noise: TemporalNoise
    gains: tuple[GainSetting, ...]
    vignetting: AnyVignetting | None
    defects: DefectMap | None
    dark_library: DarkLibrary | None
    range_cd_m2: tuple[float, float]
    range_net_dn: tuple[float, float]
    exposures_s: tuple[float, ...]
    residuals: tuple[PatchResidual, ...]
    held_out: tuple[PatchResidual, ...]
    left_out: tuple[LeftOut, ...]
    ladder: tuple[ModelStep, ...]
    tests: tuple[FitTest, ...]
    findings: tuple[Finding, ...]
    provenance: Provenance
    measured_spectrum: SpectralTable | None = None

    def __post_init__(self) -> None:
        low, high = self.range_cd_m2
        if not 0 < low <= high < float("inf"):
            raise InputError(f"range_cd_m2 is {low:g} to {high:g}: give two positive luminances, the lower first")
        if not self.exposures_s or not self.residuals:
            raise InputError("a calibration has at least one exposure in exposures_s and one row in residuals")
        responsivity = self.responsivity.responsivity_dn_s_cd_m2
        if not (isfinite(responsivity) and responsivity > 0):
            raise InputError(f"responsivity_dn_s_cd_m2 is {responsivity}: a camera that sees light has a positive one")

    @property
    def planes(self) -> tuple[Calibration, ...]:
        """Itself, as the one plane of a monochrome sensor."""
        return (self,)

    @property
    def weights(self) -> tuple[float, ...]:
        """Weight of that plane in the luminance."""
        return (1.0,)

    @property
    def light(self) -> Source:
        """The spectrum it is valid for as measured, else its name."""
        return self.source_spectrum if self.measured_spectrum is None else self.measured_spectrum

    @property
    def responsivity_common_rel(self) -> float:
        """Relative standard uncertainty of R: meter scale and fit."""
        return hypot(self.meter_scale.common_rel, self.responsivity.random_rel)

    @property
    def settings(self) -> tuple[GainSetting, ...]:
        """Every calibrated gain, the calibration's own first, with factor 1."""
        return (GainSetting(self.state.gain_db, 1.0, 0.0, self.dark, self.noise), *self.gains)

    def setting(self, gain_db: float) -> GainSetting:
        """Return the properties of a gain; raises CalibrationError, naming the calibrated ones, for another."""
        settings = self.settings
        return settings[index_of_gain(settings, gain_db)]

    def require(self, state: CameraState, theirs: str) -> None:
        """Refuse a camera state that this calibration is not valid for.

        Parameters
        ----------
        state : CameraState
            The state to check.
        theirs : str
            Name of the state in messages.

        Raises
        ------
        CalibrationError
            If it is another camera or setting, or a gain that was not calibrated.
        """
        # A frame need not know that the pixels are full below the end of its scale.
        saturation_dn = min(state.saturation_dn, self.state.saturation_dn)
        theirs_below = replace(state, saturation_dn=saturation_dn)
        self.state.require(theirs_below, "the calibration", theirs, [gain.gain_db for gain in self.gains])

    def luminance_cd_m2(
        self, net_dn: ArrayLike, exposure_s: float, gain_db: float | None = None
    ) -> NDArray[np.float64]:
        """L V = h(n) / (R t) of pixels with a DN n above dark, any shape; V is not removed.

        Raises
        ------
        CalibrationError
            If the gain was not calibrated.
        """
        factor = 1.0 if gain_db is None else self.setting(gain_db).factor
        return self.response.linearise(net_dn) / (self.responsivity.responsivity_dn_s_cd_m2 * factor * exposure_s)

    def dark_spread_cd_m2(self, frame: Frame) -> float:
        """Return what dark signal non-uniformity and drift of the black level make of a dark pixel's luminance."""
        setting = self.setting(frame.gain_db)
        dn = hypot(setting.dark.pattern_dn(frame.exposure_s), setting.dark.drift_dn)
        scale = self.responsivity.responsivity_dn_s_cd_m2 * setting.factor * frame.exposure_s
        return dn * float(self.response.slope(0.0)) / scale

    def to_luminance(self, frame: Frame, window: Window = WHOLE) -> LuminanceMap:
        """Convert a frame, or a window of it, to luminance.

        An exposure outside the calibrated ones is logged; a luminance outside the calibrated range is flagged.

        Raises
        ------
        CalibrationError
            As `require`.
        """
        from .convert.conversion import to_luminance

        return to_luminance(self, frame, window=window)
