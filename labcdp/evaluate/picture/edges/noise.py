"""Differences between regions of pure noise whose borders were found in noise like that of an image."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isfinite, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....metrics import Epsilon
from ....metrics.contrast import detected_contrasts
from ....regions.superpixels import neighbours
from .regions import Floats, Labels, MapRegions, map_cut, statistics

#: Most blocks of the image, each inside a region, for estimating the correlation of its noise.
_BLOCKS = 150

#: Superpixels along each side of the simulated image of noise.
_SIMULATED_REGIONS = 14

#: Correlations below this, over the square root of the share of pairs that a lag has, are not significant.
_LEAST_CORRELATION = 0.02

#: A scene's own changes may look like noise that is correlated completely.
_MOST_CORRELATION = 0.95

#: Relative noise of the simulated image, at the most: more would make negative light.
_MOST_NOISE = 0.3

_SEED = 1


@dataclass(frozen=True)
class MapNoise:
    """How noise is correlated from pixel to pixel, and what that does to a map.

    Parameters
    ----------
    inflation : float
        Factor by which the variance of the difference of two neighbouring regions exceeds that for independent pixels;
        1 or more.
    diagonal_correlation : float
        Correlation of pixels that are neighbours along a diagonal, 0 or more.
    """

    inflation: float
    diagonal_correlation: float

    def deviation(self, regions: MapRegions) -> Floats:
        """Return the standard deviation of the noise of each region, from the differences along diagonals."""
        return regions.noise / sqrt(1 - self.diagonal_correlation)

    def alone(self, regions: MapRegions) -> MapRegions:
        """Return the regions as if their pixels scattered by their noise alone."""
        return replace(regions, std=np.fmin(regions.std, self.deviation(regions)))


def map_noise(image: NDArray[np.floating[Any]], regions: MapRegions) -> MapNoise:
    """Simulate noise like that of an image, and measure how it affects the regions of a map.

    Parameters
    ----------
    image : ndarray of float, shape (height, width)
        The image, in linear light.
    regions : MapRegions
        Its superpixels.

    Notes
    -----
    Noise that is correlated from pixel to pixel does two things: a mean of n pixels knows less than n independent ones,
    and borders found with one half of the pixels are not blind for the noise of the other half. Both are measured at
    once, on noise of the same autocorrelation and relative strength without any edge, which is cut and measured as the
    image was.
    """
    correlation = _correlation(image, regions)
    if correlation is None:
        return MapNoise(1.0, 0.0)
    diagonal = min(max(float(correlation[1, 1] + correlation[1, -1]) / 2, 0.0), _MOST_CORRELATION)
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = MapNoise(1.0, diagonal).deviation(regions) / np.abs(regions.mean)
    relative = relative[np.isfinite(relative) & (relative > 0)]
    if not relative.size:
        return MapNoise(1.0, diagonal)
    side = _SIMULATED_REGIONS * regions.size_px
    noise = _simulated(correlation, side)
    simulated = (1 + min(float(np.quantile(relative, 0.75)), _MOST_NOISE) * noise).astype(np.float32)
    labels, measured = map_cut(simulated, regions.size_px)
    _, n_pixels, mean, std = statistics(simulated, labels, measured)
    first, second = neighbours(labels).pairs.T
    with np.errstate(divide="ignore", invalid="ignore"):
        variance = std**2 / n_pixels
        squares = (mean[first] - mean[second]) ** 2 / (variance[first] + variance[second])
    squares = squares[np.isfinite(squares)]
    return MapNoise(max(float(squares.mean()), 1.0) if squares.size else 1.0, diagonal)


def _correlation(image: NDArray[np.floating[Any]], regions: MapRegions) -> Floats | None:
    """Autocorrelation of the noise at lags (dy, dx) in the order of an FFT of twice the blocks' side; None without any.

    The median over blocks that lie inside a region each.
    """
    from scipy import fft

    side = max(regions.size_px // 2, 8)
    blocks = _blocks(image, regions, side)
    if not blocks.size:
        return None
    blocks -= blocks.mean(axis=(1, 2), keepdims=True)
    scatter = np.square(blocks).sum(axis=(1, 2))
    spectra = np.abs(fft.rfft2(blocks[scatter > 0], (2 * side, 2 * side))) ** 2
    if not spectra.size:
        return None
    products = fft.irfft2(spectra, (2 * side, 2 * side)) / scatter[scatter > 0][:, None, None]
    lags = side - np.abs(np.fft.fftfreq(2 * side, 1 / (2 * side)))
    pairs = np.maximum(np.outer(lags, lags), 1) / side**2
    correlation: Floats = np.median(products, axis=0) / pairs
    # A block's own mean was subtracted, which takes as much from the correlation at all lags.
    least = _LEAST_CORRELATION / np.sqrt(pairs)
    correlation += float((correlation * pairs)[correlation > least].sum()) / side**2
    correlation = np.where((np.abs(correlation) > least) & (np.outer(lags, lags) > 0), correlation, 0.0)
    return np.asarray(correlation / correlation[0, 0])


def _blocks(image: NDArray[np.floating[Any]], regions: MapRegions, side: int) -> Floats:
    """Square blocks of pixels around the middles of regions and wholly inside them, shape (n, side, side)."""
    height, width = image.shape
    windows = []
    corners = np.round(regions.centre_px - side / 2).astype(np.intp)
    for number in np.random.default_rng(_SEED).permutation(len(corners)):
        x, y = corners[number]
        if x < 0 or y < 0 or x + side > width or y + side > height:
            continue
        window = slice(y, y + side), slice(x, x + side)
        if (regions.labels[window] == number).all() and np.isfinite(image[window]).all():
            windows.append(image[window].astype(np.float64))
            if len(windows) == _BLOCKS:
                break
    return np.array(windows)


def _simulated(correlation: Floats, side: int) -> Floats:
    """Noise of a standard deviation of 1 with an autocorrelation, shape (side, side)."""
    from scipy import fft

    reach = correlation.shape[0] // 2
    whole = np.zeros((side, side))
    lags = np.arange(-reach + 1, reach)
    whole[np.ix_(lags % side, lags % side)] = correlation[np.ix_(lags, lags)]
    # What was cut off can leave a spectrum a little below 0.
    amplitude = np.sqrt(np.maximum(fft.rfft2(whole).real, 0))
    noise = fft.irfft2(amplitude * fft.rfft2(np.random.default_rng(_SEED).normal(size=(side, side))), (side, side))
    return np.asarray(noise / noise.std())


def cdp_of_noise(regions: MapRegions, deviation: Floats, sides: Labels, contrast: Floats, epsilon: Epsilon) -> Floats:
    """CDP of each edge, of a bright and a dark side, if the regions were uniform but for their noise, and this normal.

    A pair has a contrast of at most c if b - (1 + c) d, which then is normal, is not above 0.
    """
    from scipy.special import ndtr

    # The ends of the interval are in proportion to the contrast.
    low, high = detected_contrasts(1.0, epsilon)

    def up_to(limit: Floats) -> Floats:
        ratio = 1 + limit
        bright, dark = regions.mean[sides]
        deviation_bright, deviation_dark = deviation[sides]
        scatter = np.hypot(deviation_bright, ratio * deviation_dark)
        return np.asarray(ndtr((ratio * dark - bright) / scatter))

    with np.errstate(divide="ignore", invalid="ignore"):
        below = up_to(low * contrast) if isfinite(low) else np.zeros(contrast.size)
        return (up_to(high * contrast) if isfinite(high) else np.ones(contrast.size)) - below
