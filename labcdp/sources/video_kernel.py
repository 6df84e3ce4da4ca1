"""Stretching of Y' of limited range, pixel by pixel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..compiled import compiled

#: Black of Y' in limited range, and its span (ITU-R BT.601 and BT.709: 16 to 235 of 8 bits).
_BLACK, _SPAN = 16, 219


@compiled
def stretched(luma: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Y' of limited range, stretched to 0..255 and rounded; what lies beyond is cut off; any shape, contiguous."""
    full = np.empty_like(luma)
    stored, shown = luma.ravel(), full.ravel()
    for i in range(stored.size):
        above = np.uint32(min(max(stored[i], np.uint8(_BLACK)), np.uint8(_BLACK + _SPAN)) - np.uint8(_BLACK))
        # Half of the divisor rounds; it is odd, so that no value lies in the middle.
        shown[i] = np.uint8((np.uint32(510) * above + np.uint32(_SPAN)) // np.uint32(2 * _SPAN))
    return full
