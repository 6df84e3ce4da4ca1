"""Two regions of a video's frame: only rows and columns that hold them are converted to light."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ....core.frame import Frame
from ....core.roi import Roi
from ....metrics import Epsilon
from ....metrics.regions.pair import PairResult, evaluate_regions, require_apart
from ....metrics.regions.region import RegionPixels
from ...picture.light.picture import PictureConversion


def evaluate_frame_pair(
    frame: Frame, conversion: PictureConversion, rois: Sequence[Roi], contrasts: Sequence[float], epsilon: Epsilon
) -> PairResult:
    """Evaluate two regions of a frame as `labcdp.metrics.regions.pair.evaluate_pair` does.

    Parameters
    ----------
    frame : Frame
        The frame.
    conversion : PictureConversion
        To light.
    rois : sequence of two Roi
        The regions, in any order.
    contrasts : sequence of float
        Contrasts to be detected.
    epsilon : float or DetectionInterval
        Their tolerance.

    Raises
    ------
    InputError
        If a region lies outside the frame or holds no pixel, the regions have pixels in common, or neither has a pixel
        above 0.
    CalibrationError
        If the conversion is not for such frames.
    """
    first, second = (_region(frame, conversion, roi) for roi in rois)
    require_apart(first.placed, second.placed)
    return evaluate_regions(first, second, contrasts, epsilon)


def _region(frame: Frame, conversion: PictureConversion, roi: Roi) -> RegionPixels:
    # A pixel of the map stands for a group of the colour filter.
    group = 1 if frame.colour_filter is None else 2
    shape = (frame.shape[0] // group, frame.shape[1] // group)
    region = roi if group == 1 else Roi(roi.name, tuple((x / group, y / group) for x, y in roi.corners))
    window, mask = region.window(shape), _mask(region, shape)
    by_dn = group == 1 and frame.dn.dtype == np.uint8
    light = conversion.convert(frame, window)
    return RegionPixels.of_part(light, roi, window, mask, dn=frame.dn[window] if by_dn else None)


@lru_cache(maxsize=16)
def _mask(roi: Roi, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Mask of a region; that of one that stays is kept."""
    mask = roi.mask(shape)
    mask.flags.writeable = False
    return mask
