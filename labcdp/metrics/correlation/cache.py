"""Cache of quantities that depend only on a region's mask, for further images with the same mask."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, wraps
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

#: Number of cached masks, and pixels from which a mask is not cached, to limit memory.
_MASKS, _TOO_LARGE = 16, 2**18
_Result = TypeVar("_Result")
_Mask = NDArray[np.bool_]


def kept_by_mask(function: Callable[[_Mask], _Result]) -> Callable[[_Mask], _Result]:
    """Cache the results of a function for the last masks, ndarrays of bool, shape (height, width).

    Videos use the same masks in each frame.
    """

    @lru_cache(maxsize=_MASKS)
    def of_bytes(shape: tuple[int, ...], pixels: bytes) -> _Result:
        return function(np.frombuffer(pixels, dtype=np.bool_).reshape(shape))

    @wraps(function)
    def of_mask(mask: _Mask) -> _Result:
        return function(mask) if mask.size >= _TOO_LARGE else of_bytes(mask.shape, mask.tobytes())

    return of_mask
