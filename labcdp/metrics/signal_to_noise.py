"""Signal-to-noise ratios of one region, and of the difference of two."""

from __future__ import annotations

from math import inf, log, log10, nan, sqrt

import numpy as np
from numpy.typing import NDArray

from ..core.quantity import Quantity
from .distribution import Distribution, Region, as_distribution, weighted_sum
from .pixel_pairs import bright_and_dark


def snr(region: Region) -> Quantity:
    """Signal-to-noise ratio mean / standard deviation of a region.

    Parameters
    ----------
    region : array_like of int or float of any shape, or Distribution
        Pixels of one patch in one linear unit, with the dark signal subtracted.

    Returns
    -------
    Quantity
        Ratio, not in dB, with its standard uncertainty for independent pixels, to first order in 1 / pixels; inf if all
        pixels are equal and above 0, nan if they are 0 or there is one pixel only.

    Raises
    ------
    InputError
        If the region is empty or holds values that are not finite or not integers or floats.

    Notes
    -----
    SNR = mu / s (EMVA Standard 1288, with the dark signal subtracted from mu), s with n - 1. For normal pixels
    its standard uncertainty is sqrt((1 + SNR^2 / 2) / n); here skewness and kurtosis are those of the region.

    Examples
    --------
    >>> from labcdp.metrics import snr
    >>> ratio = snr([99, 101, 100, 102, 98])
    >>> round(ratio.value, 1), round(ratio.u, 1)
    (63.2, 10.6)
    """
    pixels = as_distribution(region, "region")
    deviations, variance = pixels.deviations, pixels.variance
    ratio = _over(pixels.mean, sqrt(variance))
    if not np.isfinite(ratio):
        return Quantity(ratio, nan)
    # Derivative of the ratio with respect to each pixel.
    influence = deviations / sqrt(variance) - ratio / 2 * (deviations**2 / variance - 1)
    return Quantity(ratio, _u((pixels, influence)))


def snr_20log10_db(region: Region) -> Quantity:
    """Signal-to-noise ratio in dB as EMVA Standard 1288 defines it, 20 log10(mean / standard deviation).

    Parameters and errors as for `snr`; inf where that is, -inf where it is 0, nan where it is below.

    Examples
    --------
    >>> from labcdp.metrics import snr_20log10_db
    >>> round(snr_20log10_db([99, 101, 100, 102, 98]).value, 1)
    36.0
    """
    return _decibels(snr(region), 20)


def snr_10log10_db(region: Region) -> Quantity:
    """Signal-to-noise ratio in dB as L. Ebbert (Implementierung von CDP, 2018, eq. 2.1), 10 log10(mean / deviation).

    Half of what `snr_20log10_db` gives. Parameters and errors as for `snr`; inf where that is, -inf where it is 0, nan
    where it is below.

    Examples
    --------
    >>> from labcdp.metrics import snr_10log10_db
    >>> round(snr_10log10_db([99, 101, 100, 102, 98]).value, 1)
    18.0
    """
    return _decibels(snr(region), 10)


def csnr(a: Region, b: Region) -> Quantity:
    """Contrast signal-to-noise ratio: mean over standard deviation of the Weber contrast of all pairs of pixels.

    Parameters
    ----------
    a, b : array_like of int or float of any shape, or Distribution
        Pixels of the two regions, as for `cdp`.

    Returns
    -------
    Quantity
        nan if a dark value is 0 or below, since its contrasts are unbounded or undefined; inf if all contrasts are
        equal and above 0, nan if all are 0.

    Raises
    ------
    InputError
        As `cdp`.

    Notes
    -----
    CSNR = mean(C) / std(C), C = b / d - 1, an indicator related to CDP. As all pairs of bright and dark pixels are
    used, the moments of the ratio are products, E[b / d] = E[b] E[1 / d] and E[(b / d)^2] = E[b^2] E[1 / d^2], so the
    result is exact over all pairs without visiting them. The standard deviation of the pairs is computed with their
    number N, not N - 1.

    Examples
    --------
    >>> from labcdp.metrics import csnr
    >>> round(csnr([120, 125, 118, 121], [100, 98, 103, 99]).value, 1)
    6.2
    """
    bright, dark, _ = bright_and_dark(a, b)
    if dark.values[0] <= 0:
        return Quantity(nan, nan)
    inverse = 1 / dark.values
    above, above_square = _moments(bright, bright.values)
    below, below_square = _moments(dark, inverse)
    mean = above * below - 1
    # Var(b / d) = Var(b) E[1 / d^2] + E[b]^2 Var(1 / d), which avoids cancellation.
    variance = above_square * (below_square + below**2) + above**2 * below_square
    ratio = _over(mean, sqrt(variance))
    if not np.isfinite(ratio):
        return Quantity(ratio, nan)
    influences = []
    for region, values, moment, moment_square, other, other_square in (
        (bright, bright.values, above, above_square, below, below_square),
        (dark, inverse, below, below_square, above, above_square),
    ):
        off = values - moment
        by_mean = off * other
        by_variance = (off**2 - moment_square) * (other_square + other**2) + 2 * moment * off * other_square
        influences.append((region, by_mean / sqrt(variance) - ratio / (2 * variance) * by_variance))
    return Quantity(ratio, _u(*influences))


def cnr(a: Region, b: Region) -> Quantity:
    """Contrast-to-noise ratio: difference of the means over the standard deviation of the darker region.

    Parameters
    ----------
    a, b : array_like of int or float of any shape, or Distribution
        Pixels of the two regions, as for `cdp`.

    Returns
    -------
    Quantity
        inf if the dark pixels are all equal, nan if the means are too or the dark region has one pixel only.

    Raises
    ------
    InputError
        As `cdp`.

    Notes
    -----
    CNR = (mu_bright - mu_dark) / s_dark, s with n - 1: the noise is that of the background, as usual in radiography;
    for that of both regions see `d_prime`.

    Examples
    --------
    >>> from labcdp.metrics import cnr
    >>> round(cnr([120, 125, 118, 121], [100, 98, 103, 99]).value, 1)
    9.7
    """
    bright, dark, _ = bright_and_dark(a, b)
    off, variance = dark.deviations, dark.variance
    ratio = _over(bright.mean - dark.mean, sqrt(variance))
    if not np.isfinite(ratio):
        return Quantity(ratio, nan)
    by_dark = -off / sqrt(variance) - ratio / 2 * (off**2 / variance - 1)
    by_bright = (bright.values - bright.mean) / sqrt(variance)
    return Quantity(ratio, _u((bright, by_bright), (dark, by_dark)))


def d_prime(a: Region, b: Region) -> Quantity:
    """Compute the detectability d', difference of the means over the root mean square of the standard deviations.

    Parameters
    ----------
    a, b : array_like of int or float of any shape, or Distribution
        Pixels of the two regions in one unit; an offset does not matter.

    Returns
    -------
    Quantity
        0 or more; inf if the pixels of each region are all equal, nan if the means are too or one region has one pixel
        only.

    Raises
    ------
    InputError
        If a region is empty or holds values that are not finite or not integers or floats.

    Notes
    -----
    d' = abs(mu_1 - mu_2) / sqrt((s_1^2 + s_2^2) / 2), s with n - 1 (Green and Swets, Signal Detection Theory and
    Psychophysics, 1966; in this form for unequal variances Simpson and Fitter, Psychol. Bull. 80, 1973). The standard
    uncertainty assumes different means: where they are equal, d' only reflects scatter.

    Examples
    --------
    >>> from labcdp.metrics import d_prime
    >>> round(d_prime([120, 125, 118, 121], [100, 98, 103, 99]).value, 1)
    8.1
    """
    first, second = as_distribution(a, "region a"), as_distribution(b, "region b")
    variance = (first.variance + second.variance) / 2
    difference = first.mean - second.mean
    value = _over(abs(difference), sqrt(variance))
    if not np.isfinite(value):
        return Quantity(value, nan)
    influences = []
    for region, sign in ((first, 1), (second, -1)):
        off, direction = region.deviations, sign * (1 if difference >= 0 else -1)
        influence = direction * off / sqrt(variance) - value / (4 * variance) * (off**2 - region.variance)
        influences.append((region, influence))
    return Quantity(value, _u(*influences))


def _moments(region: Distribution, values: NDArray[np.float64]) -> tuple[float, float]:
    """Mean and variance (with n) of a function of the values of a region."""
    mean = weighted_sum(region.weights, values) / region.total
    off = values - mean
    return mean, weighted_sum(region.weights, off, off) / region.total


def _over(signal: float, noise: float) -> float:
    if noise == 0:
        return nan if signal == 0 else inf if signal > 0 else -inf
    return signal / noise


def _u(*influences: tuple[Distribution, NDArray[np.float64]]) -> float:
    """Compute the standard uncertainty of a value from its derivative with respect to each pixel of its regions."""
    variance = 0.0
    for region, influence in influences:
        if region.size is None or region.size < 2:
            return nan
        variance += _moments(region, influence)[1] / (region.size - 1)
    return sqrt(variance)


def _decibels(ratio: Quantity, factor: int) -> Quantity:
    if not ratio.value > 0:
        return Quantity(-inf if ratio.value == 0 else nan, nan)
    return Quantity(factor * log10(ratio.value), factor / log(10) * ratio.u / ratio.value)
