"""All pairs of two patches whose distributions are known, for many cells at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .value_table import ValueTable

FloatArray = NDArray[np.float64]

#: A bright value this close to an end of the interval, relative to it, lies on the end.
_ON_END = 1e-12


@dataclass(frozen=True, eq=False)
class Cells:
    """Pairs of patches, one a cell; arrays of shape (n,) unless stated otherwise.

    Parameters
    ----------
    dark, bright : tuple of ndarray, each of shape (n, parts)
        Of each patch the mean photo-electrons per second of its parts, and the share of its pixels that are of each.
    zero : ndarray
        Value that stands for a luminance of 0, in the unit of the values.
    low, high : ndarray
        Ends of the interval of detected contrasts, fractions; -inf and inf for an open end.
    """

    dark: tuple[FloatArray, FloatArray]
    bright: tuple[FloatArray, FloatArray]
    zero: FloatArray
    low: FloatArray
    high: FloatArray

    def take(self, index: NDArray[np.intp]) -> Cells:
        """Return some of the cells."""
        dark, bright = ((rates[index], shares[index]) for rates, shares in (self.dark, self.bright))
        return Cells(dark, bright, self.zero[index], self.low[index], self.high[index])


#: Columns of what `evaluate_cells` returns.
COLUMNS = (
    "cdp",
    "below",
    "above",
    "mean_contrast",
    "csnr",
    "snr_dark",
    "snr_bright",
    "saturated_share",
    "saturated_share_dark",
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
    ndarray, shape (n, 9)
        In the order of `COLUMNS`.
    """
    bright = _bright_patches(table, cells)
    result = np.empty((cells.zero.size, len(COLUMNS)))
    order = _by_rate(cells.dark)
    for part, first, share, clipped in table.blocks(*(array[order] for array in cells.dark)):
        chosen = order[part]
        result[chosen, :-1] = _evaluate(table, cells.take(chosen), bright.take(chosen), first, share)
        result[chosen, -1] = np.clip(clipped, 0.0, 1.0)
    return result


def _by_rate(patch: tuple[FloatArray, FloatArray]) -> NDArray[np.intp]:
    """Return the order of rising mean rates."""
    return np.argsort(np.einsum("np,np->n", *patch), kind="stable")


@dataclass(frozen=True, eq=False)
class _BrightPatches:
    """Bright patches of n cells: moments and, one after the other in `below`, cumulative probabilities.

    P(value < values[first + j]) of a cell is ``below[start + j]`` for j from 0 to `size`.
    """

    below: FloatArray
    start: NDArray[np.intp]
    first: NDArray[np.intp]
    size: NDArray[np.intp]
    mean: FloatArray
    variance: FloatArray
    saturated: FloatArray

    def take(self, index: NDArray[np.intp]) -> _BrightPatches:
        return _BrightPatches(
            self.below,
            self.start[index],
            self.first[index],
            self.size[index],
            self.mean[index],
            self.variance[index],
            self.saturated[index],
        )

    def up_to(self, table: ValueTable, limits: FloatArray) -> FloatArray:
        """Probability of values of at most some limits, shape (n, k); of bins, with the part below the limit."""
        cell = (slice(None), None)
        if table.bins is None:
            place = np.searchsorted(table.values, limits, side="right") - self.first[cell]
            below: FloatArray = self.below.take(np.clip(place, 0, self.size[cell]) + self.start[cell])
            return below
        edges = table.bins.edges
        whole = np.clip(np.searchsorted(edges, limits, side="right") - 1, 0, edges.size - 2)
        part = np.clip((limits - edges[whole]) / (edges[whole + 1] - edges[whole]), 0.0, 1.0)
        part = np.where(table.bins.exact[whole], limits >= table.values[whole], part)
        place = whole - self.first[cell]
        lower = self.below.take(np.clip(place, 0, self.size[cell]) + self.start[cell])
        upper = self.below.take(np.clip(place + 1, 0, self.size[cell]) + self.start[cell])
        result: FloatArray = lower + part * (upper - lower)
        return result


def _bright_patches(table: ValueTable, cells: Cells) -> _BrightPatches:
    count = cells.zero.size
    start, first, size = (np.empty(count, dtype=np.intp) for _ in range(3))
    mean, variance, saturated = np.empty(count), np.empty(count), np.empty(count)
    pieces, filled = [], 0
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
        filled += below.size
    return _BrightPatches(np.concatenate(pieces), start, first, size, mean, variance, saturated)


def _moments(values: FloatArray, share: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean and variance of each row of probabilities."""
    # About the likeliest value, so that a patch without noise has a variance of exactly 0.
    centre = values[share.argmax(axis=1)][:, None]
    distance = values - centre
    mean = np.einsum("nk,nk->n", share, distance)
    variance = np.einsum("nk,nk,nk->n", share, distance, distance) - mean**2
    return centre[:, 0] + mean, np.maximum(variance, 0.0)


def _evaluate(table: ValueTable, cells: Cells, bright: _BrightPatches, first: int, share: FloatArray) -> FloatArray:
    """Evaluate cells, all columns but the last, whose dark patches have the probabilities `share` from `first` on."""
    values = table.values[first : first + share.shape[1]]
    mean, variance = _moments(values, share)
    lit_share, signal = _lit(table, cells.zero, first, share)
    dark_share = share.sum(axis=1) - lit_share.sum(axis=1)
    not_positive = bright.up_to(table, cells.zero[:, None])[:, 0]
    total = bright.up_to(table, np.full((cells.zero.size, 1), np.inf))[:, 0]

    def up_to_contrast(contrast: FloatArray, nudge: float) -> FloatArray:
        reach = signal * (1 + contrast[:, None])
        limits = cells.zero[:, None] + reach + nudge * (np.abs(cells.zero)[:, None] + reach)
        reached: FloatArray = np.einsum("nk,nk->n", lit_share, bright.up_to(table, limits))
        return reached

    undefined = dark_share * not_positive
    # To a dark value of 0 or below each bright one above 0 has an unbounded contrast.
    below = undefined + np.where(np.isneginf(cells.low), 0.0, up_to_contrast(np.maximum(cells.low, -1), -_ON_END))
    finite_high = np.where(np.isfinite(cells.high), cells.high, 0.0)
    up_to_high = undefined + up_to_contrast(finite_high, _ON_END)
    up_to_high = np.where(np.isfinite(cells.high), up_to_high, share.sum(axis=1) * total)
    signal_mean = bright.mean - cells.zero
    with np.errstate(divide="ignore", invalid="ignore"):
        mean_contrast, csnr = _contrast_moments(lit_share, signal, signal_mean, bright.variance)
        snr_dark = (mean - cells.zero) / np.sqrt(variance)
        snr_bright = signal_mean / np.sqrt(bright.variance)
    cdp, above = up_to_high - below, share.sum(axis=1) * total - up_to_high
    shares = [np.clip(one, 0.0, 1.0) for one in (cdp, below, above)]
    return np.stack([*shares, mean_contrast, csnr, snr_dark, snr_bright, bright.saturated], axis=1)


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
    return share * part, np.where(exact, np.maximum(signal, 0.0), (above[:, 1:] + above[:, :-1]) / 2)


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
