"""Regions that stay where they are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.roi import Roi
from .tracker import TrackedRoi, grey_frame

#: Pixels around a region that are compared with the first frame.
_MARGIN_PX = 8


class FixedTracker:
    """Leaves regions in place; their quality is the correlation with the first frame, and none is ever lost.

    This assumes that nothing moves: changes in place are those of the light or of the measured quantity.
    """

    def __init__(self, grey: NDArray[Any], rois: Sequence[Roi]) -> None:
        self._shape, self._dtype = (grey.shape[0], grey.shape[1]), grey.dtype
        self._rois = tuple(rois)
        self._windows = tuple(_window(roi, self._shape) for roi in rois)
        self._first = tuple(_deviations(grey[window]) for window in self._windows)

    def update(self, grey: NDArray[Any]) -> tuple[TrackedRoi, ...]:
        """Compare the next frame with the first one; see `Tracker`."""
        frame = grey_frame(grey, self._shape, self._dtype)
        return tuple(
            TrackedRoi(roi, _correlation(first, _deviations(frame[window])), False)
            for roi, window, first in zip(self._rois, self._windows, self._first, strict=True)
        )


def _window(roi: Roi, shape: tuple[int, int]) -> tuple[slice, slice]:
    rows, columns = roi.window(shape)
    return (
        slice(max(rows.start - _MARGIN_PX, 0), rows.stop + _MARGIN_PX),
        slice(max(columns.start - _MARGIN_PX, 0), columns.stop + _MARGIN_PX),
    )


def _deviations(pixels: NDArray[Any]) -> NDArray[np.float32]:
    values = pixels.astype(np.float32)
    deviations: NDArray[np.float32] = values - np.float32(values.mean(dtype=np.float64))
    return deviations


def _correlation(a: NDArray[np.float32], b: NDArray[np.float32]) -> float:
    """Correlation of two images of mean 0, nothing below 0; 1 if both are constant, 0 if one is."""
    power_a, power_b = float(np.vdot(a, a)), float(np.vdot(b, b))
    if power_a == 0 or power_b == 0:
        return 1.0 if power_a == power_b else 0.0
    correlation = float(np.vdot(a, b)) / float(np.sqrt(power_a * power_b))
    return min(max(correlation, 0.0), 1.0)
