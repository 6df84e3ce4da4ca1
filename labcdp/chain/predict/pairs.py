"""All pairs of two patches whose distributions are known, for many cells at once."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from .value_bins import ValueBins
from .value_table import ValueTable

FloatArray = NDArray[np.float64]

#: A bright value this close to an end of the interval, relative to it, lies on the end.
_ON_END = 1e-12


#: Rates of the parts of a patch in photo-electrons per second, and shares of its pixels, along the last axis.
CellPatch: TypeAlias = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class Cells:
    """Pairs of patches, one a cell; arrays of shape (n,) unless stated otherwise.

    Parameters
    ----------
    dark, bright : CellPatch
        Of each patch the mean photo-electrons per second of its parts, and the share of its pixels that are of each,
        both of shape (n, parts).
    zero : ndarray
        Value that stands for a luminance of 0, in the unit of the values.
    low, high : ndarray
        Ends of the interval of detected contrasts, fractions from 0 on.
    """

    dark: CellPatch
    bright: CellPatch
    zero: FloatArray
    low: FloatArray
    high: FloatArray

    def take(self, index: NDArray[np.intp]) -> Cells:
        """Return some of the cells."""
        dark, bright = ((rates[index], shares[index]) for rates, shares in (self.dark, self.bright))
        return Cells(dark, bright, self.zero[index], self.low[index], self.high[index])


@dataclass(frozen=True, eq=False)
class ExactPrediction:
    """CDP, SNR and contrast over all pairs of pixels of two patches; arrays of one shape.

    Parameters
    ----------
    cdp, below, above : ndarray
        Share of pairs whose contrast lies in the interval, below or above it, as those of `labcdp.metrics.cdp`.
    mean_contrast : ndarray
        Mean Weber contrast over the pairs with a dark value above 0. Where dark values come close to 0, few pairs
        decide it.
    csnr : ndarray
        `mean_contrast` over the standard deviation of the contrast (contrast signal-to-noise ratio).
    snr_dark, snr_bright : ndarray
        Mean over standard deviation of the linear signal of each patch; inf without noise.
    saturated_share, saturated_share_dark : ndarray
        Share of saturated pixels in the bright and in the dark patch.
    """

    cdp: FloatArray
    below: FloatArray
    above: FloatArray
    mean_contrast: FloatArray
    csnr: FloatArray
    snr_dark: FloatArray
    snr_bright: FloatArray
    saturated_share: FloatArray
    saturated_share_dark: FloatArray


def with_regions_exchanged(prediction: ExactPrediction, where: NDArray[np.bool_]) -> ExactPrediction:
    """Exchange SNR and saturated share of the regions in pairs whose dark region is the brighter one to the camera."""
    snr_dark, snr_bright = prediction.snr_dark, prediction.snr_bright
    dark, bright = prediction.saturated_share_dark, prediction.saturated_share
    return replace(
        prediction,
        snr_dark=np.where(where, snr_bright, snr_dark),
        snr_bright=np.where(where, snr_dark, snr_bright),
        saturated_share=np.where(where, dark, bright),
        saturated_share_dark=np.where(where, bright, dark),
    )


def evaluate_cells(table: ValueTable, cells: Cells) -> FloatArray:
    """Evaluate all pairs of each cell.

    Parameters
    ----------
    table : ValueTable
        Distributions of the values.
    cells : Cells
        The pairs of patches, n of them.

    Returns
    -------
    ndarray, shape (9, n)
        In the order of the fields of `ExactPrediction`.
    """
    bright = _bright_patches(table, cells)
    result = np.empty((len(fields(ExactPrediction)), cells.zero.size))
    for chosen, first, share, clipped in table.blocks(*cells.dark):
        shares = _evaluate(table, cells.take(chosen), bright, chosen, first, share)
        result[:, chosen] = [*shares, np.clip(clipped, 0.0, 1.0)]
    return result


@dataclass(frozen=True, eq=False)
class _BrightPatches:
    """Bright patches of n cells: moments and, one after the other, the probability of values up to a limit.

    In bin ``first + j`` of a cell, from -1 for what is below its bins to `size` for what is above, the probability is
    ``at[start + j]`` where the bin starts and rises by ``slope[start + j]``; its integral is ``area[start + j]`` there.
    The latter two are empty without bins over which probability is spread.
    """

    at: FloatArray
    slope: FloatArray
    area: FloatArray
    start: NDArray[np.intp]
    first: NDArray[np.intp]
    size: NDArray[np.intp]
    total: FloatArray
    mean: FloatArray
    variance: FloatArray
    saturated: FloatArray

    def up_to(self, bins: ValueBins, cells: NDArray[np.intp], limits: FloatArray) -> FloatArray:
        """Probability of values of at most some limits of some cells, shape (n, k)."""
        whole, index = self._bin_index(bins, cells, limits)
        values: FloatArray = self.at.take(index)
        return values + (limits - bins.starts.take(whole)) * self.slope.take(index) if self.slope.size else values

    def mean_up_to(self, bins: ValueBins, cells: NDArray[np.intp], ends: FloatArray) -> FloatArray:
        """Mean of `up_to` over limits spread evenly between each two of some `ends`, shape (n, k); k is one less."""
        whole, index = self._bin_index(bins, cells, ends)
        along = ends - bins.starts.take(whole)
        area = self.area.take(index) + along * (self.at.take(index) + along * self.slope.take(index) / 2)
        length = np.diff(ends, axis=1)
        return np.divide(np.diff(area, axis=1), length, out=np.zeros_like(length), where=length > 0)

    def _bin_index(
        self, bins: ValueBins, cells: NDArray[np.intp], limits: FloatArray
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return the bins that limits lie in, and their indices in `at`."""
        start, first, size = (values[cells, None] for values in (self.start, self.first, self.size))
        whole = np.clip(np.searchsorted(bins.starts, limits, side="right") - 1, first - 1, first + size)
        return whole, whole + (start - first)


def _bright_patches(table: ValueTable, cells: Cells) -> _BrightPatches:
    count = cells.zero.size
    start, first, size = (np.empty(count, dtype=np.intp) for _ in range(3))
    total, mean, variance, saturated = np.empty((4, count))
    chances: list[FloatArray] = []
    slopes: list[FloatArray] = [np.empty(0)]
    areas: list[FloatArray] = [np.empty(0)]
    filled, starts, all_exact = 0, table.bins.starts, table.bins.exact
    for chosen, begin, share, clipped in table.blocks(*cells.bright):
        width = share.shape[1]
        start[chosen] = filled + np.arange(len(share)) * (width + 2) + 1
        first[chosen], size[chosen] = begin, width
        mean[chosen], variance[chosen] = _moments(table.bins.values[begin : begin + width], share)
        saturated[chosen] = np.clip(clipped, 0.0, 1.0)
        below = np.zeros((len(share), width + 2))
        np.cumsum(share, axis=1, out=below[:, 2:])
        total[chosen] = below[:, -1]
        filled += below.size
        at = below.copy()
        # A value that is alone in its bin is where the bin starts.
        exact = all_exact[begin : begin + width]
        at[:, 1:-1][:, exact] = below[:, 2:][:, exact]
        chances.append(at.ravel())
        if not all_exact.all():
            wide = np.diff(starts[begin : begin + width + 1])
            slope, area = np.zeros((2, *at.shape))
            slope[:, 1:-1] = np.where(exact, 0.0, share / wide)
            np.cumsum((at[:, 1:-1] + slope[:, 1:-1] * wide / 2) * wide, axis=1, out=area[:, 2:])
            slopes.append(slope.ravel())
            areas.append(area.ravel())
    at, slope, area = (np.concatenate(arrays) for arrays in (chances, slopes, areas))
    return _BrightPatches(at, slope, area, start, first, size, total, mean, variance, saturated)


def _moments(values: FloatArray, share: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean and variance of each row of probabilities, of values that all rows or each row of its own has."""
    # About the likeliest value, so that a patch without noise has a variance of exactly 0.
    values = np.broadcast_to(values, share.shape)
    centre = np.take_along_axis(values, share.argmax(axis=1)[:, None], axis=1)
    distance = values - centre
    mean = np.einsum("nk,nk->n", share, distance)
    variance = np.einsum("nk,nk,nk->n", share, distance, distance) - mean**2
    return centre[:, 0] + mean, np.maximum(variance, 0.0)


def _evaluate(
    table: ValueTable, cells: Cells, patches: _BrightPatches, numbers: NDArray[np.intp], first: int, share: FloatArray
) -> tuple[FloatArray, ...]:
    """Evaluate cells, all fields but the last, whose dark patches have the probabilities `share` from `first` on."""
    bins, value_range = table.bins, slice(first, first + share.shape[1])
    exact = bins.exact[value_range]
    mean, variance = _moments(bins.values[value_range], share)
    lit_share, signal = _lit(bins, cells.zero, first, share)
    dark_share = share.sum(axis=1) - lit_share.sum(axis=1)
    zero = cells.zero[:, None]
    not_positive = patches.up_to(bins, numbers, zero)[:, 0]

    def up_to_contrast(contrast: FloatArray, nudge: float) -> FloatArray:
        factor = 1 + contrast[:, None]
        reach = signal * factor
        limits = zero + reach + nudge * (np.abs(zero) + reach)
        if exact.all():
            chance = patches.up_to(bins, numbers, limits)
        else:
            # Dark values spread over a bin meet bright ones that many pixels share.
            edges = np.maximum(bins.edges[first : value_range.stop + 1] - zero, 0.0)
            chance = patches.mean_up_to(bins, numbers, zero + edges * factor)
            chance[:, exact] = patches.up_to(bins, numbers, limits[:, exact])
        # To a dark value of 0 or below each bright one above 0 has an unbounded contrast.
        reached: FloatArray = np.einsum("nk,nk->n", lit_share, chance)
        reached += dark_share * not_positive
        return reached

    below, up_to_high = up_to_contrast(cells.low, -_ON_END), up_to_contrast(cells.high, _ON_END)
    bright_mean, bright_variance = patches.mean[numbers] - cells.zero, patches.variance[numbers]
    with np.errstate(divide="ignore", invalid="ignore"):
        mean_contrast, csnr = _contrast_moments(lit_share, signal, bright_mean, bright_variance)
        snr_dark = (mean - cells.zero) / np.sqrt(variance)
        snr_bright = bright_mean / np.sqrt(bright_variance)
    above = share.sum(axis=1) * patches.total[numbers] - up_to_high
    shares = [np.clip(part, 0.0, 1.0) for part in (up_to_high - below, below, above)]
    return (*shares, mean_contrast, csnr, snr_dark, snr_bright, patches.saturated[numbers])


def _lit(bins: ValueBins, zero: FloatArray, first: int, share: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Probability of dark values above `zero`, and how far above it they are, both of shape (cells, values)."""
    last = first + share.shape[1]
    exact = bins.exact[first:last]
    signal = bins.values[first:last] - zero[:, None]
    if exact.all():
        return np.where(signal > 0, share, 0.0), np.maximum(signal, 0.0)
    edges = bins.edges[first : last + 1]
    above = np.maximum(edges - zero[:, None], 0.0)
    part = np.where(exact, signal > 0, np.diff(above, axis=1) / np.diff(edges))
    # Only the part of a bin that lies above zero counts, at its middle.
    cut = ~exact & (part < 1)
    return share * part, np.where(cut, (above[:, 1:] + above[:, :-1]) / 2, np.maximum(signal, 0.0))


def _contrast_moments(
    lit_share: FloatArray, signal: FloatArray, bright_mean: FloatArray, bright_variance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Mean of bright / dark - 1 and its ratio to the standard deviation, over pairs with a dark value above 0.

    Of patches that all have one value, as where both are saturated, the contrast is 0 and the ratio not defined (nan).
    """
    inverse = np.divide(1.0, signal, out=np.zeros_like(signal), where=signal > 0)
    first, spread = _moments(inverse, lit_share / lit_share.sum(axis=1, keepdims=True))
    contrast = bright_mean * first - 1
    # Var(b / d) = Var(b) E[1 / d^2] + E[b]^2 Var(1 / d), which avoids cancellation.
    variance = bright_variance * (spread + first**2) + bright_mean**2 * spread
    # Of equal values the rounding of their probabilities leaves something of both.
    equal = (np.abs(contrast) < _ON_END) & (variance < _ON_END)
    return np.where(equal, 0.0, contrast), np.where(equal, np.nan, contrast / np.sqrt(variance))
