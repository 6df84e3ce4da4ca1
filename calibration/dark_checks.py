"""What is wrong with dark frames, in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .observations import DarkObservation
from .signal_limits import MAX_CLIPPED_SHARE

#: Probability of a chi^2 below which the dark frames contradict each other.
_CHANCE = 0.01
#: Differences of mean darkness up to this are the wander of a sound camera's black level.
WANDER_DN = 0.5


def clipping(darks: Sequence[DarkObservation]) -> list[str]:
    """Warn of dark frames with pixels at 0 DN."""
    return [
        f"{d.black_share:.1%} of the pixels of the dark frames at {d.exposure_s:g} s are 0 DN, so the mean dark may "
        "be too high: raise the camera's black level"
        for d in darks
        if d.black_share > MAX_CLIPPED_SHARE
    ]


def falling(t: NDArray[np.floating[Any]], rate_dn_s: float, uncertainty_dn_s: float) -> list[str]:
    """Warn of a darkness that falls with the exposures `t`, by a rate and its standard uncertainty."""
    if rate_dn_s * np.ptp(t) >= -WANDER_DN or rate_dn_s >= -3 * uncertainty_dn_s:
        return []
    return [
        f"the darkness falls with the exposure by {-rate_dn_s:.3g} DN/s, which no sensor does: was the lens "
        "covered at the short exposures? take the dark frames again"
    ]


def contradictions(
    t: NDArray[np.floating[Any]],
    y: NDArray[np.floating[Any]],
    weights: NDArray[np.floating[Any]],
    design: NDArray[np.floating[Any]],
    parameters: NDArray[np.floating[Any]],
) -> list[str]:
    """Return a warning if the dark frames scatter around the line more than noise and wander explain."""
    from scipy.special import chdtrc

    residuals = y - design @ parameters
    chance = chdtrc(t.size - parameters.size, float(np.sum(weights * residuals**2)))
    if chance >= _CHANCE or np.abs(residuals).max() <= WANDER_DN:
        return []
    return [
        f"the dark frames at {_most_deviating(t, y, weights, design):g} s do not fit the others, which a straight line "
        f"over the exposure misses by up to {np.abs(residuals).max():.2g} DN: was the lens covered, and the camera "
        "warm? take the dark frames again"
    ]


def _most_deviating(
    t: NDArray[np.floating[Any]],
    y: NDArray[np.floating[Any]],
    weights: NDArray[np.floating[Any]],
    design: NDArray[np.floating[Any]],
) -> float:
    """Exposure without which a line fits the others best; a residual alone misleads at the ends of the range."""
    left: list[float] = []
    for index in range(t.size):
        others = np.arange(t.size) != index
        root = np.sqrt(weights[others])
        parameters = np.linalg.lstsq(root[:, None] * design[others], root * y[others])[0]
        left.append(float(np.sum(weights[others] * (y[others] - design[others] @ parameters) ** 2)))
    return float(t[int(np.argmin(left))])
