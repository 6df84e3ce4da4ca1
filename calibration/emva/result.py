"""Result of a characterisation after EMVA 1288: quantities with standard uncertainty, and findings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from math import sqrt
from operator import attrgetter
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...core.quantity import Quantity
from ...core.result import Finding
from ..frames.measure import MeasuredFrames
from ..frames.observations import DarkObservation
from ..frames.statistics import Level
from .general import GeneralModel


@dataclass(frozen=True)
class SeriesPoint:
    """One point of a photon or exposure series: light and dark signal at one exposure.

    Parameters
    ----------
    label : str
        Patch of a session; empty for a data set.
    exposure_s : float
        Exposure time.
    photons : float or None
        Mean photons a pixel received; None if not known.
    light, dark : Level
        With light, and without.
    frames_variance_dn2 : float
        Variance of the signal above dark by what changes from frame to frame: black level and lamp.
    """

    label: str
    exposure_s: float
    photons: float | None
    light: Level
    dark: Level
    frames_variance_dn2: float = 0.0

    @property
    def stimulus(self) -> float:
        """Photons, or the exposure in seconds where they are not known."""
        return self.exposure_s if self.photons is None else self.photons

    @property
    def net_dn(self) -> float:
        """Mean above dark signal."""
        return self.light.mean_dn - self.dark.mean_dn

    @property
    def net_variance_dn2(self) -> float:
        """Temporal variance above that of dark signal."""
        return self.light.temporal_variance_dn2 - self.dark.temporal_variance_dn2

    @property
    def variance_uncertainty_dn2(self) -> float:
        """Standard uncertainty of `net_variance_dn2`: the variance of a normal variance is 2 s^4 / dof."""
        return sqrt(sum(2 * level.temporal_variance_dn2**2 / level.dof for level in (self.light, self.dark)))

    @property
    def net_uncertainty_dn(self) -> float:
        """Standard uncertainty of `net_dn` by temporal noise, black level and lamp."""
        return sqrt(self.light.mean_variance_dn2 + self.dark.mean_variance_dn2 + self.frames_variance_dn2)


def columns(points: Sequence[object], *names: str) -> NDArray[np.float64]:
    """Values of points by the names of their attributes, which may be paths, one row for each name."""
    return np.array([[attrgetter(name)(point) for point in points] for name in names], dtype=np.float64)


#: Cause of saturation: the converter's last DN, a full pixel, or neither observed.
SaturationLimit = Literal["converter", "full well", "not reached"]


def _called(name: str) -> dict[str, str]:
    """Metadata of the field of a quantity: what it is called."""
    return {"name": name}


@dataclass(frozen=True, eq=False, kw_only=True)
class Characterisation:
    """A camera after EMVA 1288, linear model. Quantities that could not be measured are None.

    A variance of the non-uniformity that is below 0 by chance is stated as minus its root.

    Parameters
    ----------
    source : str
        Data set or session.
    camera : str
        Which camera; empty if it is not known.
    simulated : bool
        Whether the camera is simulated.
    bits : int
        Bits of the DN scale.
    image_shape : (int, int)
        Height and width in pixels.
    gain_db : float or None
        Gain of the camera, to which K belongs; None if it is not known.
    temperature_c : float or None
        Mean temperature of the dark frames, to which the dark current belongs; None if it is not known.
    definition : str
        Release of the standard whose definitions were used.
    k_dn_per_e : Quantity
        Overall system gain K.
    responsivity : Quantity or None
        R in DN per photon, or for a session in DN / (cd m^-2 s) on the optical axis.
    quantum_efficiency : Quantity or None
        Electrons per photon, as a fraction; for a session an estimate from lens data, as its note says.
    black_level_dn : Quantity
        mu_y.dark at zero exposure.
    dark_noise_dn : Quantity
        sigma_y.dark, temporal noise at zero exposure, rounding included.
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
        Its parts.
    dsnu_e_s : Quantity or None
        Standard deviation of the pixels' dark currents.
    prnu_rel : Quantity or None
        PRNU_1288 as a fraction, all pixels.
    prnu_pixel_rel, prnu_column_rel, prnu_row_rel : Quantity or None
        Its parts.
    saturation_dn : Quantity
        Mean DN above dark signal at saturation, where the temporal variance is largest.
    saturation_photons : Quantity or None
        Photons at saturation.
    full_well_e : Quantity
        Saturation capacity mu_e.sat of the standard, in electrons. For a photon series it is the signal of the largest
        temporal variance, which lies several times the noise below the pixel's full well; for a session that of patches
        that are completely saturated. A lower bound of the full well unless `saturation_limit` is 'full well'.
    linearity_error_min_rel, linearity_error_max_rel : Quantity or None
        Lowest and highest relative deviation from the line (Release 3.1), as fractions.
    linearity_error_rel : Quantity or None
        LE, mean of the absolute deviations.
    snr_max : Quantity
        Ratio at saturation.
    sensitivity_threshold_e : Quantity
        Absolute sensitivity threshold mu_e.min, the signal at which SNR is 1.
    sensitivity_threshold_photons : Quantity or None
        The same in photons.
    dynamic_range : Quantity
        DR, saturation over threshold, as a ratio.
    saturation_limit : {'converter', 'full well', 'not reached'}
        Cause of saturation. For 'converter' and 'not reached' the true full well is larger.
    spatial : tuple of MeasuredFrames
        Dark frames, and those of a uniform light at about half of saturation if there are any.
    series : tuple of SeriesPoint
        Points used for all but dark signal and non-uniformity, in increasing order of stimulus or signal.
    darks : tuple of DarkObservation
        Dark signal over the exposure.
    findings : tuple of Finding
        Findings on impossible or suspicious values.
    general : GeneralModel or None
        Characteristic curve and SNR at the input after Release 4.0 General; None without photons or luminances.
    """

    source: str
    camera: str = ""
    simulated: bool = False
    bits: int
    image_shape: tuple[int, int]
    gain_db: float | None = None
    temperature_c: float | None = None
    definition: str
    k_dn_per_e: Quantity = field(metadata=_called("overall system gain K"))
    responsivity: Quantity | None = field(default=None, metadata=_called("responsivity R"))
    quantum_efficiency: Quantity | None = field(default=None, metadata=_called("quantum efficiency η"))
    black_level_dn: Quantity = field(metadata=_called("dark signal µ_y.dark"))
    dark_noise_dn: Quantity = field(metadata=_called("temporal dark noise"))
    dark_noise_e: Quantity = field(metadata=_called("read noise, without rounding"))
    dark_current_e_s: Quantity | None = field(metadata=_called("dark current by the mean µ_I"))
    dark_current_by_variance_e_s: Quantity | None = field(metadata=_called("dark current by the variance µ_I"))
    doubling_temperature_c: Quantity | None = field(default=None, metadata=_called("doubling temperature T_d"))
    dsnu_e: Quantity | None = field(default=None, metadata=_called("DSNU1288"))
    dsnu_pixel_e: Quantity | None = field(default=None, metadata=_called("DSNU of pixels"))
    dsnu_column_e: Quantity | None = field(default=None, metadata=_called("DSNU of columns"))
    dsnu_row_e: Quantity | None = field(default=None, metadata=_called("DSNU of rows"))
    dsnu_e_s: Quantity | None = field(default=None, metadata=_called("spread of the dark current"))
    prnu_rel: Quantity | None = field(default=None, metadata=_called("PRNU1288"))
    prnu_pixel_rel: Quantity | None = field(default=None, metadata=_called("PRNU of pixels"))
    prnu_column_rel: Quantity | None = field(default=None, metadata=_called("PRNU of columns"))
    prnu_row_rel: Quantity | None = field(default=None, metadata=_called("PRNU of rows"))
    saturation_dn: Quantity = field(metadata=_called("saturation above the dark signal"))
    saturation_photons: Quantity | None = field(metadata=_called("saturation µ_p.sat"))
    full_well_e: Quantity = field(metadata=_called("saturation capacity µ_e.sat"))
    linearity_error_min_rel: Quantity | None = field(default=None, metadata=_called("linearity error, lowest LE_min"))
    linearity_error_max_rel: Quantity | None = field(default=None, metadata=_called("linearity error, highest LE_max"))
    linearity_error_rel: Quantity | None = field(default=None, metadata=_called("linearity error LE"))
    snr_max: Quantity = field(metadata=_called("largest SNR"))
    sensitivity_threshold_e: Quantity = field(metadata=_called("sensitivity threshold µ_e.min"))
    sensitivity_threshold_photons: Quantity | None = field(metadata=_called("sensitivity threshold µ_p.min"))
    dynamic_range: Quantity = field(metadata=_called("dynamic range DR"))
    saturation_limit: SaturationLimit
    spatial: tuple[MeasuredFrames, ...] = ()
    series: tuple[SeriesPoint, ...]
    darks: tuple[DarkObservation, ...]
    findings: tuple[Finding, ...]
    general: GeneralModel | None = None

    def quantities(self) -> dict[str, Quantity | None]:
        """All quantities by name, in the order of the standard."""
        return {name: getattr(self, name) for name in QUANTITY_NAMES}


#: What the quantities are called, by the attributes of `Characterisation`.
QUANTITY_NAMES: dict[str, str] = {
    field.name: field.metadata["name"] for field in fields(Characterisation) if field.metadata
}
