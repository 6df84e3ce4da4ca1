"""Notices that the scene changes at once, or is not to be seen at all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Size of the picture that is compared from frame to frame.
_SIZE = 48, 32
#: Correlation of two pictures in a row below which the scene is another one.
_LEAST_CORRELATION = 0.5
#: Standard deviation of the picture in DN below which nothing is seen in it.
_BLANK_DN = 0.7


class SceneWatch:
    """Compares each frame, made small, with the one before."""

    def __init__(self, grey: NDArray[np.uint8]) -> None:
        self._last = _small(grey)

    def look(self, grey: NDArray[np.uint8]) -> str:
        """Say ``blank`` for a frame with nothing in it, ``cut`` for another scene, else an empty text."""
        small = _small(grey)
        if float(small.std()) < _BLANK_DN:
            return "blank"
        last, self._last = self._last, small
        a, b = small - small.mean(), last - last.mean()
        powers = float(np.vdot(a, a)) * float(np.vdot(b, b))
        return "cut" if powers == 0 or float(np.vdot(a, b)) < _LEAST_CORRELATION * powers**0.5 else ""


def _small(grey: NDArray[np.uint8]) -> NDArray[np.float32]:
    import cv2

    # Every third row and column is enough, and quick.
    step = max(min(grey.shape[0] // 150, grey.shape[1] // 200), 1)
    part = np.ascontiguousarray(grey[::step, ::step])
    small: NDArray[np.float32] = cv2.resize(part, _SIZE, interpolation=cv2.INTER_AREA).astype(np.float32)
    return small
