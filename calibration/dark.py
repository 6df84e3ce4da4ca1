"""Darkness of the camera as a function of the exposure time, from dark frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from ..errors import CalibrationError
from .observations import CameraState, DarkObservation
from .signal_limits import MAX_CLIPPED_SHARE


@dataclass(frozen=True)
class DarkModel:
    """d(t) = `offset_dn` + `rate_dn_s` t.

    Parameters
    ----------
    offset_dn, rate_dn_s : float
        DN at zero exposure, and its growth per second (EMVA 1288: dark current, here times K).
    offset_variance_dn2, rate_variance_dn2_s2, covariance_dn2_s : float
        Variances of the two, and their covariance.
    noise_dn : float
        Temporal noise of one pixel in darkness.
    nonuniformity_dn : float
        Standard deviation of slow changes of the darkness across the sensor.
    exposures_s : tuple of float
        Exposures of the dark frames, ascending.
    """

    offset_dn: float
    rate_dn_s: float
    offset_variance_dn2: float
    rate_variance_dn2_s2: float
    covariance_dn2_s: float
    noise_dn: float
    nonuniformity_dn: float
    exposures_s: tuple[float, ...]

    def mean_dn(self, exposure_s: float) -> float:
        """d(t) in DN."""
        return self.offset_dn + self.rate_dn_s * exposure_s

    def variance_dn2(self, exposure_s: float) -> float:
        """Variance of d(t) in DN^2."""
        return self.propagate(1.0, exposure_s)

    def propagate(self, offset_sensitivity: float, rate_sensitivity: float) -> float:
        """Variance of a quantity with these derivatives by `offset_dn` and `rate_dn_s` (GUM 5.2.2)."""
        a, b = offset_sensitivity, rate_sensitivity
        variance = a * a * self.offset_variance_dn2 + b * b * self.rate_variance_dn2_s2
        return max(variance + 2 * a * b * self.covariance_dn2_s, 0.0)


#: Probability of a chi^2 below which the dark frames contradict each other.
_CHANCE = 0.01
#: Differences of mean darkness up to this are the wander of a sound camera's black level.
_WANDER_DN = 0.5


def fit_dark(darks: Sequence[DarkObservation]) -> tuple[DarkModel, list[str]]:
    """Fit the darkness to dark frames.

    A weighted straight line over the exposure time. From three exposures on, the uncertainty is widened by the Birge
    ratio sqrt(chi^2 / degrees of freedom) if the points scatter more than they should. Dark frames at one
    exposure give a constant.

    Parameters
    ----------
    darks : sequence of DarkObservation
        At least one; of one camera state.

    Returns
    -------
    DarkModel
        The darkness.
    list of str
        Warnings.

    Raises
    ------
    CalibrationError
        If there is no observation, or cameras or settings differ.
    """
    if not darks:
        raise CalibrationError(
            "there are no dark frames: cover the lens and take at least 2 at each exposure, they fix the offset"
        )
    _require_one_state(darks)
    warnings = [
        f"{d.black_share:.1%} of the pixels of the dark frames at {d.exposure_s:g} s are 0 DN, so the mean dark may "
        "be too high: raise the camera's black level"
        for d in darks
        if d.black_share > MAX_CLIPPED_SHARE
    ]
    t = np.array([d.exposure_s for d in darks])
    y = np.array([d.mean_dn for d in darks])
    # Frames without any noise still need a weight; the floor is far below what a mean can be known to.
    weights = 1 / np.maximum([d.mean_variance_dn2 for d in darks], 1e-12)
    if np.unique(t).size == 1:
        warnings.append(
            f"dark frames at one exposure only ({t[0]:g} s): the offset is taken as constant, which is right at that "
            "exposure; take dark frames at the longest and shortest exposure too"
        )
        design = np.ones((t.size, 1))
    else:
        design = np.column_stack([np.ones_like(t), t])
    covariance = np.zeros((2, 2))
    parameters = np.zeros(2)
    n = design.shape[1]
    covariance[:n, :n] = np.linalg.inv(design.T @ (weights[:, None] * design))
    parameters[:n] = covariance[:n, :n] @ (design.T @ (weights * y))
    covariance_of_noise = covariance
    freedom = t.size - n
    if freedom > 0:
        chi_squared = float(np.sum(weights * (y - design @ parameters[:n]) ** 2))
        warnings += _contradictions(t, y, weights, design, parameters[:n])
        covariance = covariance * max(1.0, chi_squared / freedom)
    if parameters[1] * np.ptp(t) < -_WANDER_DN and parameters[1] < -3 * sqrt(covariance_of_noise[1, 1]):
        warnings.append(
            f"the darkness falls with the exposure by {-parameters[1]:.3g} DN/s, which no sensor does: was the lens "
            "covered at the short exposures? take the dark frames again"
        )
    freedoms = np.array([(d.n_pixels - 1) * (d.n_frames - 1) for d in darks])
    model = DarkModel(
        offset_dn=float(parameters[0]),
        rate_dn_s=float(parameters[1]),
        offset_variance_dn2=float(covariance[0, 0]),
        rate_variance_dn2_s2=float(covariance[1, 1]),
        covariance_dn2_s=float(covariance[0, 1]),
        noise_dn=sqrt(float(np.average([d.temporal_variance_dn2 for d in darks], weights=freedoms))),
        nonuniformity_dn=sqrt(float(np.mean([d.nonuniformity_dn**2 for d in darks]))),
        exposures_s=tuple(float(v) for v in np.unique(t)),
    )
    return model, warnings


def _contradictions(
    t: NDArray[np.float64],
    y: NDArray[np.float64],
    weights: NDArray[np.float64],
    design: NDArray[np.float64],
    parameters: NDArray[np.float64],
) -> list[str]:
    """Return a warning if the dark frames scatter around the line more than noise and wander explain."""
    from scipy.special import chdtrc

    residuals = y - design @ parameters
    chance = chdtrc(t.size - parameters.size, float(np.sum(weights * residuals**2)))
    if chance >= _CHANCE or np.abs(residuals).max() <= _WANDER_DN:
        return []
    return [
        f"the dark frames at {_most_deviating(t, y, weights, design):g} s do not fit the others, which a straight line "
        f"over the exposure misses by up to {np.abs(residuals).max():.2g} DN: was the lens covered, and the camera "
        "warm? take the dark frames again"
    ]


def _most_deviating(
    t: NDArray[np.float64], y: NDArray[np.float64], weights: NDArray[np.float64], design: NDArray[np.float64]
) -> float:
    """Exposure without which a line fits the others best; a residual alone misleads at the ends of the range."""
    left: list[float] = []
    for index in range(t.size):
        others = np.arange(t.size) != index
        root = np.sqrt(weights[others])
        parameters = np.linalg.lstsq(root[:, None] * design[others], root * y[others])[0]
        left.append(float(np.sum(weights[others] * (y[others] - design[others] @ parameters) ** 2)))
    return float(t[int(np.argmin(left))])


def _require_one_state(darks: Sequence[DarkObservation]) -> None:
    first: CameraState = darks[0].state
    for dark in darks[1:]:
        first.require(dark.state, "the first dark frames", f"the set of dark frames at {dark.exposure_s:g} s")
