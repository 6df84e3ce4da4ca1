"""Light by DN of a video's frames, if nothing but the DN decides it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....core.frame import Frame
from ...picture.light.picture import PictureConversion


def light_by_dn(frame: Frame, conversion: PictureConversion) -> NDArray[np.floating[Any]] | None:
    """Light of each DN of frames such as this one.

    Frames of all DN, each at many places, are converted to see it: vignetting, flat field or dark pattern make the
    light depend on the position, veiling glare on the rest of the picture.

    Parameters
    ----------
    frame : Frame
        One of the frames.
    conversion : PictureConversion
        Their conversion.

    Returns
    -------
    ndarray of float, shape (256,), or None
        None for frames of more than 8 bits or with a colour filter, or if more than the DN decides.

    Raises
    ------
    CalibrationError
        If the conversion is not for such frames.
    """
    if frame.dn.dtype != np.uint8 or frame.colour_filter is not None or frame.dn.size < 512:
        return None
    table: NDArray[np.floating[Any]] | None = None
    for highest in (255, 63):
        dn = _any_places(np.resize(np.arange(highest + 1, dtype=np.uint8), frame.shape))
        light = conversion.convert(frame.with_pixels(dn)).luminance_cd_m2
        of_level = np.zeros(highest + 1, light.dtype)
        of_level[dn] = light
        if not np.array_equal(of_level[dn], light):
            return None
        if table is None:
            table = of_level
        elif not np.array_equal(table[: highest + 1], of_level):
            return None
    return table


def _any_places(dn: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Put values where they have nothing to do with rows and columns."""
    return np.random.default_rng(0).permutation(dn.ravel()).reshape(dn.shape)
