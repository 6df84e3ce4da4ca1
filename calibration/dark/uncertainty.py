"""Uncertainties of mean and variance of dark frames."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from ..frames.observations import DarkObservation
from ..rounding import ROUNDING_DN2, variance_before_rounding
from .lines import Line, line


def drift_of_black_level(darks: Sequence[DarkObservation]) -> tuple[float, int]:
    """Return the standard deviation of the black level from frame to frame, and its degrees of freedom."""
    freedoms = [d.n_frames - 1 for d in darks]
    if sum(freedoms) == 0:
        return 0.0, 0
    excess = [d.frame_means_variance_dn2 - d.mean_noise_dn2 for d in darks]
    return sqrt(max(float(np.average(excess, weights=freedoms)), 0.0)), sum(freedoms)


def mean_uncertainties_dn(darks: Sequence[DarkObservation], drift_dn: float) -> NDArray[np.float64]:
    """Return the standard uncertainties of means by noise, drift of the black level and rounding."""
    own = [(d.mean_noise_dn2 + drift_dn**2) / d.n_frames + d.rounding_dn2 for d in darks]
    # Frames without noise still need a weight; the floor is far below any real uncertainty.
    return np.sqrt(np.maximum(own, 1e-12))


def noise_line(darks: Sequence[DarkObservation], growth: NDArray[np.float64]) -> Line:
    """Fit the temporal variance over the exposure, times the growth of the dark current; constant unless it rises."""
    t, variance = np.array([d.exposure_s for d in darks]) * growth, np.array([d.temporal_variance_dn2 for d in darks])
    u = variance_uncertainties_dn2(darks)
    if np.ptp(t) > 0:
        rising = line(t, variance, u)
        if rising.slope > 0 and rising.intercept > 0:
            return rising
    return line(np.zeros_like(t), variance, u)


def variance_uncertainties_dn2(darks: Sequence[DarkObservation]) -> NDArray[np.float64]:
    """Return the uncertainties of normal variances, of rounding at least, with what rounding may have changed."""
    return np.array(
        [
            hypot(
                max(d.temporal_variance_dn2, ROUNDING_DN2) * sqrt(2 / d.dof),
                variance_before_rounding(d.temporal_variance_dn2).error_of(d.temporal_variance_dn2 - ROUNDING_DN2),
            )
            for d in darks
        ]
    )
