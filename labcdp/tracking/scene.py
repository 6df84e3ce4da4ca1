"""Notices that the scene changes at once, or is not to be seen at all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .scene_kernel import deviations

#: Most rows and columns of the picture that is compared from frame to frame.
_SIZE = 32, 48
#: Rows and columns of the frame for each of these that are enough.
_TAKEN = 3, 10
#: Correlation of two pictures in a row below which the scene is another one.
_LEAST_CORRELATION = 0.5
#: Standard deviation of the picture in DN below which nothing is seen in it.
_BLANK_DN = 0.7


class SceneWatch:
    """Compares each frame, made small, with the one before."""

    def __init__(self, grey: NDArray[np.uint8]) -> None:
        self._last = _small(grey)
        self._last_power = float(np.vdot(self._last, self._last))

    def look(self, grey: NDArray[np.uint8]) -> str:
        """Say ``blank`` for a frame with nothing in it, ``cut`` for another scene, else an empty text."""
        this = _small(grey)
        power = float(np.vdot(this, this))
        if power < _BLANK_DN**2 * this.size:
            return "blank"
        last, self._last = self._last, this
        powers, self._last_power = power * self._last_power, power
        return "cut" if powers == 0 or float(np.vdot(this, last)) < _LEAST_CORRELATION * powers**0.5 else ""


def _small(grey: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Small picture of a frame, less its mean."""
    return deviations(grey, min(_SIZE[0], grey.shape[0]), min(_SIZE[1], grey.shape[1]), _TAKEN)
