"""How a picture lies in its file, and upright."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

#: EXIF orientations (CIPA DC-008, tag 274) by the signs of a display matrix: what column and row add to x, and to y.
_OF_MATRIX = {
    (1, 0, 0, 1): 1, (-1, 0, 0, 1): 2, (-1, 0, 0, -1): 3, (1, 0, 0, -1): 4,
    (0, 1, 1, 0): 5, (0, 1, -1, 0): 6, (0, -1, -1, 0): 7, (0, -1, 1, 0): 8,
}  # fmt: skip


def upright(values: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Values of a picture as it is to be seen; shape (height, width) or with colours."""
    if orientation > 4:
        values = values.swapaxes(0, 1)
    if orientation in (2, 3, 6, 7):
        values = values[:, ::-1]
    if orientation in (3, 4, 7, 8):
        values = values[::-1]
    return np.ascontiguousarray(values)


def orientation_of_matrix(matrix: bytes) -> int | None:
    """EXIF orientation of FFmpeg's display matrix (nine 32-bit integers); None if it is no multiple of 90 degrees."""
    a, b, _, c, d = np.sign(np.frombuffer(matrix, np.int32, 5))
    return _OF_MATRIX.get((int(a), int(b), int(c), int(d)))
