"""What is computed from the outline of a region alone, kept for the next image with the same one."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, wraps
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

#: Masks that are remembered, and pixels from which one is not: memory counts more than time there.
_MASKS, _TOO_LARGE = 16, 2**18
_Result = TypeVar("_Result")
_Mask = NDArray[np.bool_]


def kept_by_mask(function: Callable[[_Mask], _Result]) -> Callable[[_Mask], _Result]:
    """Remember what a function returned for the last masks, ndarrays of bool, shape (height, width).

    Videos ask for the same outlines in each frame.
    """

    @lru_cache(maxsize=_MASKS)
    def of_bytes(shape: tuple[int, ...], pixels: bytes) -> _Result:
        return function(np.frombuffer(pixels, dtype=np.bool_).reshape(shape))

    @wraps(function)
    def of_mask(mask: _Mask) -> _Result:
        return function(mask) if mask.size >= _TOO_LARGE else of_bytes(mask.shape, mask.tobytes())

    return of_mask
