"""Contrast detection probability of arrays of pixels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.percent import plain_fraction
from ..core.result import Finding, info
from .contrast import ContrastDefinition, Epsilon
from .correlated_cdp import NoisyRegion, cdp_of_regions, size_findings
from .detection import count_cdp
from .distribution import Distribution, Region
from .pairs import bright_and_dark
from .result import Cdp, target_contrasts


@overload
def cdp(
    bright: Region,
    dark: Region,
    contrast: float | str,
    epsilon: Epsilon | str = ...,
    *,
    definition: ContrastDefinition = ...,
) -> Cdp[float]: ...
@overload
def cdp(
    bright: Region,
    dark: Region,
    contrast: Sequence[float] | list[str] | list[float | str] | NDArray[Any],
    epsilon: Epsilon | str = ...,
    *,
    definition: ContrastDefinition = ...,
) -> Cdp[NDArray[np.float64]]: ...
def cdp(
    bright: Region,
    dark: Region,
    contrast: ArrayLike,
    epsilon: Epsilon | str = 0.5,
    *,
    definition: ContrastDefinition = "weber",
) -> Cdp[Any]:
    """Contrast detection probability between two regions, over every pixel of one against every pixel of the other.

    Parameters
    ----------
    bright, dark : array_like of int or float of any shape, or Distribution
        Pixels of the two regions in one linear unit, best cd/m^2. Arrays of two dimensions are taken as parts of an
        image, whose noise may be correlated from pixel to pixel, all others as independent pixels.
    contrast : float, str or array_like of them
        Contrast K to be detected, a fraction above 0 (1.0 is 100 %) or a percentage such as "50%", or several; the
        pixels are then counted once. A whole number from 20 on is taken for a percentage without its sign and refused.
    epsilon : float, str or DetectionInterval
        Relative tolerance of the contrast, above 0 and up to 1, or a percentage; a `DetectionInterval` for
        one that differs below and above or has one end only.
    definition : {'weber', 'michelson'}
        Definition of the contrast of K and of the pairs. Michelson contrasts are below 1.

    Returns
    -------
    Cdp
        With floats for a number, and arrays of the contrasts' shape for an array. `findings` says by how much
        correlated noise raises `u`, and which regions are too small to tell.

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

    Examples
    --------
    >>> import labcdp
    >>> bright, dark = [120, 125, 118, 121], [100, 98, 103, 99]
    >>> labcdp.cdp(bright, dark, "20%", epsilon="50%").cdp
    1.0
    >>> labcdp.cdp(bright, dark, [0.1, 0.2, 0.4]).cdp
    array([0.0625, 1.    , 0.6875])
    """
    targets, shape = target_contrasts(contrast, epsilon, definition)
    upper, lower, name = bright_and_dark(bright, dark, ("bright region", "dark region"))
    images = None if isinstance(bright, Distribution) or isinstance(dark, Distribution) else _images(bright, dark)
    if images is None:
        result = count_cdp(upper, lower, targets, swapped=name == "b")
    else:
        first, second = images if name == "a" else images[::-1]
        regions = _region(first, upper, 0), _region(second, lower, first.shape[0] + first.shape[1])
        result = cdp_of_regions(*regions, targets, swapped=name == "b")
        findings = _findings(result, dict(zip(("bright", "dark"), images, strict=True)))
        result = replace(result, findings=findings)
    return replace(result.reshape(shape), epsilon=plain_fraction(epsilon), definition=definition)


def _images(bright: ArrayLike, dark: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return the regions if both are parts of an image; those of one pixel or of one line have no second dimension."""
    images = [np.asarray(region, dtype=np.float64) for region in (bright, dark)]
    return (images[0], images[1]) if all(image.ndim == 2 and min(image.shape) > 1 for image in images) else None


def _region(image: NDArray[np.float64], distribution: Distribution, start: int) -> NoisyRegion:
    """Take all pixels of an image; regions in rows and columns of their own have none in common."""
    window = slice(start, start + image.shape[0]), slice(start, start + image.shape[1])
    return NoisyRegion(image, np.ones(image.shape, dtype=np.bool_), distribution, window)


def _findings(result: Cdp[NDArray[np.float64]], images: Mapping[str, NDArray[np.float64]]) -> tuple[Finding, ...]:
    sizes = [finding for name, image in images.items() for finding in size_findings(name, image.size)]
    inflation = float(result.correlation_inflation.max(initial=1.0))
    return (*sizes, *([info("pixels-correlated", inflation=inflation)] if inflation > 1 else []))
