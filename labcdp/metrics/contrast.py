"""Weber and Michelson contrast."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .distribution import Region, numeric_array
from .pairs import bright_and_dark


def weber_contrast(bright: ArrayLike, dark: ArrayLike) -> NDArray[np.float64]:
    """Weber contrast K = bright / dark - 1, a fraction (1.0 is 100 %).

    Parameters
    ----------
    bright, dark : array_like of int or float
        Values in one linear unit, of broadcastable shapes.

    Returns
    -------
    ndarray of float64
        Contrast, of the common shape. Where dark is 0 or below: inf if bright is above 0, nan if it is not.

    Raises
    ------
    InputError
        If the values are not integers or floats of at most 64 bit.

    Notes
    -----
    The form of Weber contrast that CDP is defined with (L. Ebbert, Implementierung von CDP, 2018). For detection
    probabilities use `cdp`, which rounds no quotient.
    """
    upper = numeric_array(bright, "bright").astype(np.float64)
    lower = numeric_array(dark, "dark").astype(np.float64)
    lit = lower > 0
    return np.where(lit, upper / np.where(lit, lower, 1) - 1, np.where(upper > 0, np.inf, np.nan))


def weber_contrast_of_means(a: Region, b: Region) -> float:
    """Weber contrast of the means of two regions, larger over smaller: at least 0.

    Parameters
    ----------
    a, b : array_like of int or float of any shape, or Distribution
        Pixels of the two regions in one linear unit.

    Returns
    -------
    float
        A fraction; inf if the smaller mean is 0 or below, nan if both are.

    Raises
    ------
    InputError
        If a region cannot be used, or neither holds a value above 0.
    """
    bright, dark, _ = bright_and_dark(a, b)
    return float(weber_contrast(bright.mean, dark.mean))


def michelson_contrast(bright: ArrayLike, dark: ArrayLike) -> NDArray[np.float64]:
    """Michelson contrast M = (bright - dark) / (bright + dark), a fraction (1.0 is 100 %).

    Parameters
    ----------
    bright, dark : array_like of int or float
        Values in one linear unit, of broadcastable shapes. Values below 0 count as 0.

    Returns
    -------
    ndarray of float64
        Contrast from -1 to 1, of the common shape; nan where no value is above 0.

    Raises
    ------
    InputError
        If the values are not integers or floats of at most 64 bit.

    Notes
    -----
    A. A. Michelson, Studies in Optics, 1927 (visibility). With Weber contrast K: M = K / (K + 2). For detection
    probabilities use `cdp` with definition 'michelson', which rounds no quotient.
    """
    upper = np.maximum(numeric_array(bright, "bright").astype(np.float64), 0)
    lower = np.maximum(numeric_array(dark, "dark").astype(np.float64), 0)
    total = upper + lower
    lit = total > 0
    return np.where(lit, (upper - lower) / np.where(lit, total, 1), np.nan)
