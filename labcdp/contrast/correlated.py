"""Contrast detection probability with a standard error for noise that is correlated from pixel to pixel."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from .correlation import inflation_of_scores, variance_inflation
from .detection import result_of_tally
from .distribution import Distribution
from .image import image_array, mask_array
from .interval import AskedContrast, ContrastDefinition, Epsilon
from .pairs import bright_and_dark, tally_pairs
from .result import CdpResult


def cdp_correlated(
    image: ArrayLike,
    mask_a: ArrayLike,
    mask_b: ArrayLike,
    contrast: float,
    epsilon: Epsilon = 0.5,
    *,
    definition: ContrastDefinition = "weber",
) -> CdpResult:
    """Contrast detection probability between two regions of an image whose noise may be correlated.

    Parameters
    ----------
    image : array_like of int or float, shape (height, width)
        Image in one linear unit, best cd/m^2.
    mask_a, mask_b : array_like of bool, shape (height, width)
        Pixels of the two regions, of any outline, without a common pixel. The scene must be uniform in each.
    contrast, epsilon, definition
        As for `cdp`.

    Returns
    -------
    CdpResult
        As from `cdp` of the two regions, but with standard error and interval for the correlation found in them, and
        with the factor of the standard error as `correlation_inflation`.

    Raises
    ------
    InputError
        As `cdp`; and if the image is not of two dimensions, or a mask not boolean, of another shape or empty, or the
        masks overlap.

    Notes
    -----
    By far the largest part of the variance of a CDP is that of the means of two quantities: the share p of the bright
    pixels that a dark pixel is detected against, and likewise q of each bright pixel (Hoeffding's projection, see
    `uncertainty.unbiased_variance`). Where they are correlated from pixel to pixel, each of these two variances rises
    as `variance_inflation` says for p and q. As p and q follow the noise neither linearly nor perfectly, they are less
    correlated than the pixels.

    In simulations with two regions of 25 x 25 to 100 x 100 pixels, 95 % intervals covered the truth in 93 to 98 % of
    the cases for independent noise, for noise averaged over 3 x 3 pixels and for autoregressive noise. Noise common to
    both regions is not looked for: where both lay on the same rows and these had offsets of half the standard deviation
    of the pixels, the intervals covered the truth in 84 to 91 %.
    """
    asked = AskedContrast(contrast, epsilon, definition)
    pixels = image_array(image)
    masks = {
        "a": mask_array(mask_a, pixels.shape, "mask_a"),
        "b": mask_array(mask_b, pixels.shape, "mask_b"),
    }
    common = np.count_nonzero(masks["a"] & masks["b"])
    if common:
        raise InputError(f"mask_a and mask_b have {common} pixels in common: give two regions that do not overlap")
    bright, dark, bright_name = bright_and_dark(pixels[masks["a"]], pixels[masks["b"]])
    tally = tally_pairs(bright, dark, asked.low, asked.high)
    inflation = _pooled_inflation(
        pixels,
        [
            (masks[bright_name], bright, tally.inside_per_bright),
            (masks["b" if bright_name == "a" else "a"], dark, tally.inside_per_dark),
        ],
    )
    return result_of_tally(tally, bright, dark, bright_name, asked, inflation)


def _pooled_inflation(
    image: NDArray[Any], regions: Sequence[tuple[NDArray[np.bool_], Distribution, NDArray[np.float64]]]
) -> float:
    """Inflation of the variance of a share, from the mask, the values and the share of each value of both regions."""
    plain = inflated = 0.0
    for mask, region, shares in regions:
        each = shares[np.searchsorted(region.values, image[mask].astype(np.float64))]
        scores = np.zeros(image.shape)
        scores[mask] = each - each.mean()
        inflation = inflation_of_scores(scores, mask)
        if not isnan(inflation):
            scatter = float(each.var()) / each.size
            plain += scatter
            inflated += inflation * scatter
    if plain > 0:
        return inflated / plain
    # All pairs agree and tell nothing about correlation. That of the pixels themselves is the most there can be.
    of_pixels = [variance_inflation(image, mask) for mask, _, _ in regions]
    return max((inflation for inflation in of_pixels if not isnan(inflation)), default=1.0)
