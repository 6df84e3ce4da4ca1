"""Quantities of EMVA 1288 by dark signal and non-uniformity: dark current, read noise, SNR, DSNU and PRNU."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import copysign, hypot, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.quantity import Quantity
from ..frames.measure import MeasuredFrames
from ..frames.nonuniformity import SpatialVariance, spatial_variance
from ..frames.observations import DarkObservation
from ..frames.rounding import ROUNDING_DN2, Range, variance_before_rounding
from ..frames.statistics import LineVariances
from ..sensor.dark import DarkModel, fit_dark
from ..sensor.dark_fit import Line, line, variance_uncertainties_dn2

#: Variance of the dark signal, in DN^2, below which rounding dominates (EMVA 1288 Release 4.0 Linear: sigma < 0.5 DN).
LEAST_VARIANCE_DN2 = 0.24
#: Parts of a spatial variance.
PARTS = ("pixel", "column", "row")


@dataclass(frozen=True)
class DarkFit:
    """Mean and variance of the dark signal over the exposure.

    Parameters
    ----------
    model : DarkModel
        The mean: noise, rounding and drift of the black level are in its covariance.
    variance : Line
        Temporal variance in DN^2; the slope may be below 0.
    """

    model: DarkModel
    variance: Line

    @property
    def black_level_dn(self) -> Quantity:
        """mu_y.dark at zero exposure, or at the only one."""
        several = len(self.model.exposures_s) > 1
        exposure_s = 0.0 if several else self.model.exposures_s[0]
        note = "at zero exposure" if several else "at the only exposure of the dark frames"
        return Quantity(self.model.mean_dn(exposure_s), sqrt(self.model.variance_dn2(exposure_s)), "DN", note)

    def quantities(self, k: Quantity) -> dict[str, Quantity | None]:
        """Return black level, noise and dark current by the attributes of a characterisation.

        The read noise is without rounding, sqrt(sigma_y.dark^2 - 1/12) / K (Release 4.0 Linear). Its uncertainty
        includes rounding: all noise compatible with this variance is equally likely.
        """
        dark, model, variance = self._noise_dn(), self.model, self.variance
        unrounded = sqrt(dark.value**2 - ROUNDING_DN2)
        by_noise = dark.value * dark.u / unrounded
        by_rounding = variance_before_rounding(variance.intercept).root().error_of(unrounded)
        noise = Quantity(unrounded, max(by_noise, by_rounding), "DN")
        rate = Quantity(model.rate_dn_s, sqrt(model.rate_variance_dn2_s2), "DN/s")
        growth = Quantity(variance.slope, sqrt(variance.covariance[1, 1]), "DN^2/s")
        by_mean, by_variance = "slope of the mean over the exposure", "slope of the variance over the exposure"
        several = len(model.exposures_s) > 1
        return {
            "black_level_dn": self.black_level_dn,
            "dark_noise_dn": dark,
            "dark_noise_e": noise.over(k, "e-", f"{dark.note}, without rounding"),
            "dark_current_e_s": rate.over(k, "e-/s", by_mean) if several else None,
            "dark_current_by_variance_e_s": growth.over(k, "e-/s", by_variance, power=2) if several else None,
        }

    def doubling_temperature_c(self) -> Quantity | None:
        """T_d; None if the dark frames do not determine it."""
        doubling_c, temperatures = self.model.doubling_temperature_c, self.model.temperatures_c
        if doubling_c is None:
            return None
        uncertainty = doubling_c**2 * sqrt(self.model.covariance[2][2])
        span = f"{temperatures[0]:.1f} to {temperatures[-1]:.1f} °C"
        return Quantity(doubling_c, uncertainty, "K", f"from dark frames at {span}")

    def _noise_dn(self) -> Quantity:
        """sigma_y.dark at zero exposure, at least that of rounding."""
        variance, note = max(self.variance.intercept, LEAST_VARIANCE_DN2), self.black_level_dn.note
        if self.variance.intercept < LEAST_VARIANCE_DN2:
            note = "an upper limit: below 0.49 DN rounding hides the noise, this is the least value the standard allows"
        return Quantity(sqrt(variance), sqrt(self.variance.covariance[0, 0]) / (2 * sqrt(variance)), "DN", note)


def fit_dark_current(darks: Sequence[DarkObservation]) -> DarkFit:
    """Fit mean and variance of the dark signal over the exposure.

    Parameters
    ----------
    darks : sequence of DarkObservation
        At least one.
    """
    t, variance = (np.array([getattr(d, name) for d in darks]) for name in ("exposure_s", "temporal_variance_dn2"))
    return DarkFit(fit_dark(darks)[0], line(t, variance, variance_uncertainties_dn2(darks)))


def snr(
    signal_e: NDArray[np.floating[Any]], dark_noise_e: float, k_dn_per_e: float, dsnu_e: float = 0.0, prnu: float = 0.0
) -> NDArray[np.float64]:
    """SNR over the signal, mean over standard deviation of one pixel.

    mu_e / sqrt(sigma_d^2 + sigma_q^2 / K^2 + mu_e) (EMVA 1288 Release 4.0 Linear); with DSNU and PRNU the total SNR of
    all pixels, mu_e / sqrt(sigma_d^2 + DSNU^2 + sigma_q^2 / K^2 + mu_e + PRNU^2 mu_e^2) (eq. 27).

    Parameters
    ----------
    signal_e : ndarray of float
        Mean photo-electrons.
    dark_noise_e, dsnu_e : float
        Electrons.
    k_dn_per_e : float
        Overall system gain.
    prnu : float
        A fraction.
    """
    noise = dark_noise_e**2 + dsnu_e**2 + ROUNDING_DN2 / k_dn_per_e**2
    return signal_e / np.sqrt(noise + signal_e + (prnu * signal_e) ** 2)


def sensitivity_threshold_e(dark_noise_dn: Quantity, k: Quantity) -> Quantity:
    """Signal at which SNR is 1: mu_e.min = sigma_y.dark / K + 1/2 (EMVA 1288 Release 4.0 Linear)."""
    noise = dark_noise_dn.over(k, "e-")
    return replace(noise, value=noise.value + 0.5)


def snr_max(full_well_e: Quantity, note: str = "") -> Quantity:
    """SNR at saturation: sqrt(mu_e.sat) (EMVA 1288 Release 4.0 Linear)."""
    value = sqrt(full_well_e.value)
    return Quantity(value, full_well_e.u / (2 * value), "1", note)


def dsnu_e(variance: Quantity, k: Quantity, rounding_e: float, note: str = "", unit: str = "e-") -> Quantity:
    """DSNU in electrons: sqrt(s_dark^2) / K (EMVA 1288 Release 4.0 Linear), with its uncertainty by rounding too."""
    in_dn = spread(variance, 1.0, "DN", note)
    in_e = in_dn.over(k, unit, in_dn.note)
    return replace(in_e, u=hypot(in_e.u, rounding_e))


def dsnu_parts(variance: SpatialVariance, k: Quantity, dark: MeasuredFrames, note: str) -> dict[str, Quantity]:
    """DSNU_1288 and its parts, their uncertainties widened by rounding, where the dark noise is below about a DN.

    Parameters
    ----------
    variance : SpatialVariance
        Of the dark image.
    k : Quantity
        Overall system gain.
    dark : MeasuredFrames
        Dark frames, as rounded.
    note : str
        Of the total.
    """
    rounding_e = rounding_of_spread_dn(dark) / k.value
    whole = dsnu_e(variance.total, k, rounding_e, note)
    parts = {"dsnu_e": whole}
    for name in PARTS:
        part: Quantity = getattr(variance, name)
        share = abs(spread(part, k.value).value / whole.value) if whole.value else 1.0
        parts[f"dsnu_{name}_e"] = dsnu_e(part, k, rounding_e * share)
    return parts


def rounding_of_spread_dn(dark: MeasuredFrames) -> float:
    """Return the standard uncertainty by rounding of the standard deviation of the pattern of dark frames."""
    temporal_dn2, spatial_dn2 = dark.temporal_variance_dn2, dark.spatial_variance_dn2
    together, alone = variance_before_rounding(temporal_dn2 + spatial_dn2), variance_before_rounding(temporal_dn2)
    left = Range(max(together.least - alone.largest, 0.0), max(together.largest - alone.least, 0.0)).root()
    return left.error_of(sqrt(spatial_dn2))


def prnu_parts(bright: SpatialVariance, dark: SpatialVariance, net_dn: float, note: str) -> dict[str, Quantity]:
    """PRNU_1288 as a fraction, sqrt(s_y^2 - s_y.dark^2) / (mu_y - mu_y.dark) (Release 4.0 Linear), and its parts.

    The note is that of the total.
    """
    parts = {f"prnu_{name}_rel": spread(getattr(bright, name) - getattr(dark, name), net_dn, "1") for name in PARTS}
    return {"prnu_rel": spread(bright.total - dark.total, net_dn, "1", note), **parts}


def spatial_variance_of(frames: MeasuredFrames) -> SpatialVariance:
    """Spatial variance of the mean of frames."""
    return spatial_variance(frames.image_dn, frames.temporal.scaled(1 / frames.n_frames))


def spread(variance: Quantity, per: float, unit: str = "", note: str = "") -> Quantity:
    """Root of a variance with its sign, over `per`; where that is not significant, u is the root of its uncertainty."""
    root, u = copysign(sqrt(abs(variance.value)), variance.value), variance.u
    u_root = sqrt(u) if abs(variance.value) <= u else u / (2 * abs(root))
    if variance.value <= u:
        why = "not more than temporal noise leaves"
        if variance.value < 0:
            why = "less than temporal noise leaves: minus the root of a variance below 0"
        note = f"{note}, {why}" if note else why
    return Quantity(root / per, u_root / per, unit, note)


def dark_pattern_variances(
    frames: Sequence[MeasuredFrames], exposures_s: Sequence[float]
) -> tuple[SpatialVariance, ...]:
    """Spatial variances of the dark signal at zero exposure, in DN^2, and of its growth, in (DN/s)^2.

    Each pixel's dark signal is fitted by a line over the exposure, all exposures alike.

    Parameters
    ----------
    frames : sequence of MeasuredFrames
        Dark frames for each exposure. Of one exposure only, its own variance is the first and only one.
    exposures_s : sequence of float
        Exposure times.
    """
    t = np.array(exposures_s)
    design = np.column_stack([np.ones_like(t), t])[:, : t.size]
    variances = []
    for weights in np.linalg.pinv(design):
        image, noise = np.zeros(frames[0].shape), np.zeros(3)
        for weight, at_exposure in zip(weights, frames, strict=True):
            image += weight * at_exposure.image_dn
            temporal = at_exposure.temporal
            noise += weight**2 / at_exposure.n_frames * np.array([temporal.pixel, temporal.column, temporal.row])
        variances.append(spatial_variance(image, LineVariances(*noise.tolist())))
    return tuple(variances)


def flat_variance(
    values: NDArray[np.floating[Any]],
    rows: NDArray[np.integer[Any]],
    columns: NDArray[np.integer[Any]],
    noise_dn2: float,
) -> Quantity:
    """Variance from pixel to pixel of a patch, its slow gradients subtracted.

    A surface of second order in row and column is fitted and removed; it removes vignetting and non-uniform light, but
    only 6 degrees of freedom.

    Parameters
    ----------
    values : ndarray of float, shape (n,)
        Mean of the patch's pixels, n above 6.
    rows, columns : ndarray of int, shape (n,)
        Their places.
    noise_dn2 : float
        Contribution of temporal noise to a value.

    Returns
    -------
    Quantity
        May be below 0.
    """
    y, x = (2 * (position - position.min()) / max(np.ptp(position), 1) - 1 for position in (rows, columns))
    surface = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    fitted, *_ = np.linalg.lstsq(surface, values)
    dof = values.size - surface.shape[1]
    measured = float(np.sum((values - surface @ fitted) ** 2)) / dof
    return Quantity(measured - noise_dn2, measured * sqrt(2 / dof))


def combined(estimates: Sequence[Quantity]) -> Quantity:
    """Mean of independent estimates, weighted with the inverse squares of their uncertainties."""
    weights = [1 / estimate.u**2 for estimate in estimates]
    value = sum(weight * estimate.value for weight, estimate in zip(weights, estimates, strict=True))
    return Quantity(value / sum(weights), 1 / sqrt(sum(weights)))
