"""Ratios of mean to standard deviation in a map, and which of their values count."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Ratios of mean to standard deviation that a map may hold.
SNR_VARIABLES = ("snr_dark", "snr_bright", "csnr")

#: SNR beyond which there is no noise but that of rounding, as where all pixels are saturated: no sensor of 1e12
#: electrons of full well exists, which shot noise would need.
LARGEST_SNR = 1e6


def known_values(name: str, values: NDArray[Any]) -> NDArray[np.float64]:
    """Return the values of a variable, nan in place of an SNR that is infinite or means that there is no noise.

    Parameters
    ----------
    name : str
        Name of the variable; all but `SNR_VARIABLES` stay as they are.
    values : ndarray of numbers, any shape
        Its values.
    """
    known = np.asarray(values, dtype=np.float64)
    return np.where(np.abs(known) <= LARGEST_SNR, known, np.nan) if name in SNR_VARIABLES else known
