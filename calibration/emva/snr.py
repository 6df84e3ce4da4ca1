"""Signal-to-noise ratio, sensitivity threshold and dynamic range."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..rounding import ROUNDING_DN2
from .result import Quantity


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
    result: NDArray[np.float64] = signal_e / np.sqrt(noise + signal_e + (prnu * signal_e) ** 2)
    return result


def sensitivity_threshold_e(dark_noise_dn: Quantity, k: Quantity) -> Quantity:
    """Signal at which SNR is 1: mu_e.min = sigma_y.dark / K + 1/2 (EMVA 1288 Release 4.0 Linear)."""
    noise = dark_noise_dn.over(k, "e-")
    return replace(noise, value=noise.value + 0.5)


def snr_max(full_well_e: Quantity, note: str = "") -> Quantity:
    """SNR at saturation: sqrt(mu_e.sat) (EMVA 1288 Release 4.0 Linear)."""
    value = sqrt(full_well_e.value)
    return Quantity(value, full_well_e.standard_uncertainty / (2 * value), "1", note)
