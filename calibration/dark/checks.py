"""Checks of dark frames."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...core.finding import Finding, warning
from ..frames.observations import DarkObservation
from ..signal_limits import MAX_CLIPPED_SHARE
from .lines import line

#: p-value of chi^2 below which the dark frames are inconsistent.
_SMALL_P_VALUE = 0.01
#: Largest difference of mean dark signal by normal drift of the black level.
DRIFT_DN = 0.5


def clipping(darks: Sequence[DarkObservation]) -> list[Finding]:
    """Warn of dark frames with pixels at 0 DN."""
    return [
        warning("dark-clipped", exposure_s=d.exposure_s, share=float(d.black_share))
        for d in darks
        if d.black_share > MAX_CLIPPED_SHARE
    ]


def falling(t: NDArray[np.float64], rate_dn_s: float, uncertainty_dn_s: float) -> list[Finding]:
    """Warn of a dark signal that decreases with the exposures `t`, given a rate and its standard uncertainty."""
    if rate_dn_s * np.ptp(t) >= -DRIFT_DN or rate_dn_s >= -3 * uncertainty_dn_s:
        return []
    return [warning("dark-falls", rate_dn_s=-float(rate_dn_s))]


def contradictions(
    t: NDArray[np.float64],
    grown_s: NDArray[np.float64],
    y: NDArray[np.float64],
    u: NDArray[np.float64],
    residuals: NDArray[np.float64],
    n_parameters: int,
) -> list[Finding]:
    """Return a warning if the dark frames scatter around the line more than noise and drift explain.

    Parameters
    ----------
    t, grown_s : ndarray of float, shape (n,)
        Exposures, and the same times the growth of the dark current with the temperature.
    y, u, residuals : ndarray of float, shape (n,)
        Means with standard uncertainties, and their deviations from the fit.
    n_parameters : int
        Of the fit.
    """
    from scipy.special import chdtrc

    p_value = chdtrc(t.size - n_parameters, float(np.sum((residuals / u) ** 2))) if t.size > n_parameters else 1.0
    if p_value >= _SMALL_P_VALUE or np.abs(residuals).max() <= DRIFT_DN:
        return []
    # Exposure without which a line fits best; residuals are misleading at the ends of the range.
    left = [line(np.delete(grown_s, i), np.delete(y, i), np.delete(u, i)).chi_squared for i in range(t.size)]
    worst = float(t[int(np.argmin(left))])
    return [warning("dark-contradicts", exposure_s=worst, deviation_dn=float(np.abs(residuals).max()))]
