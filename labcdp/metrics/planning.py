"""Number of pixels of a region for a required standard error of its CDP."""

from __future__ import annotations

from math import ceil, sqrt

from ..core.errors import InputError
from .distribution import Distribution, Region
from .interval import ContrastDefinition, Epsilon, TargetContrast
from .pairs import bright_and_dark, tally_pairs
from .uncertainty import scatter


def pixels_needed(
    a: Region,
    b: Region,
    contrast: float,
    epsilon: Epsilon = 0.5,
    *,
    standard_error: float,
    definition: ContrastDefinition = "weber",
) -> int:
    """Compute the number of pixels of each of two regions for a required standard error of their CDP.

    Parameters
    ----------
    a, b : array_like of int or float of any shape, or Distribution
        Representative regions: a pilot measurement of two pixels or more each, or distributions, such as
        ``Distribution.normal(mean, std)``.
    contrast, epsilon, definition
        As for `cdp`.
    standard_error : float
        Required standard error, above 0 and up to 0.5; for a 95 % interval of +- h, give h / 1.96.

    Returns
    -------
    int
        Pixels of each region, two or more, rounded up.

    Raises
    ------
    InputError
        As `cdp`; and if the standard error is out of range, a region of the pilot has one pixel only, or all pairs
        agree, so that there is no scatter.

    Notes
    -----
    For two regions of n pixels the variance of the CDP is [(n - 1) (zeta10 + zeta01) + zeta11] / n^2 (Hoeffding 1948;
    see `uncertainty.unbiased_variance`), which is solved for n. The zetas of a pilot are estimated without bias: with m
    dark pixels the sample variance of q exceeds zeta01 by (zeta11 - zeta10 - zeta01) / m, and likewise that of p. Both
    regions are assumed to be equally large and the pixels independent; with correlated noise, multiply by the square of
    `CdpResult.correlation_inflation`.
    """
    asked = TargetContrast(contrast, epsilon, definition)
    if not 0 < standard_error <= 0.5:
        raise InputError(f"standard_error is {standard_error}: give a number above 0, up to 0.5")
    bright, dark, _ = bright_and_dark(a, b)
    single, pair = _zetas(bright, dark, asked)
    if pair == 0:
        raise InputError(
            "all pairs agree, so there is no scatter to plan with: take a larger pilot or another contrast"
        )
    wanted = standard_error**2
    n = (single + sqrt(single**2 + 4 * wanted * (pair - single))) / (2 * wanted)
    # Rounding errors of an integer solution must not add a pixel.
    return max(ceil(n * (1 - 1e-12)), 2)


def _zetas(bright: Distribution, dark: Distribution, asked: TargetContrast) -> tuple[float, float]:
    """Return zeta10 + zeta01, and zeta11."""
    tally = tally_pairs(bright, dark, asked.low, asked.high)
    inverse_sizes, variances = 0.0, 0.0
    for region, shares in ((bright, tally.inside_per_bright), (dark, tally.inside_per_dark)):
        if region.size == 1:
            raise InputError("a region of the pilot has one pixel only: give two or more")
        inverse_sizes += 0.0 if region.size is None else 1 / region.size
        freedom = region.total if region.size is None else region.size - 1
        variances += scatter(shares, region.weights, tally.inside) / freedom
    pair = tally.inside * (1 - tally.inside)
    # Expected: variances = single + (pair - single) * inverse_sizes.
    single = pair - (pair - variances) / (1 - inverse_sizes) if inverse_sizes < 1 else pair
    return min(max(single, 0.0), pair), pair
