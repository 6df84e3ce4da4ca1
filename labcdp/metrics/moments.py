"""Moments of many regions, from which the ratios of each pair and their u follow without its pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from math import nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .distribution import Distribution, weighted_sum

_Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Moments:
    """Moments of the pixels of regions, or of a function of them; arrays of one shape.

    Parameters
    ----------
    mean : ndarray of float
        Mean.
    variance, sample_variance : ndarray of float
        Variance, with n and with n - 1; the latter is nan for one pixel.
    skewness : ndarray of float
        Skewness; 0 where all pixels are equal.
    excess : ndarray of float
        Kurtosis - 1 - skewness², 0 or more; 0 where all pixels are equal.
    n : ndarray of float
        Number of pixels.
    """

    mean: _Array
    variance: _Array
    sample_variance: _Array
    skewness: _Array
    excess: _Array
    n: _Array

    @classmethod
    def from_regions(cls, regions: Sequence[Distribution], *, inverse: bool = False) -> Moments:
        """Compute the moments of regions, or of 1 / their values, nan where a value is 0 or below."""
        return cls(*np.array([_moments(region, inverse) for region in regions]).reshape(-1, 6).T)

    def __getitem__(self, index: Any) -> Moments:
        return Moments(*(getattr(self, field.name)[index] for field in fields(self)))

    def variance_of_mean(self, by_deviation: _Array, by_square: _Array) -> _Array:
        """Variance of a value whose derivative to each pixel is a (deviation from the mean) + b (deviation²) + c.

        Parameters
        ----------
        by_deviation, by_square : ndarray of float
            a and b, derivatives for the mean of the pixels.
        """
        std = np.sqrt(self.variance)
        linear = by_deviation + by_square * std * self.skewness
        return self.variance * (linear**2 + by_square**2 * self.variance * self.excess) / (self.n - 1)


def cnr_of_moments(bright: Moments, dark: Moments) -> tuple[_Array, _Array]:
    """Return `labcdp.metrics.cnr` and its u for each pair."""
    variance = dark.sample_variance
    ratio = (bright.mean - dark.mean) / np.sqrt(variance)
    per_std = 1 / np.sqrt(variance)
    by_dark = dark.variance_of_mean(-per_std, -ratio / (2 * variance))
    return ratio, _u(ratio, by_dark, bright.variance_of_mean(per_std, np.zeros(())))


def d_prime_of_moments(bright: Moments, dark: Moments) -> tuple[_Array, _Array]:
    """Return `labcdp.metrics.d_prime` and its u for each pair."""
    variance = (bright.sample_variance + dark.sample_variance) / 2
    ratio = (bright.mean - dark.mean) / np.sqrt(variance)
    per_std, by_square = 1 / np.sqrt(variance), -ratio / (4 * variance)
    parts = bright.variance_of_mean(per_std, by_square), dark.variance_of_mean(-per_std, by_square)
    return ratio, _u(ratio, *parts)


def csnr_of_moments(bright: Moments, inverse_dark: Moments) -> tuple[_Array, _Array]:
    """Return `labcdp.metrics.csnr` and its u for each pair, by the moments of 1 / the dark values."""
    variance = bright.variance * (inverse_dark.variance + inverse_dark.mean**2) + bright.mean**2 * inverse_dark.variance
    ratio = (bright.mean * inverse_dark.mean - 1) / np.sqrt(variance)
    parts = []
    for region, other in ((bright, inverse_dark), (inverse_dark, bright)):
        by_variance = ratio / (2 * variance)
        by_deviation = other.mean / np.sqrt(variance) - by_variance * 2 * region.mean * other.variance
        parts.append(region.variance_of_mean(by_deviation, -by_variance * (other.variance + other.mean**2)))
    return ratio, _u(ratio, *parts)


def _moments(region: Distribution, inverse: bool) -> tuple[float, ...]:
    if inverse and region.values[0] <= 0:
        return *5 * [nan], region.total
    values = 1 / region.values if inverse else region.values
    mean = weighted_sum(region.weights, values) / region.total
    off = values - mean
    square = off**2
    total = weighted_sum(region.weights, off, off)
    variance, sample_variance = total / region.total, total / (region.total - 1) if region.total > 1 else nan
    if variance == 0:
        return mean, 0.0, sample_variance, 0.0, 0.0, region.total
    skewness = weighted_sum(region.weights, square, off) / region.total / variance**1.5
    kurtosis = weighted_sum(region.weights, square, square) / region.total / variance**2
    return mean, variance, sample_variance, skewness, max(kurtosis - 1 - skewness**2, 0.0), region.total


def _u(ratio: _Array, *variances: _Array) -> _Array:
    return np.where(np.isfinite(ratio), np.sqrt(sum(variances)), np.nan)
