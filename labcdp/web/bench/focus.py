"""How sharp a part of an image is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.frame import Frame
from ...core.roi import Roi

#: Largest side of the middle of an image, where no region is meant.
_MIDDLE_PX = 600


@dataclass(frozen=True)
class Focus:
    """Sharpness of a region, and the largest of the same region so far.

    Parameters
    ----------
    region : str
        Its name; empty for the middle of the image.
    exposure_s : float
        Exposure of the image; another one makes the noise another.
    now, best : float
        As of `sharpness`.
    """

    region: str = ""
    exposure_s: float = 0.0
    now: float = 0.0
    best: float = 0.0

    def after(self, frame: Frame, roi: Roi | None) -> Focus:
        """Return the focus after another frame: of a region, or of the middle."""
        values = frame.dn
        rows, columns = (_middle(length) for length in values.shape)
        if roi is not None:
            try:
                rows, columns = roi.window((values.shape[0], values.shape[1]))
            except InputError:
                rows = slice(0)
        name, now = "" if roi is None else roi.name, sharpness(values[rows, columns])
        same = (name, frame.exposure_s) == (self.region, self.exposure_s)
        return Focus(name, frame.exposure_s, now, max(now, self.best if same else 0.0))


def _middle(length: int) -> slice:
    side = min(length // 2, _MIDDLE_PX)
    return slice((length - side) // 2, (length + side) // 2)


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
