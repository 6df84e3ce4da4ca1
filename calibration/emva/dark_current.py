"""Dark signal, dark current and dark noise after EMVA 1288, by the dark model of the calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, sqrt

import numpy as np

from ..dark.lines import Line, line
from ..dark.signal import DarkModel, fit_dark
from ..dark.uncertainty import variance_uncertainties_dn2
from ..frames.observations import DarkObservation
from ..rounding import ROUNDING_DN2, variance_before_rounding
from .result import Quantity

#: Variance of the dark signal, in DN^2, below which rounding dominates (EMVA 1288 Release 4.0 Linear: sigma < 0.5 DN).
LEAST_VARIANCE_DN2 = 0.24


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

    def dark_signal_dn(self) -> Quantity:
        """mu_y.dark at zero exposure."""
        exposure_s = 0.0 if self._several else self.model.exposures_s[0]
        uncertainty = sqrt(self.model.variance_dn2(exposure_s))
        return Quantity(self.model.mean_dn(exposure_s), uncertainty, "DN", self._where)

    def noise_dn(self) -> Quantity:
        """sigma_y.dark at zero exposure, at least that of rounding."""
        sigma, note = sqrt(max(self.variance.intercept, LEAST_VARIANCE_DN2)), self._where
        if self.variance.intercept < LEAST_VARIANCE_DN2:
            note = "an upper limit: below 0.49 DN rounding hides the noise, this is the least value the standard allows"
        return Quantity(sigma, self.variance.intercept_uncertainty / (2 * sigma), "DN", note)

    def noise_e(self, k: Quantity) -> Quantity:
        """sigma_d: noise without rounding over K, sqrt(sigma_y.dark^2 - 1/12) / K (Release 4.0 Linear).

        Its uncertainty includes rounding: all noise compatible with this variance is equally likely.
        """
        dark = self.noise_dn()
        own = sqrt(dark.value**2 - ROUNDING_DN2)
        by_noise = dark.value * dark.standard_uncertainty / own
        by_rounding = variance_before_rounding(self.variance.intercept).root().error_of(own)
        relative = hypot(max(by_noise, by_rounding) / own, k.standard_uncertainty / k.value)
        return Quantity(own / k.value, relative * own / k.value, "e-", f"{dark.note}, without rounding")

    def current_e_s(self, k: Quantity) -> Quantity | None:
        """Dark current by the mean, slope / K; None with one exposure."""
        slope = self.model.rate_dn_s, sqrt(self.model.rate_variance_dn2_s2)
        return self._current(slope, k, 1, "slope of the mean over the exposure")

    def current_by_variance_e_s(self, k: Quantity) -> Quantity | None:
        """Dark current by the variance, slope / K^2; None with one exposure."""
        slope = self.variance.slope, self.variance.slope_uncertainty
        return self._current(slope, k, 2, "slope of the variance over the exposure")

    def doubling_temperature_c(self) -> Quantity | None:
        """T_d; None if the dark frames do not determine it."""
        doubling_c, temperatures = self.model.doubling_temperature_c, self.model.temperatures_c
        if doubling_c is None:
            return None
        uncertainty = doubling_c**2 * sqrt(self.model.covariance[2][2])
        span = f"{temperatures[0]:.1f} to {temperatures[-1]:.1f} degC"
        return Quantity(doubling_c, uncertainty, "K", f"from dark frames at {span}")

    @property
    def _several(self) -> bool:
        return len(self.model.exposures_s) > 1

    @property
    def _where(self) -> str:
        return "at zero exposure" if self._several else "at the only exposure of the dark frames"

    def _current(self, slope: tuple[float, float], k: Quantity, power: int, note: str) -> Quantity | None:
        if not self._several:
            return None
        value = slope[0] / k.value**power
        by_gain = power * value * k.standard_uncertainty / k.value
        return Quantity(value, hypot(slope[1] / k.value**power, by_gain), "e-/s", note)


def fit_dark_current(darks: Sequence[DarkObservation]) -> DarkFit:
    """Fit mean and variance of the dark signal over the exposure.

    Parameters
    ----------
    darks : sequence of DarkObservation
        At least one.
    """
    t, variance = (np.array([getattr(d, name) for d in darks]) for name in ("exposure_s", "temporal_variance_dn2"))
    return DarkFit(fit_dark(darks)[0], line(t, variance, variance_uncertainties_dn2(darks)))
