"""Temporal noise of the camera by photon transfer over the patches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..response import Response
from .dark import DarkModel
from .observations import PatchObservation
from .signal_limits import MAX_CLIPPED_SHARE, ROUNDING_DN2

#: Share of the saturation up to which photon transfer is a straight line (EMVA 1288: 0 to 70 %).
PHOTON_TRANSFER_SHARE = 0.7


@dataclass(frozen=True)
class TemporalNoise:
    """Variance of one pixel over time: s^2 = K (DN - d) + dark_noise^2 (EMVA 1288).

    A camera with a tone curve has this noise before the curve: (s^2 of h) / h'^2, and 1/12 DN^2 by rounding after it.

    Parameters
    ----------
    k_dn_per_e : float
        Overall system gain K; 0 if the noise does not grow with the signal. In linearised DN with a tone curve.
    dark_noise_dn : float
        Standard deviation in darkness, rounding included; in linearised DN and without rounding with a tone curve.
    tone : Response or None
        Response h of a camera with a tone curve, None if DN and light are (nearly) proportional.
    """

    k_dn_per_e: float
    dark_noise_dn: float
    tone: Response | None = None

    def variance_dn2(self, net_dn: float) -> float:
        """Variance of one pixel at a signal above dark, in DN^2."""
        return float(self.variances_dn2(np.array(net_dn)))

    def variances_dn2(self, net_dn: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
        """Return the same of many signals, any shape."""
        linear_dn = net_dn if self.tone is None else self.tone.linearise(net_dn)
        variance: NDArray[np.float64] = self.k_dn_per_e * np.maximum(linear_dn, 0.0) + self.dark_noise_dn**2
        return variance if self.tone is None else variance / self.tone.slope(net_dn) ** 2 + ROUNDING_DN2


def fit_noise(
    observations: Sequence[PatchObservation], dark: DarkModel, tone: Response | None = None
) -> tuple[TemporalNoise, list[str]]:
    """Fit the overall system gain K by photon transfer.

    var - var_dark = K (mean - mean_dark), a straight line through the dark point (EMVA 1288 Release 4.0 Linear),
    over the patches up to 70 % of saturation. Each point is weighted with the variance of a variance, 2 s^4 / dof,
    from the fitted line itself.

    Parameters
    ----------
    observations : sequence of PatchObservation
        All patches and exposures.
    dark : DarkModel
        Mean and noise in darkness.
    tone : Response or None
        Response of a camera with a tone curve, over the range that it is known for. Noise is then fitted before the
        curve, read noise with it, as the curve may be steep at dark.

    Returns
    -------
    TemporalNoise
        K and the dark noise.
    list of str
        Warnings.
    """
    points = []
    for o in observations:
        dark_dn = dark.mean_dn(o.exposure_s, o.temperature_c)
        net_dn = o.net_dn_at_pixel(dark_dn)
        if tone is not None and not tone.net_dn[1] <= net_dn <= tone.net_dn[-1]:
            continue
        unclipped = max(o.saturated_share, o.black_share) <= MAX_CLIPPED_SHARE
        if unclipped and 0 < net_dn <= PHOTON_TRANSFER_SHARE * (o.state.saturation_dn - dark_dn):
            points.append((net_dn, o.temporal_variance_dn2, (o.n_pixels - 1) * (o.n_frames - 1)))
    if not points:
        return TemporalNoise(0.0, dark.noise_dn, tone), [
            f"no patch lies between dark and {PHOTON_TRANSFER_SHARE:.0%} of saturation, so K is unknown and the noise "
            "of bright pixels is understated: take a shorter exposure too"
        ]
    net, variance, freedom = np.array(points).T
    if tone is not None:
        return _before_tone(net, variance, freedom, tone), []
    excess = variance - dark.noise_dn**2
    k = float(excess.sum() / net.sum())
    for _ in range(5):  # the weights change little after the second round
        if k <= 0:
            break
        weight = freedom / (k * net + dark.noise_dn**2) ** 2
        k = float(np.sum(weight * net * excess) / np.sum(weight * net**2))
    if k <= 0:
        return TemporalNoise(0.0, dark.noise_dn), [
            f"the temporal noise does not grow with the signal (K = {k:.3g} DN/e-): check that the frames are "
            "different ones and not denoised; the noise of bright pixels is understated"
        ]
    return TemporalNoise(k, dark.noise_dn), []


def _before_tone(
    net_dn: NDArray[np.float64], variance_dn2: NDArray[np.float64], freedom: NDArray[np.float64], tone: Response
) -> TemporalNoise:
    """K and read noise of h by least squares; neither is negative."""
    from scipy.optimize import nnls

    slope2 = tone.slope(net_dn) ** 2
    design = np.column_stack([tone.linearise(net_dn), np.ones(net_dn.size)]) / slope2[:, None]
    weight = np.sqrt(freedom) / np.maximum(variance_dn2, ROUNDING_DN2)
    (k, dark_dn2), _ = nnls(weight[:, None] * design, weight * np.maximum(variance_dn2 - ROUNDING_DN2, 0))
    return TemporalNoise(float(k), sqrt(float(dark_dn2)), tone)
