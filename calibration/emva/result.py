"""What a characterisation after EMVA 1288 says: each quantity with its standard uncertainty, and what to mind."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from math import hypot, isfinite, sqrt
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..rounding import ROUNDING_DN2, variance_before_rounding

#: What ends the linear range: the converter's last DN, a full pixel, or neither was seen.
SaturationLimit = Literal["converter", "full well", "not reached"]


@dataclass(frozen=True)
class Quantity:
    """A measured value.

    Parameters
    ----------
    value : float
        In `unit`.
    standard_uncertainty : float
        Of the value, in `unit` (JCGM 100:2008); nan where it is not known.
    unit : str
        For example ``DN/e-``; ``1`` for fractions.
    note : str
        How it was found, or what limits it; may be empty.
    """

    value: float
    standard_uncertainty: float
    unit: str
    note: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Values JSON can hold; None for what is not finite."""
        return {
            "value": self.value if isfinite(self.value) else None,
            "standard_uncertainty": self.standard_uncertainty if isfinite(self.standard_uncertainty) else None,
            "unit": self.unit,
            "note": self.note,
        }


@dataclass(frozen=True)
class SeriesPoint:
    """One point of a photon or exposure series: light and darkness at one exposure.

    Parameters
    ----------
    label : str
        Patch of a session; empty for a data set.
    exposure_s : float
        Exposure time.
    photons : float or None
        Mean photons a pixel received; None if not known.
    mean_dn, variance_dn2 : float
        Mean, and temporal variance of one pixel, in the light.
    dark_mean_dn, dark_variance_dn2 : float
        The same in darkness at this exposure.
    n_pixels, n_frames : int
        How many pixels and frames the light's values rest on.
    dark_n_pixels, dark_n_frames : int
        The same of the darkness.
    saturated_share, dark_black_share : float
        Share of the light's values at the converter's last DN, and of the darkness' values at DN 0.
    """

    label: str
    exposure_s: float
    photons: float | None
    mean_dn: float
    variance_dn2: float
    dark_mean_dn: float
    dark_variance_dn2: float
    n_pixels: int
    n_frames: int
    dark_n_pixels: int
    dark_n_frames: int
    saturated_share: float
    dark_black_share: float

    @property
    def net_dn(self) -> float:
        """Mean above darkness."""
        return self.mean_dn - self.dark_mean_dn

    @property
    def net_variance_dn2(self) -> float:
        """Temporal variance above that of darkness."""
        return self.variance_dn2 - self.dark_variance_dn2

    @property
    def variance_uncertainty_dn2(self) -> float:
        """Standard uncertainty of `net_variance_dn2`: the variance of a normal variance is 2 s^4 / freedom."""
        light = 2 * self.variance_dn2**2 / max((self.n_pixels - 1) * (self.n_frames - 1), 1)
        dark = 2 * self.dark_variance_dn2**2 / max((self.dark_n_pixels - 1) * (self.dark_n_frames - 1), 1)
        return sqrt(light + dark)

    @property
    def net_uncertainty_dn(self) -> float:
        """Standard uncertainty of `net_dn` by temporal noise, with 1/12 DN^2 of rounding as the least noise."""
        light = max(self.variance_dn2, ROUNDING_DN2) / (self.n_pixels * self.n_frames)
        dark = max(self.dark_variance_dn2, ROUNDING_DN2) / (self.dark_n_pixels * self.dark_n_frames)
        return sqrt(light + dark)


@dataclass(frozen=True)
class DarkPoint:
    """Darkness at one exposure.

    Parameters
    ----------
    exposure_s : float
        Exposure time.
    mean_dn, variance_dn2 : float
        Mean, and temporal variance of one pixel.
    n_pixels, n_frames : int
        How many were averaged.
    temperature_c : float or None
        Of the sensor, if known.
    spatial_variance_dn2 : float
        Variance of the pixels' means.
    """

    exposure_s: float
    mean_dn: float
    variance_dn2: float
    n_pixels: int
    n_frames: int
    temperature_c: float | None = None
    spatial_variance_dn2: float = 0.0

    @property
    def mean_uncertainty_dn(self) -> float:
        """By temporal noise, with 1/12 DN^2 of rounding as the least."""
        return sqrt(max(self.variance_dn2, ROUNDING_DN2) / (self.n_pixels * self.n_frames))

    @property
    def variance_uncertainty_dn2(self) -> float:
        """Of a normal variance, with that of rounding as the least; and by how much rounding may have changed it."""
        freedom = max((self.n_pixels - 1) * (self.n_frames - 1), 1)
        by_chance = max(self.variance_dn2, ROUNDING_DN2) * sqrt(2 / freedom)
        by_rounding = variance_before_rounding(self.variance_dn2).error_of(self.variance_dn2 - ROUNDING_DN2)
        return hypot(by_chance, by_rounding)


@dataclass(frozen=True, eq=False)
class SpatialImages:
    """Mean images, for histograms and profiles.

    Parameters
    ----------
    dark_dn : ndarray of float32, shape (height, width)
        Mean of the dark frames.
    bright_dn : ndarray of float32, shape (height, width), or None
        Mean of frames of a uniform light at about half of saturation; None without any.
    dark_frames, bright_frames : int
        How many were averaged.
    dark_variance_dn2, bright_variance_dn2 : float
        Temporal variance of one pixel in one frame.
    """

    dark_dn: NDArray[np.float32]
    bright_dn: NDArray[np.float32] | None
    dark_frames: int
    bright_frames: int
    dark_variance_dn2: float
    bright_variance_dn2: float


@dataclass(frozen=True, eq=False)
class Characterisation:
    """A camera after EMVA 1288, linear model. Quantities that could not be measured are None.

    Parameters
    ----------
    source : str
        Data set or session.
    camera : str
        Which camera; empty if it is not known.
    simulated : bool
        Whether the camera is simulated.
    definition : str
        Release of the standard whose definitions were used.
    bits : int
        Bits of the DN scale.
    image_shape : (int, int)
        Height and width in pixels.
    gain_db : float or None
        Gain of the camera, to which K belongs; None if it is not known.
    temperature_c : float or None
        Mean temperature of the dark frames, to which the dark current belongs; None if it is not known.
    black_level_dn : Quantity
        Mean DN of darkness at zero exposure.
    k_dn_per_e : Quantity
        Overall system gain K.
    responsivity : Quantity or None
        R in DN per photon, or for a session in DN / (cd m^-2 s) on the optical axis; None if neither is known.
    quantum_efficiency : Quantity or None
        Electrons per photon, as a fraction; for a session an estimate from lens data, as its note says.
    dark_noise_dn : Quantity
        Temporal noise at zero exposure, rounding included.
    dark_noise_e : Quantity
        sigma_d, the same in electrons without the noise of rounding: the read noise.
    dark_current_e_s : Quantity or None
        By the slope of the mean over the exposure, at `temperature_c`.
    dark_current_by_variance_e_s : Quantity or None
        By the slope of the variance.
    doubling_temperature_c : Quantity or None
        Difference of temperature, in kelvin, that doubles the dark current.
    dsnu_e : Quantity or None
        DSNU_1288, all pixels.
    dsnu_pixel_e, dsnu_column_e, dsnu_row_e : Quantity or None
        Its parts (Release 4.0).
    dsnu_e_s : Quantity or None
        Standard deviation of the pixels' dark currents.
    prnu_rel : Quantity or None
        PRNU_1288 as a fraction, all pixels.
    prnu_pixel_rel, prnu_column_rel, prnu_row_rel : Quantity or None
        Its parts (Release 4.0).
    saturation_limit : {'converter', 'full well', 'not reached'}
        What ended the linear range. For 'converter' and 'not reached' the true full well is larger.
    saturation_dn : Quantity
        Mean DN above darkness at saturation, where the temporal variance is largest.
    saturation_photons : Quantity or None
        Photons at saturation.
    full_well_e : Quantity
        Saturation capacity mu_e.sat of the standard, in electrons. For a photon series it is the signal of the largest
        temporal variance, which lies several times the noise below the pixel's full well; for a session that of
        patches that are saturated altogether. A lower limit of the full well unless `saturation_limit` is 'full well'.
    linearity_error_min_rel, linearity_error_max_rel : Quantity or None
        Lowest and highest relative deviation from the line (Release 3.1), as fractions.
    linearity_error_rel : Quantity or None
        Mean of the absolute deviations (Release 4.0).
    snr_max : Quantity
        Ratio at saturation.
    sensitivity_threshold_e : Quantity
        Absolute sensitivity threshold mu_e.min, the signal at which SNR is 1.
    sensitivity_threshold_photons : Quantity or None
        The same in photons.
    dynamic_range : Quantity
        Saturation over threshold, as a ratio.
    series : tuple of SeriesPoint
        The points everything but darkness and non-uniformity rests on, in rising order of stimulus or signal.
    darks : tuple of DarkPoint
        Darkness over the exposure.
    spatial : SpatialImages or None
        Mean images; not part of `to_dict`.
    flags : tuple of str
        What is impossible or suspicious, in plain words with what to do.
    """

    source: str
    camera: str
    simulated: bool
    definition: str
    bits: int
    image_shape: tuple[int, int]
    gain_db: float | None
    temperature_c: float | None
    black_level_dn: Quantity
    k_dn_per_e: Quantity
    responsivity: Quantity | None
    quantum_efficiency: Quantity | None
    dark_noise_dn: Quantity
    dark_noise_e: Quantity
    dark_current_e_s: Quantity | None
    dark_current_by_variance_e_s: Quantity | None
    doubling_temperature_c: Quantity | None
    dsnu_e: Quantity | None
    dsnu_pixel_e: Quantity | None
    dsnu_column_e: Quantity | None
    dsnu_row_e: Quantity | None
    dsnu_e_s: Quantity | None
    prnu_rel: Quantity | None
    prnu_pixel_rel: Quantity | None
    prnu_column_rel: Quantity | None
    prnu_row_rel: Quantity | None
    saturation_limit: SaturationLimit
    saturation_dn: Quantity
    saturation_photons: Quantity | None
    full_well_e: Quantity
    linearity_error_min_rel: Quantity | None
    linearity_error_max_rel: Quantity | None
    linearity_error_rel: Quantity | None
    snr_max: Quantity
    sensitivity_threshold_e: Quantity
    sensitivity_threshold_photons: Quantity | None
    dynamic_range: Quantity
    series: tuple[SeriesPoint, ...]
    darks: tuple[DarkPoint, ...]
    spatial: SpatialImages | None
    flags: tuple[str, ...]

    def quantities(self) -> dict[str, Quantity | None]:
        """All quantities by name, in the order of the fields."""
        names = [field.name for field in fields(self) if "Quantity" in str(field.type)]
        return {name: getattr(self, name) for name in names}

    def to_dict(self) -> dict[str, Any]:
        """Values JSON can hold."""
        values: dict[str, Any] = {}
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, Quantity):
                value = value.to_dict()
            elif field.name in ("series", "darks"):
                value = [asdict(point) for point in value]
            elif field.name == "spatial":
                continue
            elif isinstance(value, tuple):
                value = list(value)
            values[field.name] = value
        return values
