"""Michelson contrast."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .distribution import numeric_array


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
