"""Signal-to-noise ratios in a map, and their valid values."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Variables of a map that are ratios of mean to standard deviation.
SNR_VARIABLES = ("snr_dark", "snr_bright", "csnr")

#: SNR above which the noise is only rounding, as where all pixels are saturated: shot noise would need a full well of
#: 1e12 electrons.
LARGEST_SNR = 1e6


def known_values(name: str, values: NDArray[Any]) -> NDArray[np.float64]:
    """Return the values of a variable, with nan for an SNR that is infinite or due to missing noise.

    Parameters
    ----------
    name : str
        Name of the variable; all but `SNR_VARIABLES` are unchanged.
    values : ndarray of numbers, any shape
        Its values.
    """
    known = np.asarray(values, dtype=np.float64)
    return np.where(np.abs(known) <= LARGEST_SNR, known, np.nan) if name in SNR_VARIABLES else known
