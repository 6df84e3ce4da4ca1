"""Statistics of one region over a stream of frames, keeping only the region's own values."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import CalibrationError
from ..frame import Frame
from ..roi import Roi
from .unevenness import Unevenness, unevenness

#: Fewest pixels of a region: below, its noise and its unevenness cannot be told apart.
MIN_PIXELS = 16
#: Fewest frames: temporal noise comes from differences between them.
MIN_FRAMES = 2


@dataclass(frozen=True)
class RegionStatistics:
    """What is kept of a region.

    Parameters
    ----------
    mean_dn : float
        Mean over pixels and frames of DN times the factors given for the pixels.
    mean_factor : float
        Mean of these factors.
    n_pixels, n_frames : int
        How many were averaged.
    temporal_variance_dn2 : float
        Variance of one pixel from frame to frame, mean over the region; the factors are not applied.
    unevenness : Unevenness
        Of the mean frame times the factors.
    frame_means_variance_dn2 : float
        Variance of the region's mean from frame to frame.
    saturated_share, black_share : float
        Share of the values at or above saturation, and at DN 0.
    """

    mean_dn: float
    mean_factor: float
    n_pixels: int
    n_frames: int
    temporal_variance_dn2: float
    unevenness: Unevenness
    frame_means_variance_dn2: float
    saturated_share: float
    black_share: float


class RegionAccumulator:
    """Takes the frames of one exposure one by one; holds the region's sum and its last values.

    Parameters
    ----------
    region : Roi
        Which pixels.
    factor : ndarray of float, shape (height, width), or None
        Factor for each pixel of the frame (1 / V), None for 1.
    sound : ndarray of bool, shape (height, width), or None
        Pixels that may be used, None for all.
    pattern_dn : ndarray of float, shape (height, width), or None
        Subtracted from the mean frame, None for 0.

    Raises
    ------
    CalibrationError
        When a frame is added in which the region holds fewer than `MIN_PIXELS` pixels.
    """

    def __init__(
        self,
        region: Roi,
        factor: NDArray[np.float64] | None,
        sound: NDArray[np.bool_] | None = None,
        pattern_dn: NDArray[np.floating[Any]] | None = None,
    ) -> None:
        self._region = region
        self._sound = None if sound is None else region.select(sound)
        self._factor = np.ones(1) if factor is None else self._select(factor)
        self._pattern_dn = np.zeros(1) if pattern_dn is None else self._select(pattern_dn).astype(float)
        self._sum: NDArray[np.float64] | None = None
        self._last: NDArray[np.int32] | None = None
        self._shape: tuple[int, int] = (0, 0)
        self._frame_means: list[float] = []
        self._pair_variances: list[float] = []
        self._saturated = 0
        self._black = 0
        self._at = ""

    def add(self, frame: Frame) -> None:
        """Take one frame's values."""
        values = self._select(frame.dn).astype(np.int32)
        if values.size < MIN_PIXELS:
            raise CalibrationError(
                f"region {self._region.name!r} holds {values.size} pixels: make it at least {MIN_PIXELS}"
            )
        if self._sum is None or self._last is None:
            self._sum, self._shape = np.zeros(values.size), frame.shape
            self._at = f" at {frame.exposure_s:g} s"
        else:
            # EMVA 1288 Release 4.0 Linear: half the variance of a pair's difference. Lamp flicker drops out.
            self._pair_variances.append(float(np.var(values - self._last, ddof=1)) / 2)
        self._sum += values
        self._last = values
        self._frame_means.append(float(values.mean()))
        self._saturated += int(np.count_nonzero(values >= frame.saturation_dn))
        self._black += int(np.count_nonzero(values == 0))

    def result(self) -> RegionStatistics:
        """Return the statistics of what was added; raises CalibrationError below `MIN_FRAMES` frames."""
        n_frames = len(self._frame_means)
        if self._sum is None or n_frames < MIN_FRAMES:
            found = f"{n_frames} frame{'s' if n_frames != 1 else ''}{self._at}"
            raise CalibrationError(
                f"region {self._region.name!r} was given {found}: take at least {MIN_FRAMES} of each exposure, the "
                "noise comes from their difference"
            )
        factor = self._factor
        mean_frame = (self._sum / n_frames - self._pattern_dn) * factor
        n_values = mean_frame.size * n_frames
        return RegionStatistics(
            mean_dn=float(mean_frame.mean()),
            mean_factor=float(factor.mean()),
            n_pixels=mean_frame.size,
            n_frames=n_frames,
            temporal_variance_dn2=float(np.mean(self._pair_variances)),
            unevenness=unevenness(mean_frame, np.broadcast_to(factor, mean_frame.shape), self._cells()),
            frame_means_variance_dn2=float(np.var(self._frame_means, ddof=1)),
            saturated_share=self._saturated / n_values,
            black_share=self._black / n_values,
        )

    def _select(self, image: NDArray[Any]) -> NDArray[Any]:
        values = self._region.select(image)
        return values if self._sound is None else values[self._sound]

    def _cells(self) -> NDArray[np.intp]:
        rows, columns = self._region.window(self._shape)
        mask = self._region.mask(self._shape)
        # Four by four shows a gradient and a hot spot; small regions keep enough pixels in each cell.
        side = 4 if np.count_nonzero(mask) >= 256 else 2
        height, width = rows.stop - rows.start, columns.stop - columns.start
        row = np.arange(height) * side // height
        column = np.arange(width) * side // width
        cells: NDArray[np.intp] = (row[:, None] * side + column[None, :])[mask]
        return cells if self._sound is None else cells[self._sound]


def quantisation_variance_dn2(variance_dn2: float) -> float:
    """Variance that rounding to whole DN leaves in the mean of any number of pixels.

    Noise dithers the rounding. With normal noise of standard deviation s DN the mean of rounded values is off by a
    Fourier series in the mean, with variance sum_k exp(-4 pi^2 k^2 s^2) / (2 pi^2 k^2) over all offsets (B. Widrow
    and I. Kollar, Quantization Noise, 2008); exp(-4 pi^2 s^2) / 12 bounds it and is exact without noise.

    Parameters
    ----------
    variance_dn2 : float
        Variance of the rounded values over pixels and frames, which holds about 1/12 DN^2 of rounding itself.
    """
    return exp(-4 * pi**2 * max(variance_dn2 - 1 / 12, 0.0)) / 12
