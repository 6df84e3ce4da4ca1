"""Quantiles of the contrasts of all pairs of pixels."""

from __future__ import annotations

from fractions import Fraction
from math import inf, nan, sqrt

from ..core.errors import InputError
from .distribution import Distribution, Region, weight_not_positive
from .interval import decimal_fraction
from .pairs import bright_and_dark, weight_up_to

#: Upper bound of all relevant finite contrasts.
_BEYOND_ALL = Fraction(10) ** 300


def contrast_quantile(a: Region, b: Region, probability: float) -> float:
    """Weber contrast that a share of all pairs of pixels does not exceed.

    Parameters
    ----------
    a, b : array_like of int or float of any shape, or Distribution
        Pixels of the two regions, as for `cdp`.
    probability : float
        Share of all pairs, 0 to 1; 0.5 is the median contrast.

    Returns
    -------
    float
        Smallest contrast that at least this share of the pairs does not exceed; the ratio 1 + K is accurate to 1e-12.
        nan where the share is reached by undefined pairs, which count as below every contrast; inf where unbounded ones
        are needed. The result is at least -1, the contrast of pairs whose bright region's pixel is 0 or below.

    Raises
    ------
    InputError
        If the probability is out of range, or a region cannot be used (see `cdp`).

    Notes
    -----
    Found by bisection with some 40 passes over the distinct values; the pairs are never stored.
    """
    if not 0 <= probability <= 1:
        raise InputError(f"probability is {probability}: give a number from 0 to 1")
    bright, dark, _ = bright_and_dark(a, b)
    weight = float(decimal_fraction(probability) * Fraction(bright.total * dark.total))
    undefined, bounded = finite_weights(bright, dark)
    if undefined and weight <= undefined:
        return nan
    return finite_quantile(bright, dark, weight, 1e-12) if undefined < bounded >= weight else inf


def finite_weights(bright: Distribution, dark: Distribution) -> tuple[float, float]:
    """Weight of the pairs of undefined contrast, and of these plus those of finite contrast."""
    undefined = weight_not_positive(bright) * weight_not_positive(dark)
    return undefined, weight_up_to(bright, dark, _BEYOND_ALL)


def finite_quantile(bright: Distribution, dark: Distribution, weight: float, precision: float) -> float:
    """Smallest contrast, -1 or more, at which the cumulative weight reaches one between those of `finite_weights`.

    The ratio 1 + contrast is accurate to the relative `precision`.
    """
    at_lowest = weight_up_to(bright, dark, Fraction(-1))
    if at_lowest > 0 and weight <= at_lowest:
        return -1.0
    positive_bright, positive_dark = bright.values[bright.values > 0], dark.values[dark.values > 0]
    # Bracket of the ratio: the upper end reaches the weight, the lower one does not.
    low = float(positive_bright[0]) / float(positive_dark[-1]) * (1 - 1e-12)
    high = min(float(positive_bright[-1]) / float(positive_dark[0]), float(_BEYOND_ALL))
    while high > low * (1 + precision):
        middle = sqrt(low) * sqrt(high)
        if weight_up_to(bright, dark, Fraction(middle) - 1) >= weight:
            high = middle
        else:
            low = middle
    return high - 1
