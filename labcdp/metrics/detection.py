"""Contrast detection probability (CDP) between two regions, exact over all pairs of pixels."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import nan, sqrt
from typing import Any, Literal, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .distribution import Distribution, Region
from .interval import ContrastDefinition, Epsilon, TargetContrast
from .pairs import PairTally, bright_and_dark, tally_pairs
from .probability import DetectionProbability, asked_contrasts, joined
from .result import CdpResult
from .uncertainty import confidence_interval, unbiased_variance


@overload
def cdp(
    bright: Region, dark: Region, contrast: float, epsilon: Epsilon = ..., *, definition: ContrastDefinition = ...
) -> DetectionProbability[float]: ...
@overload
def cdp(
    bright: Region,
    dark: Region,
    contrast: Sequence[float] | NDArray[Any],
    epsilon: Epsilon = ...,
    *,
    definition: ContrastDefinition = ...,
) -> DetectionProbability[NDArray[np.float64]]: ...
def cdp(
    bright: Region,
    dark: Region,
    contrast: ArrayLike,
    epsilon: Epsilon = 0.5,
    *,
    definition: ContrastDefinition = "weber",
) -> DetectionProbability[Any]:
    """Contrast detection probability between two regions, over every pixel of one against every pixel of the other.

    Parameters
    ----------
    bright, dark : array_like of int or float of any shape, or Distribution
        Pixels of the two regions in one linear unit, best cd/m^2.
    contrast : float or array_like of float
        Contrast K to be detected, a fraction above 0 (1.0 is 100 %), or several; the pixels are then counted once.
    epsilon : float or DetectionInterval
        Relative tolerance of the contrast, above 0 and up to 1; a `DetectionInterval` for one that differs below and
        above or has one end only.
    definition : {'weber', 'michelson'}
        Definition of the contrast of K and of the pairs. Michelson contrasts are below 1.

    Returns
    -------
    DetectionProbability
        With floats for a number, and arrays of the contrasts' shape for an array.

    Raises
    ------
    InputError
        If contrast or epsilon is out of range, or a region is empty, holds values that are not finite or are
        not integers or floats, or neither region holds a value above 0.

    Notes
    -----
    CDP = P(K (1 - eps) <= bright / dark - 1 <= K (1 + eps)) (L. Ebbert, Implementierung von CDP, 2018, eq. 2.2 and
    2.3). The region with the larger mean is the bright one, in whichever order they are given. Both ends are included.
    No quotient is rounded: the bright value is compared with (1 + K_low) and (1 + K_high) times the dark one, within a
    relative tolerance of 8 * 2^-52, and contrast and epsilon are taken as the decimals they are written as. For
    integers the result is thus that of exact arithmetic (see `pairs.RELATIVE_TOLERANCE` for the limits). Values in
    float32 come with their own rounding of 6e-8, beyond that tolerance, and are compared as they are.

    Where the dark value is 0 or below, a bright value above 0 has an unbounded contrast and is `above` (detected if the
    interval has no upper end); with both at 0 or below the contrast is undefined. Such pairs count as `below`, and
    their share is reported.
    """
    asked, shape = asked_contrasts(contrast, epsilon, definition)
    upper, lower, name = bright_and_dark(bright, dark, ("bright region", "dark region"))
    pairs = None if upper.size is None or lower.size is None else upper.size * lower.size
    results = _results(upper, lower, name, asked)
    return joined(results, asked, shape, epsilon, definition, pairs, swapped=name == "b")


def cdp_range(
    a: Region,
    b: Region,
    contrasts: Iterable[float],
    epsilon: Epsilon = 0.5,
    *,
    definition: ContrastDefinition = "weber",
) -> tuple[CdpResult, ...]:
    """Contrast detection probability between two regions at several contrasts, as one record each.

    For further processing of the records; `cdp` returns arrays.

    Parameters
    ----------
    a, b, epsilon, definition
        As for `cdp`; ``a`` and ``b`` are the regions in any order.
    contrasts : iterable of float
        Contrasts, each as for `cdp`; for equal steps see `contrast_range`.

    Returns
    -------
    tuple of CdpResult
        One for each contrast.

    Raises
    ------
    InputError
        As `cdp`.
    """
    asked = [TargetContrast(contrast, epsilon, definition) for contrast in contrasts]
    return _results(*bright_and_dark(a, b), asked)


def _results(
    bright: Distribution, dark: Distribution, bright_name: Literal["a", "b"], asked: Iterable[TargetContrast]
) -> tuple[CdpResult, ...]:
    return tuple(
        result_of_tally(tally_pairs(bright, dark, one.low, one.high), bright, dark, bright_name, one) for one in asked
    )


def result_of_tally(
    tally: PairTally,
    bright: Distribution,
    dark: Distribution,
    bright_name: Literal["a", "b"],
    asked: TargetContrast,
    variance_inflation: float = 1.0,
) -> CdpResult:
    """Make the result of a tally; its variance is that of independent pixels times `variance_inflation`."""
    standard_error, interval = nan, (nan, nan)
    if bright.size is not None and dark.size is not None:
        variance = variance_inflation * unbiased_variance(
            tally.inside, tally.inside_per_dark, dark.weights, tally.inside_per_bright, bright.weights
        )
        standard_error = sqrt(variance)
        # Effective number of independent pixels.
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
