"""An exposure that fills the range of the converter."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Where the brightest pixels should be, as a share of the converter's range.
TARGET = 0.8
#: Shares of the range within which an exposure is good enough.
_GOOD = (0.7, 0.9)
#: Quantile that stands for the brightest pixels: single hot ones do not count.
_BRIGHTEST = 0.99
#: Step while pixels are saturated and nothing can be computed.
_STEP = 0.25


def better_exposure_s(
    values: NDArray[Any], exposure_s: float, bit_depth: int, limits_s: tuple[float, float]
) -> float | None:
    """Compute an exposure with which the brightest pixels are nearer to 80 % of the range.

    The black level is unknown and counted as light: a dark image needs several steps.

    Parameters
    ----------
    values : ndarray of int
        DN of the pixels that matter.
    exposure_s : float
        Exposure with which they were taken.
    bit_depth : int
        Bits of a DN.
    limits_s : (float, float)
        Shortest and longest exposure of the camera.

    Returns
    -------
    float or None
        The exposure; None if the present one is good, or no other is possible.
    """
    highest = 2.0**bit_depth - 1
    brightest = float(np.quantile(values, _BRIGHTEST))
    share = brightest / highest
    if _GOOD[0] <= share <= _GOOD[1]:
        return None
    factor = _STEP if share > 0.99 else TARGET * highest / max(brightest, 1.0)
    wanted_s = float(np.clip(exposure_s * factor, *limits_s))
    return None if np.isclose(wanted_s, exposure_s, rtol=0.01) else wanted_s
