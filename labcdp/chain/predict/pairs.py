"""All pairs of two patches whose distributions are known, for many cells at once."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from .value_bins import ValueBins
from .value_table import ValueTable

FloatArray = NDArray[np.float64]

#: A bright value this close to an end of the interval, relative to it, lies on the end.
_ON_END = 1e-12


#: Rates of the parts of a patch in photo-electrons per second, and shares of its pixels, along the last axis.
Patch: TypeAlias = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class Cells:
    """Pairs of patches, one a cell; arrays of shape (n,) unless stated otherwise.

    Parameters
    ----------
    dark, bright : Patch
        Of each patch the mean photo-electrons per second of its parts, and the share of its pixels that are of each,
        both of shape (n, parts).
    zero : ndarray
        Value that stands for a luminance of 0, in the unit of the values.
    low, high : ndarray
        Ends of the interval of detected contrasts, fractions from 0 on.
    """

    dark: Patch
    bright: Patch
    zero: FloatArray
    low: FloatArray
    high: FloatArray

    def take(self, index: NDArray[np.intp]) -> Cells:
        """Return some of the cells."""
        dark, bright = ((rates[index], shares[index]) for rates, shares in (self.dark, self.bright))
        return Cells(dark, bright, self.zero[index], self.low[index], self.high[index])


@dataclass(frozen=True, eq=False)
class ExactPrediction:
    """What all pairs of pixels of two patches come to; arrays of one shape.

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
    order = _by_rate(cells.dark)
    for part, first, share, clipped in table.blocks(*(array[order] for array in cells.dark)):
        chosen = order[part]
        found = _evaluate(table, cells.take(chosen), bright, chosen, first, share)
        result[:, chosen] = [*found, np.clip(clipped, 0.0, 1.0)]
    return result


def _by_rate(patch: Patch) -> NDArray[np.intp]:
    """Return the order of rising mean rates."""
    return np.argsort(np.einsum("np,np->n", *patch), kind="stable")


@dataclass(frozen=True, eq=False)
class _BrightPatches:
    """Bright patches of n cells: moments and, one after the other in `below`, cumulative probabilities.

    P(value < values[first + j]) of a cell is ``below[start + j]`` for j from 0 to `size`; of bins, that below an edge,
    and its integral from the first edge to this one is ``area[start + j]``.
    """

    below: FloatArray
    area: FloatArray
    start: NDArray[np.intp]
    first: NDArray[np.intp]
    size: NDArray[np.intp]
    mean: FloatArray
    variance: FloatArray
    saturated: FloatArray

    def up_to(self, table: ValueTable, cells: NDArray[np.intp], limits: FloatArray) -> FloatArray:
        """Probability of values of at most some limits of some cells, shape (n, k); of bins, with the part below it."""
        start, first, size = (of_all[cells, None] for of_all in (self.start, self.first, self.size))

        def below(place: NDArray[np.intp]) -> FloatArray:
            found: FloatArray = self.below.take(np.clip(place - first, 0, size) + start)
            return found

        if table.bins is None:
            return below(np.searchsorted(table.values, limits, side="right"))
        edges = table.bins.edges
        whole = np.clip(np.searchsorted(edges, limits, side="right") - 1, 0, edges.size - 2)
        part = np.clip((limits - edges[whole]) / (edges[whole + 1] - edges[whole]), 0.0, 1.0)
        part = np.where(table.bins.exact[whole], limits >= table.values[whole], part)
        lower = below(whole)
        result: FloatArray = lower + part * (below(whole + 1) - lower)
        return result

    def mean_up_to(self, bins: ValueBins, cells: NDArray[np.intp], ends: FloatArray) -> FloatArray:
        """Mean of `up_to` over limits spread evenly between each two of some `ends`, shape (n, k); k is one less."""
        start, first, size = (of_all[cells, None] for of_all in (self.start, self.first, self.size))
        whole = np.clip(np.searchsorted(bins.edges, ends, side="right") - 1, first, first + size - 1)
        place = whole - first + start
        along, width = ends - bins.edges[whole], np.diff(bins.edges)[whole]
        inside = np.clip(along, 0.0, width)
        part = inside**2 / (2 * width) + np.maximum(along - width, 0.0)
        part = np.where(bins.exact[whole], np.maximum(ends - bins.values[whole], 0.0), part)
        lower = self.below.take(place)
        area = self.area.take(place) + lower * along + part * (self.below.take(place + 1) - lower)
        length = np.diff(ends, axis=1)
        return np.divide(np.diff(area, axis=1), length, out=np.zeros_like(length), where=length > 0)


def _bright_patches(table: ValueTable, cells: Cells) -> _BrightPatches:
    count = cells.zero.size
    start, first, size = (np.empty(count, dtype=np.intp) for _ in range(3))
    mean, variance, saturated = np.empty(count), np.empty(count), np.empty(count)
    pieces, areas, filled = [], [], 0
    order = _by_rate(cells.bright)
    for part, begin, share, clipped in table.blocks(*(array[order] for array in cells.bright)):
        chosen = order[part]
        width = share.shape[1]
        below = np.zeros((share.shape[0], width + 1))
        np.cumsum(share, axis=1, out=below[:, 1:])
        start[chosen] = filled + np.arange(share.shape[0]) * (width + 1)
        first[chosen], size[chosen] = begin, width
        mean[chosen], variance[chosen] = _moments(table.values[begin : begin + width], share)
        saturated[chosen] = np.clip(clipped, 0.0, 1.0)
        pieces.append(below.ravel())
        if table.bins is not None:
            edges, values = table.bins.edges[begin : begin + width + 1], table.values[begin : begin + width]
            wide = np.diff(edges)
            area = np.zeros_like(below)
            own = share * np.where(table.bins.exact[begin : begin + width], edges[1:] - values, wide / 2)
            np.cumsum(below[:, :-1] * wide + own, axis=1, out=area[:, 1:])
            areas.append(area.ravel())
        filled += below.size
    return _BrightPatches(
        np.concatenate(pieces), np.concatenate(areas or pieces), start, first, size, mean, variance, saturated
    )


def _moments(values: FloatArray, share: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean and variance of each row of probabilities."""
    # About the likeliest value, so that a patch without noise has a variance of exactly 0.
    centre = values[share.argmax(axis=1)][:, None]
    distance = values - centre
    mean = np.einsum("nk,nk->n", share, distance)
    variance = np.einsum("nk,nk,nk->n", share, distance, distance) - mean**2
    return centre[:, 0] + mean, np.maximum(variance, 0.0)


def _evaluate(
    table: ValueTable, cells: Cells, patches: _BrightPatches, numbers: NDArray[np.intp], first: int, share: FloatArray
) -> tuple[FloatArray, ...]:
    """Evaluate cells, all fields but the last, whose dark patches have the probabilities `share` from `first` on."""
    values = table.values[first : first + share.shape[1]]
    mean, variance = _moments(values, share)
    lit_share, signal = _lit(table, cells.zero, first, share)
    dark_share = share.sum(axis=1) - lit_share.sum(axis=1)
    zero = cells.zero[:, None]
    not_positive, total = (patches.up_to(table, numbers, limit)[:, 0] for limit in (zero, np.full_like(zero, np.inf)))

    def up_to_contrast(contrast: FloatArray, nudge: float) -> FloatArray:
        factor = 1 + contrast[:, None]
        reach = signal * factor
        limits = zero + reach + nudge * (np.abs(zero) + reach)
        if table.bins is None:
            chance = patches.up_to(table, numbers, limits)
        else:
            # Dark values spread over a bin meet bright ones that many pixels share.
            edges = np.maximum(table.bins.edges[first : first + values.size + 1] - zero, 0.0)
            chance = patches.mean_up_to(table.bins, numbers, zero + edges * factor)
            exact = table.bins.exact[first : first + values.size]
            chance[:, exact] = patches.up_to(table, numbers, limits[:, exact])
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
    above = share.sum(axis=1) * total - up_to_high
    shares = [np.clip(one, 0.0, 1.0) for one in (up_to_high - below, below, above)]
    return (*shares, mean_contrast, csnr, snr_dark, snr_bright, patches.saturated[numbers])


def _lit(table: ValueTable, zero: FloatArray, first: int, share: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Probability of dark values above `zero`, and how far above it they are, both of shape (cells, values)."""
    last = first + share.shape[1]
    signal = table.values[first:last] - zero[:, None]
    if table.bins is None:
        return np.where(signal > 0, share, 0.0), np.maximum(signal, 0.0)
    edges = table.bins.edges[first : last + 1]
    above = np.maximum(edges - zero[:, None], 0.0)
    exact = table.bins.exact[first:last]
    part = np.where(exact, signal > 0, np.diff(above, axis=1) / np.diff(edges))
    # Only the part of a bin that lies above zero counts, at its middle.
    cut = ~exact & (part < 1)
    return share * part, np.where(cut, (above[:, 1:] + above[:, :-1]) / 2, np.maximum(signal, 0.0))


def _contrast_moments(
    lit_share: FloatArray, signal: FloatArray, bright_mean: FloatArray, bright_variance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Mean of bright / dark - 1 and its ratio to the standard deviation, over pairs with a dark value above 0."""
    inverse = np.divide(1.0, signal, out=np.zeros_like(signal), where=signal > 0)
    lit = lit_share.sum(axis=1)
    first = np.einsum("nk,nk->n", lit_share, inverse) / lit
    second = np.einsum("nk,nk,nk->n", lit_share, inverse, inverse) / lit
    quotient = bright_mean * first
    variance = (bright_mean**2 + bright_variance) * second - quotient**2
    return quotient - 1, (quotient - 1) / np.sqrt(np.maximum(variance, 0.0))
