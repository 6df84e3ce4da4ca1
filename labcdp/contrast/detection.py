"""Contrast detection probability (CDP) between two regions, exact over all pairs of pixels."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import isfinite, nan, sqrt
from typing import Literal

from ..errors import InputError
from .distribution import Region
from .pairs import bright_and_dark, decimal_fraction, tally_pairs
from .uncertainty import confidence_interval, unbiased_variance


@dataclass(frozen=True)
class CdpResult:
    """Contrast detection probability between two regions; all shares are fractions of all pairs of pixels.

    Parameters
    ----------
    cdp : float
        Share of pairs whose contrast lies in `interval`, ends included.
    standard_error : float
        Of `cdp`, for pixels independent of each other; nan if a region has one pixel only or weights that are
        not counts. Noise correlated over 3 x 3 pixels makes it two to three times as large.
    confidence_interval : (float, float)
        95 % interval of `cdp`; (nan, nan) where the standard error is nan.
    contrast, epsilon : float
        Weber contrast asked for, and its tolerance.
    interval : (float, float)
        Lowest and highest contrast that counts as detected.
    below, above : float
        Share of pairs with a lower or a higher contrast; `below` + `cdp` + `above` is 1.
    undefined : float
        Share of pairs in which no pixel is above 0; they are part of `below`.
    bright : {'a', 'b'}
        Which region was the bright one.
    bright_size, dark_size : int or None
        Pixels of the two regions; None if the weights are not counts.
    """

    cdp: float
    standard_error: float
    confidence_interval: tuple[float, float]
    contrast: float
    epsilon: float
    interval: tuple[float, float]
    below: float
    above: float
    undefined: float
    bright: Literal["a", "b"]
    bright_size: int | None
    dark_size: int | None


def cdp(a: Region, b: Region, contrast: float, epsilon: float = 0.5) -> CdpResult:
    """Contrast detection probability between two regions, over every pixel of one against every pixel of the other.

    Parameters
    ----------
    a, b : array_like of int or float of any shape, or Distribution
        Pixels of the two regions in one linear unit, best cd/m^2. To evaluate many contrasts, make the
        distributions once with `Distribution.from_array` and pass them.
    contrast : float
        Weber contrast K to be detected, a fraction above 0 (1.0 is 100 %).
    epsilon : float
        Relative tolerance of the contrast, above 0 and up to 1.

    Returns
    -------
    CdpResult

    Raises
    ------
    InputError
        If contrast or epsilon is out of range, or a region is empty, holds values that are not finite or are
        not integers or floats, or neither region holds a value above 0.

    Notes
    -----
    CDP = P(K (1 - eps) <= bright / dark - 1 <= K (1 + eps)) (L. Ebbert, Implementierung von CDP, 2018, eq. 2.2
    and 2.3). The region with the larger mean is the bright one, `a` if the means are equal. The ends count. No
    quotient is rounded: the bright value is compared with (1 + K_low) and (1 + K_high) times the dark one, within
    a relative tolerance of 8 * 2^-52, and contrast and epsilon are taken as the decimals they are written as. For
    integers the result is thus that of exact arithmetic (see `pairs.RELATIVE_TOLERANCE` for the limits). Values in
    float32 come with their own rounding of 6e-8, beyond that tolerance, and are compared as they are.

    Where the dark value is 0 or below, a bright value above 0 has an unbounded contrast and is `above`; with
    both at 0 or below the contrast is undefined. Nothing is seen there, so such pairs are `below`, and their
    share is reported.
    """
    low, high = _contrast_interval(contrast, epsilon)
    bright, dark, bright_name = bright_and_dark(a, b)
    tally = tally_pairs(bright, dark, low, high)
    standard_error, interval = nan, (nan, nan)
    if bright.size is not None and dark.size is not None:
        variance = unbiased_variance(
            tally.inside, tally.inside_per_dark, dark.weights, tally.inside_per_bright, bright.weights
        )
        standard_error = sqrt(variance)
        interval = confidence_interval(tally.inside, variance, min(bright.size, dark.size))
    return CdpResult(
        cdp=tally.inside,
        standard_error=standard_error,
        confidence_interval=interval,
        contrast=float(contrast),
        epsilon=float(epsilon),
        interval=(float(low), float(high)),
        below=tally.below,
        above=tally.above,
        undefined=bright.not_positive * dark.not_positive,
        bright=bright_name,
        bright_size=bright.size,
        dark_size=dark.size,
    )


def _contrast_interval(contrast: float, epsilon: float) -> tuple[Fraction, Fraction]:
    """Lowest and highest contrast that counts as detected, exactly; raises InputError if out of range."""
    if not (isfinite(contrast) and contrast > 0):
        raise InputError(f"contrast is {contrast}: give a fraction above 0 (1.0 is 100 %)")
    if not 0 < epsilon <= 1:
        raise InputError(f"epsilon is {epsilon}: give a fraction above 0, up to 1")
    middle, tolerance = decimal_fraction(contrast), decimal_fraction(epsilon)
    return middle * (1 - tolerance), middle * (1 + tolerance)
