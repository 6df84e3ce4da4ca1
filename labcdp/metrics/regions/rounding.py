"""Error of the mean of pixels by rounding to whole digital numbers."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray


def rounding_uncertainty_dn(std_dn: float) -> float:
    """Return the standard uncertainty in DN by which rounding shifts the mean of pixels: sqrt((1/4 - s^2) / 3).

    Parameters
    ----------
    std_dn : float
        s, standard deviation of the pixels after rounding.

    Returns
    -------
    float
        1 / sqrt(12) where all pixels have one DN, 0 where they scatter by half a DN or more: noise then dithers the
        rounding (B. Widrow and I. Kollar, Quantization Noise, 2008).

    Notes
    -----
    Pixels with noise of less than half a DN have two DN, a share p of them the upper one, and s^2 = p (1 - p). With
    negligible noise the true value lies midway between both, and the error of the mean is 1/2 - p; with more noise it
    is smaller. Errors in between are assumed to be equally likely.
    """
    return sqrt(max(0.25 - std_dn**2, 0.0) / 3)


def rounding_uncertainty(std: float, steps: NDArray[np.floating[Any]] | float) -> float:
    """Return the standard uncertainty in luminance by which rounding shifts the mean of a region.

    Parameters
    ----------
    std : float
        Standard deviation of its pixels; nan for a single one.
    steps : ndarray of float, shape (n,), or float
        Luminance difference between successive DN at each pixel; 0 where nothing was rounded.
    """
    step = float(np.mean(steps))
    if not step > 0:
        return 0.0
    return step * rounding_uncertainty_dn(std / step if std >= 0 else 0.0)
