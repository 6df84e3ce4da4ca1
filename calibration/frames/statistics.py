"""Level and noise of pixels over the frames of one condition."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .rounding import ROUNDING_DN2

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
    return sum(deviation_dn**2 / n for deviation_dn, n in zip(deviations_dn, n_lines, strict=True))


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
    step_dn : float
        Linear values that share a code, root mean square over the pixels; 1 for DN that are no codes.
    """

    mean_dn: float
    temporal_variance_dn2: float
    n_pixels: int
    frame_means_dn: tuple[float, ...]
    saturated_share: float = 0.0
    black_share: float = 0.0
    multiple: int = 1
    step_dn: float = 1.0

    @property
    def rounding_dn2_of_pixel(self) -> float:
        """Variance of rounding, of one pixel: step^2 / 12."""
        return ROUNDING_DN2 * self.step_dn**2

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
        """Variance of the mean by temporal noise, with that of rounding as the least."""
        return max(self.temporal_variance_dn2, self.rounding_dn2_of_pixel) / (self.n_pixels * self.n_frames)
