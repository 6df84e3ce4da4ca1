"""Contrast detection probability (CDP) between two regions, exact over all pairs of pixels."""

from __future__ import annotations

from collections.abc import Iterable
from math import nan, sqrt
from typing import Literal

from .distribution import Distribution, Region
from .interval import AskedContrast, ContrastDefinition, Epsilon
from .pairs import PairTally, bright_and_dark, tally_pairs
from .result import CdpResult
from .uncertainty import confidence_interval, unbiased_variance


def cdp(
    a: Region, b: Region, contrast: float, epsilon: Epsilon = 0.5, *, definition: ContrastDefinition = "weber"
) -> CdpResult:
    """Contrast detection probability between two regions, over every pixel of one against every pixel of the other.

    Parameters
    ----------
    a, b : array_like of int or float of any shape, or Distribution
        Pixels of the two regions in one linear unit, best cd/m^2. To evaluate many contrasts, see `cdp_range`.
    contrast : float
        Contrast K to be detected, a fraction above 0 (1.0 is 100 %).
    epsilon : float or DetectionInterval
        Relative tolerance of the contrast, above 0 and up to 1; a `DetectionInterval` for one that differs below and
        above or has one end only.
    definition : {'weber', 'michelson'}
        Contrast in which K is given and pairs are measured. Michelson contrasts are below 1.

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

    Where the dark value is 0 or below, a bright value above 0 has an unbounded contrast and is `above` (detected if
    the interval has no upper end); with both at 0 or below the contrast is undefined. Nothing is seen there, so such
    pairs are `below`, and their share is reported.
    """
    return cdp_range(a, b, (contrast,), epsilon, definition=definition)[0]


def cdp_range(
    a: Region,
    b: Region,
    contrasts: Iterable[float],
    epsilon: Epsilon = 0.5,
    *,
    definition: ContrastDefinition = "weber",
) -> tuple[CdpResult, ...]:
    """Contrast detection probability between two regions at several contrasts; the pixels are counted once.

    Parameters
    ----------
    a, b, epsilon, definition
        As for `cdp`.
    contrasts : iterable of float
        Contrasts, each as for `cdp`; for equal steps see `contrast_range`.

    Returns
    -------
    tuple of CdpResult
        One for each contrast, each what `cdp` returns for it.

    Raises
    ------
    InputError
        As `cdp`.
    """
    asked = [AskedContrast(contrast, epsilon, definition) for contrast in contrasts]
    bright, dark, bright_name = bright_and_dark(a, b)
    return tuple(
        result_of_tally(tally_pairs(bright, dark, one.low, one.high), bright, dark, bright_name, one) for one in asked
    )


def result_of_tally(
    tally: PairTally,
    bright: Distribution,
    dark: Distribution,
    bright_name: Literal["a", "b"],
    asked: AskedContrast,
    variance_inflation: float = 1.0,
) -> CdpResult:
    """Report a tally, with its variance for independent pixels times `variance_inflation`."""
    standard_error, interval = nan, (nan, nan)
    if bright.size is not None and dark.size is not None:
        variance = variance_inflation * unbiased_variance(
            tally.inside, tally.inside_per_dark, dark.weights, tally.inside_per_bright, bright.weights
        )
        standard_error = sqrt(variance)
        # So many independent pixels would know as much about the region.
        smaller_size = min(bright.size, dark.size) / variance_inflation
        interval = confidence_interval(tally.inside, variance, smaller_size)
    return CdpResult(
        cdp=tally.inside,
        standard_error=standard_error,
        confidence_interval=interval,
        contrast=asked.contrast,
        epsilon=asked.epsilon,
        definition=asked.definition,
        interval=asked.interval,
        below=tally.below,
        above=tally.above,
        undefined=bright.not_positive * dark.not_positive,
        bright=bright_name,
        bright_size=bright.size,
        dark_size=dark.size,
        correlation_inflation=sqrt(variance_inflation),
    )
