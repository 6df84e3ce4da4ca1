"""Effect of rounding to whole DN on mean and variance of noise below 1 DN.

Noise of more than half a DN dithers the rounding, which then adds 1/12 DN^2 of variance and shifts no mean (B. Widrow
and I. Kollar, Quantization Noise, 2008). With less noise, mean and variance of the rounded values depend on where
between two DN the mean lies.
"""

from __future__ import annotations

from functools import cache
from math import exp, pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Variance of rounding to whole digital numbers, DN^2; EMVA 1288 Release 3.1, section 2.2.
ROUNDING_DN2 = 1 / 12
#: Variance from which on rounding adds 1/12 DN^2 to better than 1e-4.
DITHERED_DN2 = 0.6
#: Standard deviations before rounding for which the bounds are tabled, DN; at the last one rounding is dithered.
_DEVIATIONS_DN = np.linspace(0.0, 1.2, 601)
#: Variances that differ by less, in DN^2, are one: Numerical tolerance.
_TINY_DN2 = 1e-9


class Range(NamedTuple):
    """Least and largest value."""

    least: float
    largest: float

    def error_of(self, value: float) -> float:
        """Root mean square error of `value` if all of the range is equally likely."""
        return float(np.hypot((self.least + self.largest) / 2 - value, (self.largest - self.least) / np.sqrt(12)))

    def root(self) -> Range:
        """Range of the square root."""
        return Range(float(np.sqrt(self.least)), float(np.sqrt(self.largest)))


def quantisation_variance_dn2(variance_dn2: float, step_dn: float = 1.0) -> float:
    """Variance by rounding to steps, of whole DN or of codes, of the mean of any number of pixels.

    Noise dithers the rounding. With normal noise of standard deviation s DN the mean of rounded values is off by a
    Fourier series in the mean, with variance sum_k exp(-4 pi^2 k^2 s^2) / (2 pi^2 k^2) over all offsets (B. Widrow
    and I. Kollar, Quantization Noise, 2008); exp(-4 pi^2 s^2) / 12 bounds it and is exact without noise.

    Parameters
    ----------
    variance_dn2 : float
        Variance of the rounded values over pixels and frames, which includes about 1/12 of the square of the step.
    step_dn : float
        The step.
    """
    return step_dn**2 * ROUNDING_DN2 * exp(-4 * pi**2 * max(variance_dn2 / step_dn**2 - ROUNDING_DN2, 0.0))


def rounded_moments(means_dn: FloatArray, variance_dn2: float) -> tuple[FloatArray, FloatArray]:
    """Mean and variance of rounded normal values.

    Parameters
    ----------
    means_dn : ndarray of float, shape (n,)
        Means before rounding.
    variance_dn2 : float
        Variance before rounding, of all of them.

    Returns
    -------
    mean_dn, variance_dn2 : ndarray of float, shape (n,)
        After rounding.
    """
    from scipy.special import ndtr

    deviation = float(np.sqrt(max(variance_dn2, 1e-12)))
    first = int(np.floor(means_dn.min() - 6 * deviation)) - 1
    dn = np.arange(first, int(np.ceil(means_dn.max() + 6 * deviation)) + 2)
    edges = ndtr((dn[:, None] + 0.5 - means_dn) / deviation)
    share = np.diff(edges, axis=0, prepend=0.0)
    mean = dn @ share
    variance: FloatArray = np.einsum("kn,kn->n", (dn[:, None] - mean) ** 2, share)
    return mean, variance


def mean_before_rounding(mean_dn: float, variance_dn2: float) -> float:
    """Mean of normal values with a variance whose rounded values have the mean `mean_dn`."""
    from scipy.optimize import brentq

    if variance_dn2 >= DITHERED_DN2:
        return mean_dn

    def excess(middle: float) -> float:
        return float(rounded_moments(np.array([middle]), variance_dn2)[0][0]) - mean_dn

    return float(brentq(excess, mean_dn - 0.6, mean_dn + 0.6, xtol=1e-9))


def variance_before_rounding(rounded_dn2: float) -> Range:
    """Range of variances before rounding that are compatible with a rounded variance, for any mean.

    Parameters
    ----------
    rounded_dn2 : float
        Variance of the rounded values, or its mean over pixels with different means.

    Returns
    -------
    Range
        In DN^2.

    Notes
    -----
    The rounded variance is largest for a mean on the step between two DN, and smallest for one at a DN. Up to 1/4 DN^2
    is possible without noise.
    """
    least, largest = _variance_bounds()
    if rounded_dn2 >= least[-1]:
        unrounded_dn2 = rounded_dn2 - ROUNDING_DN2
        return Range(unrounded_dn2, unrounded_dn2)
    in_the_middle = float(np.interp(rounded_dn2 + _TINY_DN2, least, _DEVIATIONS_DN))
    on_the_step = float(np.interp(rounded_dn2 - _TINY_DN2, largest, _DEVIATIONS_DN))
    return Range(on_the_step**2, in_the_middle**2)


@cache
def _variance_bounds() -> tuple[FloatArray, FloatArray]:
    """Variance after rounding, of means in the middle of a DN and on a step, over `_DEVIATIONS_DN`."""
    places = np.array([0.0, 0.5])
    rounded = np.array([rounded_moments(places, float(deviation) ** 2)[1] for deviation in _DEVIATIONS_DN])
    return rounded[:, 0], rounded[:, 1]
