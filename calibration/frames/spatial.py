"""Spatial variance of a mean image, and its parts by pixel, column and row."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .statistics import LineVariances


@dataclass(frozen=True)
class Estimate:
    """A variance, which may be below 0 by chance, and its standard uncertainty."""

    value: float
    uncertainty: float

    @property
    def root(self) -> float:
        """Square root; 0 where the variance is not significantly above 0."""
        return sqrt(self.value) if self.value > 2 * self.uncertainty else 0.0

    def __sub__(self, other: Estimate) -> Estimate:
        """Difference of independent estimates."""
        return Estimate(self.value - other.value, hypot(self.uncertainty, other.uncertainty))


@dataclass(frozen=True)
class SpatialVariance:
    """Spatial variances of a mean image in DN^2, temporal noise subtracted.

    Parameters
    ----------
    total, pixel, column, row : Estimate
        Of all pixels, and its parts (EMVA 1288 Release 4.0 Linear, section 4.2).
    """

    total: Estimate
    pixel: Estimate
    column: Estimate
    row: Estimate


def spatial_variance(mean_image: NDArray[np.floating[Any]], noise: LineVariances) -> SpatialVariance:
    """Spatial variance of a mean image, and its parts.

    Parameters
    ----------
    mean_image : ndarray of float, shape (height, width)
        Mean of the frames.
    noise : LineVariances
        Contribution of temporal noise to pixels and to the means of columns and rows.

    Returns
    -------
    SpatialVariance
        The uncertainty of the total is sqrt((m4 - s^4) / n) with the fourth central moment m4, so that single hot
        pixels count; that of column and row means is the one of normal values.
    """
    image = np.asarray(mean_image, dtype=np.float64)
    height, width = image.shape
    deviation = image - image.mean()
    squares = np.square(deviation)
    measured = float(squares.sum()) / (image.size - 1)
    columns, rows = (float(deviation.mean(axis=axis).var(ddof=1)) for axis in (0, 1))
    parts = LineVariances(measured - noise.pixel, columns - noise.column, rows - noise.row).parts(height, width)
    u_pixels = sqrt(max(float(np.mean(np.square(squares))) - measured**2, 0.0) / image.size)
    # A pattern of columns or rows has only as many values as there are columns or rows. By chance a variance may come
    # out below that of noise and single pixels alone.
    u_columns = max(columns, noise.column + max(parts.pixel, 0.0) / height) * sqrt(2 / (width - 1))
    u_rows = max(rows, noise.row + max(parts.pixel, 0.0) / width) * sqrt(2 / (height - 1))
    return SpatialVariance(
        Estimate(measured - noise.pixel, hypot(u_pixels, u_columns, u_rows)),
        Estimate(parts.pixel, u_pixels),
        Estimate(parts.column, u_columns),
        Estimate(parts.row, u_rows),
    )
