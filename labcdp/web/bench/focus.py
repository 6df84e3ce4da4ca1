"""How sharp a part of an image is."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def sharpness(values: NDArray[Any]) -> float:
    """Compute the variance of the Laplacian over the squared mean.

    The Laplacian is that of means of 2 x 2 pixels: a Bayer pattern does not count, and noise counts less. The value
    compares images of the same scene and exposure; the sharpest has the largest one.

    Parameters
    ----------
    values : ndarray of int or float, shape (height, width)
        The part, of at least 6 x 6 pixels.

    Returns
    -------
    float
        0 for a smaller part, or one without light.
    """
    import cv2

    height, width = (length // 2 * 2 for length in values.shape)
    if min(height, width) < 6:
        return 0.0
    blocks = cv2.resize(values[:height, :width], (width // 2, height // 2), interpolation=cv2.INTER_AREA)
    blocks = blocks.astype(np.float32)
    mean = float(blocks.mean())
    if mean <= 0:
        return 0.0
    inner = cv2.Laplacian(blocks, cv2.CV_32F)[1:-1, 1:-1]
    return float(inner.var()) / mean**2
