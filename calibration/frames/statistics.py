"""Mean, noise and non-uniformity of pixels over the frames of one exposure, from running sums."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .rounding import ROUNDING_DN2, quantisation_variance_dn2

#: Share of clipped values (saturated, or at DN 0) whose effect on a mean is negligible compared with the noise.
MAX_CLIPPED_SHARE = 0.001
#: Standard uncertainties above which a patch is brighter than the dark signal.
MIN_NET_SIGNAL = 3.0


@dataclass(frozen=True)
class LineVariances:
    """Variances of pixels, of the means of columns, and of the means of rows, in DN^2.

    Some cameras have noise or a pattern of whole columns and rows, which averages less than that of single pixels.

    Parameters
    ----------
    pixel, column, row : float
        The variances; of `parts`, those of the three independent sources.
    """

    pixel: float
    column: float
    row: float

    def scaled(self, factor: float) -> LineVariances:
        """All of them times a factor."""
        return LineVariances(self.pixel * factor, self.column * factor, self.row * factor)

    def parts(self, per_column: float, per_row: float) -> LineVariances:
        """Independent parts of single pixels, columns and rows, which may be below 0 by chance.

        s^2 = pixel + column + row, s_c^2 = column + pixel / M and s_r^2 = row + pixel / N are solved (EMVA 1288 Release
        4.0 Linear, section 4.2).

        Parameters
        ----------
        per_column, per_row : float
            Pixels of a column, M, and of a row, N.
        """
        pixel = (self.pixel - self.column - self.row) / max(1 - 1 / per_column - 1 / per_row, 0.5)
        return LineVariances(pixel, self.column - pixel / per_column, self.row - pixel / per_row)


def lines_variance_dn2(deviations_dn: tuple[float, float], n_lines: tuple[float, float]) -> float:
    """Variance of a mean over numbers of columns and rows, by standard deviations of what each has in common."""
    return sum(one**2 / n for one, n in zip(deviations_dn, n_lines, strict=True))


@dataclass(frozen=True, eq=False)
class Level:
    """Values of the frames of one condition.

    Parameters
    ----------
    mean_dn, temporal_variance_dn2 : float
        Mean over pixels and frames; variance of one pixel from frame to frame, mean over the pixels.
    n_pixels : int
        How many were averaged.
    frame_means_dn : tuple of float
        Mean of each frame.
    saturated_share, black_share : float
        Share of the values at or above saturation, and at DN 0.
    multiple : int
        Largest power of two that divides all values, up to 16; 1 if a value is odd.
    """

    mean_dn: float
    temporal_variance_dn2: float
    n_pixels: int
    frame_means_dn: tuple[float, ...]
    saturated_share: float = 0.0
    black_share: float = 0.0
    multiple: int = 1

    @property
    def n_frames(self) -> int:
        """How many frames."""
        return len(self.frame_means_dn)

    @property
    def dof(self) -> int:
        """Degrees of freedom of the temporal variance."""
        return max((self.n_pixels - 1) * (self.n_frames - 1), 1)

    @property
    def frame_means_variance_dn2(self) -> float:
        """Variance of the mean from frame to frame: noise, black level and light; 0 for a single frame."""
        return float(np.var(self.frame_means_dn, ddof=1)) if self.n_frames > 1 else 0.0

    @property
    def mean_variance_dn2(self) -> float:
        """Variance of the mean by temporal noise, with 1/12 DN^2 of rounding as the least."""
        return max(self.temporal_variance_dn2, ROUNDING_DN2) / (self.n_pixels * self.n_frames)


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameStatistics(Level):
    """Level of a window of the image at one exposure, and its images.

    Parameters
    ----------
    image_dn, variance_image_dn2 : ndarray of float32, shape (height, width)
        Mean, and variance over the frames (n - 1; 0 for a single frame), of each pixel.
    used : ndarray of bool, shape (height, width)
        The pixels that all else is about.
    clipped : ndarray of bool, shape (height, width)
        Pixels that were saturated or at 0 DN in at least one frame.
    temporal : LineVariances
        Over the frames, changes common to all pixels excluded (EMVA 1288 Release 4.0 Linear).
    """

    image_dn: NDArray[np.float32]
    variance_image_dn2: NDArray[np.float32]
    used: NDArray[np.bool_]
    clipped: NDArray[np.bool_]
    temporal: LineVariances

    @property
    def level(self) -> Level:
        """The same without images."""
        return Level(**{one.name: getattr(self, one.name) for one in fields(Level)})

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the window."""
        return self.image_dn.shape[0], self.image_dn.shape[1]

    @cached_property
    def n_lines(self) -> tuple[float, float]:
        """Effective numbers of columns and of rows in the mean: those of a rectangle, fewer for other shapes."""
        columns, rows = (float(self.n_pixels**2 / np.sum(self.used.sum(axis=axis) ** 2.0)) for axis in (0, 1))
        return columns, rows

    @cached_property
    def temporal_parts(self) -> LineVariances:
        """Noise of single pixels, columns and rows, at least 0."""
        columns, rows = self.n_lines
        parts = self.temporal.parts(self.n_pixels / columns, self.n_pixels / rows)
        return LineVariances(*(max(part, 0.0) for part in (parts.pixel, parts.column, parts.row)))

    @cached_property
    def spatial_variance_dn2(self) -> float:
        """Variance of the pixels' means, less what temporal noise leaves in it; at least 0."""
        variance = float(np.var(self.image_dn[self.used], ddof=1, dtype=np.float64))
        return max(variance - self.temporal_variance_dn2 / self.n_frames, 0.0)

    @cached_property
    def typical_variance_dn2(self) -> float:
        """Variance over the frames of a typical pixel: the mean without the noisiest thousandth."""
        limit = np.quantile(self.variance_image_dn2, 0.999)
        return float(np.minimum(self.variance_image_dn2, limit).mean(dtype=np.float64))

    @property
    def pixel_mean_variance_dn2(self) -> float:
        """Variance of the mean of a typical pixel, by noise and rounding."""
        return self.typical_variance_dn2 / self.n_frames + quantisation_variance_dn2(self.typical_variance_dn2)


class FrameSums:
    """Accumulates the frames of one exposure, or the same window of each.

    Parameters
    ----------
    saturation_dn : float
        DN from which a value counts as saturated.
    used : ndarray of bool, shape (height, width), or None
        Pixels of the window to use, None for all.
    """

    def __init__(self, saturation_dn: float, used: NDArray[np.bool_] | None = None) -> None:
        self._saturation_dn = saturation_dn
        self._used = used
        self._first: NDArray[np.int64] | None = None
        self._columns: list[NDArray[np.int64]] = []
        self._rows: list[NDArray[np.int64]] = []
        self._saturated = self._black = self._bits = 0

    def add(self, dn: NDArray[np.unsignedinteger[Any]]) -> None:
        """Add the values of a frame, shape (height, width)."""
        values = dn.astype(np.int64)
        if self._first is None:
            self._first = values
            self._total, self._squares = np.zeros_like(values), np.zeros_like(values)
            self._clipped = np.zeros(values.shape, dtype=np.bool_)
        # Differences to the first frame: their squares do not cancel.
        change = values - self._first
        self._total += change
        self._squares += np.square(change, out=change)
        saturated, black = dn >= self._saturation_dn, dn == 0
        self._clipped |= saturated | black
        if self._used is not None:
            values = np.where(self._used, values, 0)
            saturated, black = saturated & self._used, black & self._used
        self._columns.append(values.sum(axis=0))
        self._rows.append(values.sum(axis=1))
        self._saturated += int(np.count_nonzero(saturated))
        self._black += int(np.count_nonzero(black))
        self._bits |= int(np.bitwise_or.reduce(values, axis=None))

    @property
    def n_frames(self) -> int:
        """How many were added."""
        return len(self._rows)

    def result(self) -> FrameStatistics:
        """Statistics of what was added, at least one frame."""
        assert self._first is not None
        n = self.n_frames
        used = np.ones(self._first.shape, np.bool_) if self._used is None else self._used
        size = int(np.count_nonzero(used))
        # Sums of the squared deviations from each pixel's own mean.
        deviations = np.maximum(self._squares - np.square(self._total, dtype=np.float64) / n, 0)
        frame_means = np.array([rows.sum() for rows in self._rows]) / size
        common = size * float(np.sum((frame_means - frame_means.mean()) ** 2))
        own = max(float(deviations.sum(where=used)) - common, 0.0) / (max(size - 1, 1) * max(n - 1, 1))
        of_lines = [
            _line_variance(np.array(sums), used.sum(axis=axis), frame_means)
            for axis, sums in ((0, self._columns), (1, self._rows))
        ]
        return FrameStatistics(
            image_dn=(self._first + self._total / n).astype(np.float32),
            variance_image_dn2=(deviations / max(n - 1, 1)).astype(np.float32),
            used=used,
            clipped=self._clipped,
            mean_dn=float(frame_means.mean()),
            temporal_variance_dn2=own,
            n_pixels=size,
            frame_means_dn=tuple(frame_means.tolist()),
            temporal=LineVariances(own, *of_lines),
            saturated_share=self._saturated / (size * n),
            black_share=self._black / (size * n),
            multiple=min(self._bits & -self._bits, 16) if self._bits else 1,
        )


def _line_variance(sums: NDArray[np.int64], counts: NDArray[np.int64], frame_means: NDArray[np.float64]) -> float:
    """Variance over the frames of the means of columns or rows, less the mean of the frame."""
    if len(frame_means) < 2:
        return 0.0
    filled = counts > 0
    means = sums[:, filled] / counts[filled] - frame_means[:, None]
    return float(means.var(axis=0, ddof=1).mean())
