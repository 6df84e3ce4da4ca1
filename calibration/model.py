"""Calibration: the fitted conversion from DN to cd/m^2, with all that is needed to use and judge it."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from datetime import datetime
from math import hypot, isfinite, sqrt

from ..errors import InputError
from ..frame import Frame
from ..luminance import Cos4Vignetting, LinearConversion, LuminanceMap
from .dark import DarkModel
from .noise import TemporalNoise
from .observations import CameraState
from .readings import MeterScale

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class LensIdentity:
    """The lens on the camera.

    Parameters
    ----------
    model, serial : str
        As engraved; the serial number may be empty.
    focal_length_m : float
        Focal length.
    f_number : float
        The f-number set; the responsivity goes with its inverse square.

    Raises
    ------
    InputError
        If a number is not positive.
    """

    model: str
    serial: str
    focal_length_m: float
    f_number: float

    def __post_init__(self) -> None:
        for name in ("focal_length_m", "f_number"):
            value = getattr(self, name)
            if not (isfinite(value) and value > 0):
                raise InputError(f"{name} of the lens is {value}: give a positive number")


@dataclass(frozen=True)
class Setup:
    """What neither frames nor readings say about a calibration.

    Parameters
    ----------
    lens : LensIdentity
        The lens.
    source_spectrum : str
        Light of the patches, for example ``LED-B4``. A camera without a V(lambda) filter is calibrated for this
        spectrum only.
    input_sha256 : str
        Hash of the frames and readings, as the caller keeps them.
    """

    lens: LensIdentity
    source_spectrum: str
    input_sha256: str


@dataclass(frozen=True)
class ResponsivityFit:
    """Fit of the responsivity, and what tells whether it is any good.

    Parameters
    ----------
    responsivity_dn_s_cd_m2 : float
        R, DN per second and cd/m^2 on the optical axis (DN s^-1 / (cd m^-2)).
    random_rel : float
        Relative standard uncertainty of R without the meter's scale, widened if `chi_squared` is improbable.
    chi_squared : float
        Sum of squared standardised residuals, correlations respected.
    degrees_of_freedom : int
        Patches less one.
    intercept_dn_s, intercept_standard_uncertainty_dn_s : float or None
        Free intercept, fitted as a test only; None if all patches have about the same luminance.
    """

    responsivity_dn_s_cd_m2: float
    random_rel: float
    chi_squared: float
    degrees_of_freedom: int
    intercept_dn_s: float | None
    intercept_standard_uncertainty_dn_s: float | None

    @property
    def reduced_chi_squared(self) -> float:
        """chi^2 over its degrees of freedom; about 1 if the stated errors are right."""
        return self.chi_squared / self.degrees_of_freedom


@dataclass(frozen=True)
class PatchResidual:
    """One row of the residual table.

    Parameters
    ----------
    patch : str
        Name of the patch.
    reading_cd_m2, reading_random_cd_m2 : float
        By the meter: mean of the readings, and its standard uncertainty without the scale.
    n_readings : int
        How many readings.
    luminance_cd_m2 : float
        By the calibrated camera.
    residual_rel : float
        Camera over meter, less one.
    standardised_residual : float
        Residual over its standard deviation by the stated errors.
    exposures_s : tuple of float
        Exposures that were used.
    """

    patch: str
    reading_cd_m2: float
    reading_random_cd_m2: float
    n_readings: int
    luminance_cd_m2: float
    residual_rel: float
    standardised_residual: float
    exposures_s: tuple[float, ...]


@dataclass(frozen=True)
class Provenance:
    """Where a calibration comes from.

    Parameters
    ----------
    measured : datetime
        Time of the last meter reading, with time zone; the age of the calibration counts from here.
    input_sha256 : str
        Hash of frames and readings given by the caller.
    versions : dict of str to str
        Versions of the programs that computed it.
    """

    measured: datetime
    input_sha256: str
    versions: dict[str, str]


@dataclass(frozen=True)
class Calibration:
    """DN to cd/m^2 for one camera, setting and lens: DN = d(t) + R t V(x, y) L.

    Parameters
    ----------
    state : CameraState
        Camera, pixel format, bit depth, image size and gain it is valid for.
    lens : LensIdentity
        The lens.
    source_spectrum : str
        Light it is valid for.
    meter_scale : MeterScale
        The meter, and the half width of its scale error, common to all luminances.
    responsivity : ResponsivityFit
        R.
    dark : DarkModel
        d(t).
    noise : TemporalNoise
        Noise of a pixel.
    vignetting : Cos4Vignetting or None
        V, None for 1.
    range_cd_m2 : (float, float)
        Lowest and highest luminance of the patches.
    exposures_s : tuple of float
        Exposures that were used, ascending.
    residuals : tuple of PatchResidual
        One row for each patch of the fit.
    warnings : tuple of str
        What the user should know.
    provenance : Provenance
        Where it comes from.

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
    dark: DarkModel
    noise: TemporalNoise
    vignetting: Cos4Vignetting | None
    range_cd_m2: tuple[float, float]
    exposures_s: tuple[float, ...]
    residuals: tuple[PatchResidual, ...]
    warnings: tuple[str, ...]
    provenance: Provenance

    def __post_init__(self) -> None:
        low, high = self.range_cd_m2
        if not 0 < low <= high < float("inf"):
            raise InputError(f"range_cd_m2 is {low:g} to {high:g}: give two positive luminances, the lower first")
        if not self.exposures_s or not self.residuals:
            raise InputError("a calibration has at least one exposure in exposures_s and one row in residuals")
        _ = self.conversion  # checks the responsivity

    @property
    def responsivity_common_rel(self) -> float:
        """Relative standard uncertainty shared by all luminances: meter scale and fit."""
        return hypot(self.meter_scale.half_width_rel / sqrt(3), self.responsivity.random_rel)

    @property
    def conversion(self) -> LinearConversion:
        """The conversion without the checks of `to_luminance`."""
        return LinearConversion(
            responsivity_dn_s_cd_m2=self.responsivity.responsivity_dn_s_cd_m2,
            responsivity_common_rel=self.responsivity_common_rel,
            dark_offset_dn=self.dark.offset_dn,
            dark_rate_dn_s=self.dark.rate_dn_s,
            k_dn_per_e=self.noise.k_dn_per_e,
            dark_noise_dn=self.noise.dark_noise_dn,
            vignetting=self.vignetting,
            gain_db=self.state.gain_db,
            range_cd_m2=self.range_cd_m2,
        )

    def to_luminance(self, frame: Frame) -> LuminanceMap:
        """Convert a frame to luminance.

        An exposure outside the calibrated ones is logged as a warning; a luminance outside the calibrated range is
        flagged in the map.

        Raises
        ------
        CalibrationError
            If the frame is of another camera, gain, pixel format, bit depth, saturation or image size.
        """
        self.state.require(CameraState.of(frame), "the calibration", f"frame {frame.frame_id}")
        low, high = self.exposures_s[0], self.exposures_s[-1]
        if not low * (1 - 1e-6) <= frame.exposure_s <= high * (1 + 1e-6):
            _log.warning(
                "frame %d has an exposure of %g s, the calibration was made at %g to %g s",
                frame.frame_id,
                frame.exposure_s,
                low,
                high,
            )
        return self.conversion.to_luminance(frame)
