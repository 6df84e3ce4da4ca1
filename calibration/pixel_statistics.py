"""Mean and variance of every pixel over the frames of one exposure."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..errors import CalibrationError
from ..frame import Frame
from .observations import CameraState
from .region_statistics import quantisation_variance_dn2


@dataclass(frozen=True, eq=False)
class PixelStatistics:
    """What the frames of one exposure say about each pixel.

    Parameters
    ----------
    mean_dn : ndarray of float, shape (height, width)
        Mean over the frames.
    variance_dn2 : ndarray of float, shape (height, width)
        Variance over the frames (n - 1); 0 for a single frame.
    clipped : ndarray of bool, shape (height, width)
        Pixels that were saturated or at 0 DN in at least one frame.
    n_frames : int
        How many frames.
    exposure_s : float
        Their exposure time.
    temperature_c : float or None
        Mean temperature of the device, None if a frame does not tell.
    state : CameraState
        Camera and settings.
    """

    mean_dn: NDArray[np.float64]
    variance_dn2: NDArray[np.float64]
    clipped: NDArray[np.bool_]
    n_frames: int
    exposure_s: float
    temperature_c: float | None
    state: CameraState

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""
        height, width = self.mean_dn.shape
        return height, width

    @cached_property
    def typical_variance_dn2(self) -> float:
        """Variance over the frames of a typical pixel: the mean, in which the noisiest thousandth counts no more."""
        return float(np.minimum(self.variance_dn2, np.quantile(self.variance_dn2, 0.999)).mean())

    @property
    def mean_variance_dn2(self) -> float:
        """Variance of the mean of a typical pixel, by noise and by what rounding leaves."""
        return self.typical_variance_dn2 / self.n_frames + quantisation_variance_dn2(self.typical_variance_dn2)


def pixel_statistics(frames: Iterable[Frame]) -> PixelStatistics:
    """Mean and variance of each pixel, from frames taken one by one and not kept.

    Integer sums are exact; the variance is taken of differences from the first frame, so that it does not lose its
    digits.

    Parameters
    ----------
    frames : iterable of Frame
        At least one; all of one exposure, camera and setting.

    Raises
    ------
    CalibrationError
        If there is no frame, or frames differ in exposure, camera or setting.
    """
    first: Frame | None = None
    temperatures: list[float | None] = []
    for frame in frames:
        if first is None:
            first, state = frame, CameraState.of(frame)
            reference = frame.dn.astype(np.int64)
            total, squares = np.zeros_like(reference), np.zeros_like(reference)
            clipped = np.zeros(frame.shape, dtype=np.bool_)
        state.require(CameraState.of(frame), "the first frame", f"frame {frame.frame_id}")
        if frame.exposure_s != first.exposure_s:
            raise CalibrationError(
                f"frame {frame.frame_id} has an exposure of {frame.exposure_s:g} s, the first frame "
                f"{first.exposure_s:g} s: give frames of one exposure at a time"
            )
        difference = frame.dn - reference
        total += difference
        squares += difference**2
        clipped |= frame.saturated | np.equal(frame.dn, 0)
        temperatures.append(frame.temperature_c)
    if first is None:
        raise CalibrationError("there is no frame: give at least one frame of each exposure")
    n = len(temperatures)
    known = [value for value in temperatures if value is not None]
    return PixelStatistics(
        mean_dn=reference + total / n,
        variance_dn2=np.maximum(squares - total**2 / n, 0) / max(n - 1, 1),
        clipped=clipped,
        n_frames=n,
        exposure_s=first.exposure_s,
        temperature_c=sum(known) / n if len(known) == n else None,
        state=state,
    )
