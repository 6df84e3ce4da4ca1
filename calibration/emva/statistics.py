"""Mean and variance of pixels over frames, exact, keeping no more than the sums."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class FrameStatistics:
    """Statistics of frames taken alike.

    Parameters
    ----------
    mean_dn : float
        Mean over pixels and frames.
    temporal_variance_dn2 : float
        Variance of one pixel from frame to frame, mean over the pixels; changes all pixels share are left out.
    n_pixels, n_frames : int
        How many there were.
    largest_share, black_share : float
        Share of the values at the last DN of the scale or above saturation, and at DN 0.
    multiple : int
        Largest power of two that divides all values, up to 16; 1 if a value is odd.
    spatial_variance_dn2 : float
        Variance of the pixels' means, less what temporal noise leaves in it; at least 0.
    frame_means_dn : tuple of float
        Mean of each frame.
    """

    mean_dn: float
    temporal_variance_dn2: float
    n_pixels: int
    n_frames: int
    largest_share: float
    black_share: float
    multiple: int
    spatial_variance_dn2: float
    frame_means_dn: tuple[float, ...]


@dataclass(frozen=True)
class NoiseParts:
    """What temporal noise leaves in the mean of some frames, in DN^2.

    Parameters
    ----------
    pixel, column, row : float
        Variance of a pixel, of the mean of a column, and of that of a row. Columns and rows have noise of their own in
        some cameras, which averages less than that of pixels.
    """

    pixel: float
    column: float
    row: float

    def scaled(self, factor: float) -> NoiseParts:
        """All of them times a factor."""
        return NoiseParts(self.pixel * factor, self.column * factor, self.row * factor)


class FrameSums:
    """Takes frames, or the values of a region in them, one by one; all have one shape.

    Parameters
    ----------
    saturation_dn : float
        DN from which a value counts as saturated.
    """

    def __init__(self, saturation_dn: float) -> None:
        self._saturation_dn = saturation_dn
        self._sum: NDArray[np.int64] | None = None
        self._squares: NDArray[np.int64] | None = None
        self._frame_means: list[float] = []
        self._columns: list[NDArray[np.float64]] = []
        self._rows: list[NDArray[np.float64]] = []
        self._saturated = 0
        self._black = 0
        self._bits = 0

    def add(self, dn: NDArray[np.unsignedinteger[Any]]) -> None:
        """Take one frame's values."""
        values = dn.astype(np.int64)
        if self._sum is None or self._squares is None:
            self._sum, self._squares = np.zeros_like(values), np.zeros_like(values)
        self._sum += values
        self._squares += values * values
        self._frame_means.append(float(values.mean()))
        if values.ndim == 2:
            self._columns.append(values.mean(axis=0))
            self._rows.append(values.mean(axis=1))
        self._saturated += int(np.count_nonzero(dn >= self._saturation_dn))
        self._black += int(np.count_nonzero(dn == 0))
        self._bits |= int(np.bitwise_or.reduce(dn, axis=None))

    @property
    def n_frames(self) -> int:
        """How many were added."""
        return len(self._frame_means)

    def mean_image(self) -> NDArray[np.float64]:
        """Mean of each pixel over the frames, shape as the frames."""
        assert self._sum is not None
        image: NDArray[np.float64] = self._sum / self.n_frames
        return image

    def noise_of_mean(self) -> NoiseParts:
        """Tell what temporal noise leaves in `mean_image`, of whole frames; at least two must have been added."""
        means = np.array(self._frame_means)[:, None]
        column, row = (
            float((np.array(lines) - means).var(axis=0, ddof=1).mean()) for lines in (self._columns, self._rows)
        )
        return NoiseParts(self.result().temporal_variance_dn2, column, row).scaled(1 / self.n_frames)

    def result(self) -> FrameStatistics:
        """Statistics of what was added, at least two frames.

        For two frames the temporal variance is half the mean square of their difference, less half the square of the
        difference of their means (EMVA 1288 Release 3.1, eq. 18); for more the same over all frames.
        """
        assert self._sum is not None
        assert self._squares is not None
        n, size = self.n_frames, self._sum.size
        # Sum over the pixels of the squared deviations from each pixel's mean; whole numbers up to the division.
        squared = (int(self._squares.sum()) * n - int(np.vdot(self._sum, self._sum))) / n
        common = size * float(np.sum((np.array(self._frame_means) - np.mean(self._frame_means)) ** 2))
        freedom = (size - 1) * (n - 1)
        temporal = max(squared - common, 0.0) / freedom
        spatial = float(self._sum.var(ddof=1)) / n**2 - temporal / n
        return FrameStatistics(
            mean_dn=float(np.mean(self._frame_means)),
            temporal_variance_dn2=temporal,
            n_pixels=size,
            n_frames=n,
            largest_share=self._saturated / (size * n),
            black_share=self._black / (size * n),
            multiple=min(self._bits & -self._bits, 16) if self._bits else 1,
            spatial_variance_dn2=max(spatial, 0.0),
            frame_means_dn=tuple(self._frame_means),
        )
