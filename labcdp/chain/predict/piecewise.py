"""Cumulative distributions of many pixels at once, and what becomes of them when another exposure is merged in."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import ceil, floor
from typing import Self

import numpy as np
from numpy.typing import NDArray

from .nodes import lagrange_weights

FloatArray = NDArray[np.float64]

#: Probability that changes nothing.
_NEGLIGIBLE = 1e-15

#: Parts a step of a lattice is cut into where the lattice is smoothed.
_PARTS = 8


@dataclass(frozen=True, eq=False)
class Cumulative:
    """P(value < x) for several pixels, one a column, on common places.

    Parameters
    ----------
    places : ndarray, shape (k,)
        Rising. Steps: the values. Otherwise the edges of bins, over each of which the probability is spread evenly.
    below : ndarray, shape (k + 1, pixels) for steps, else (k, pixels)
        Probability below the first place, ..., and for steps that of all values.
    steps : bool
        Which of the two it is.
    """

    places: FloatArray
    below: FloatArray
    steps: bool

    @classmethod
    def of_values(cls, values: FloatArray, share: FloatArray) -> Self:
        """Make it of the probability of each value, shape (k, pixels)."""
        below = np.zeros((values.size + 1, share.shape[1]))
        np.cumsum(share, axis=0, out=below[1:])
        return cls(values, below, True)

    def at(self, places: FloatArray) -> FloatArray:
        """P(value < x) at each x, shape (places, pixels)."""
        if self.steps:
            # Indexing of whole rows is several times slower than `take`.
            below: FloatArray = self.below.take(np.searchsorted(self.places, places, side="left"), axis=0)
            return below
        left = np.clip(np.searchsorted(self.places, places, side="right") - 1, 0, self.places.size - 2)
        part = (places - self.places[left]) / (self.places[left + 1] - self.places[left])
        result: FloatArray = self._rise.take(left, axis=0)
        result *= np.clip(part, 0.0, 1.0)[:, None]
        result += self.below.take(left, axis=0)
        return result

    @cached_property
    def _rise(self) -> FloatArray:
        rise: FloatArray = np.diff(self.below, axis=0)
        return rise

    @property
    def total(self) -> FloatArray:
        """Probability of all values, shape (pixels,)."""
        total: FloatArray = self.below[-1]
        return total

    def smallest_spread(self) -> float:
        """Smallest standard deviation of the pixels' values; 0 if a pixel has none."""
        share = np.diff(self.below, axis=0)
        middle = self.places if self.steps else (self.places[1:] + self.places[:-1]) / 2
        total = np.maximum(share.sum(axis=0), 1e-300)
        mean = middle @ share / total
        variance = (middle**2) @ share / total - mean**2
        return float(np.sqrt(max(variance.min(), 0.0)))

    @property
    def even(self) -> bool:
        """Whether it is a lattice of even steps."""
        if not self.steps or self.places.size < 2:
            return False
        distance = np.diff(self.places)
        return bool(np.allclose(distance, distance[0], rtol=1e-6))

    def smoothed(self) -> Cumulative:
        """Return a lattice of even steps without its steps, mean and variance kept.

        The probability below a value is the sum of all lower ones and half its own, less a twelfth of their slope
        (Euler and Maclaurin); cubic polynomials join these.
        """
        step = self.places[1] - self.places[0]
        share = np.pad(np.diff(self.below, axis=0), ((1, 1), (0, 0)))
        below = (self.below[1:] + self.below[:-1]) / 2 - (share[2:] - share[:-2]) / 24
        middle = np.pad(below, ((2, 2), (0, 0)))
        middle[-2:] = self.total
        x = (np.arange(_PARTS) / _PARTS)[:, None, None]
        # Lagrange polynomials through -1, 0, 1, 2.
        weights = (
            -x * (x - 1) * (x - 2) / 6,
            (x + 1) * (x - 1) * (x - 2) / 2,
            -(x + 1) * x * (x - 2) / 2,
            (x + 1) * x * (x - 1) / 6,
        )
        count = middle.shape[0] - 3
        fine = sum(weight * middle[None, i : i + count] for i, weight in enumerate(weights))
        places = self.places[0] + step * (np.arange(count * _PARTS) / _PARTS - 1)
        return Cumulative(places, np.swapaxes(np.asarray(fine), 0, 1).reshape(places.size, -1), False)


def merged(
    rest: Cumulative, own_part: FloatArray, factor: FloatArray, share: FloatArray, edges: FloatArray
) -> Cumulative:
    """Distribution of own part + factor * rest over the values of another exposure, independent of the rest.

    Parameters
    ----------
    rest : Cumulative
        Value merged from all shorter exposures.
    own_part, factor : ndarray, shape (k,)
        What each value of the other exposure adds, and the factor of the rest, above 0.
    share : ndarray, shape (k, pixels)
        Probability of each of its values.
    edges : ndarray
        Bins of the result, rising; must hold all values.

    Returns
    -------
    Cumulative
        On the part of the bins that holds values.
    """
    lowest = own_part + factor * rest.places[0]
    highest = own_part + factor * rest.places[-1]
    window = edges[
        max(int(np.searchsorted(edges, lowest.min(), side="right")) - 1, 0) : int(
            np.searchsorted(edges, highest.max(), side="right")
        )
        + 1
    ]
    first = np.searchsorted(window, lowest, side="left")
    last = np.minimum(np.searchsorted(window, highest, side="right"), window.size - 1)
    below = np.zeros((window.size, share.shape[1]))
    jumps = np.zeros_like(below)
    for a, b, p, begin, end in zip(own_part, factor, share, first, last, strict=True):
        if end > begin and np.abs(p).max() > _NEGLIGIBLE:
            part = rest.at((window[begin:end] - a) / b)
            part *= p
            below[begin:end] += part
        jumps[end] += p
    jumps *= rest.total
    below += np.cumsum(jumps, axis=0, out=jumps)
    return Cumulative(window, below, False)


def merged_evenly(
    rest: Cumulative, first: float, step: float, factor: float, share: FloatArray, parts: int
) -> Cumulative:
    """As `merged`, for values whose own parts are even steps and leave the rest with one factor, by convolution.

    Parameters
    ----------
    rest : Cumulative
        Value merged from all shorter exposures.
    first, step : float
        What the first value of the other exposure adds, and how much more each next one.
    factor : float
        Factor of the rest, above 0.
    share : ndarray, shape (k, pixels)
        Probability of each value.
    parts : int
        Bins of the result in a step.

    Returns
    -------
    Cumulative
    """
    from scipy.fft import irfft, next_fast_len, rfft

    width = step / parts
    low, high = floor(factor * rest.places[0] / width), ceil(factor * rest.places[-1] / width)
    edges = (np.arange(low, high + 2) - 0.5) * width
    rest_share = np.diff(rest.at(edges / factor), axis=0).T
    spaced = np.zeros((share.shape[1], (share.shape[0] - 1) * parts + 1))
    spaced[:, ::parts] = share.T
    count = spaced.shape[1] + rest_share.shape[1] - 1
    length = next_fast_len(count, real=True)
    sums = irfft(rfft(spaced, length) * rfft(rest_share, length), length)[:, :count]
    below = np.zeros((count + 1, share.shape[1]))
    np.cumsum(sums.T, axis=0, out=below[1:])
    return Cumulative(first + edges[0] + np.arange(count + 1) * width, below, False)


def fewer_values(net_dn: FloatArray, share: FloatArray, width: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Replace values by four nodes a block, for functions that are smooth over `width` values at each of them.

    The function is replaced by a cubic polynomial through the Gauss-Legendre nodes of each block, whatever the
    probabilities; its error has a mean of 0 where they are even.
    """
    legendre, _ = np.polynomial.legendre.leggauss(4)
    nodes, shares, begin = [], [], 0
    while begin < net_dn.size:
        end = min(begin + max(int(width[begin]), 4), net_dn.size)
        block, part = net_dn[begin:end], share[begin:end]
        begin = end
        if block.size > 4:
            middle, half = (block[0] + block[-1]) / 2, (block[-1] - block[0] + 1) / 2
            part = lagrange_weights(middle + half * legendre, block).T @ part
            block = middle + half * legendre
        nodes.append(block)
        shares.append(part)
    return np.concatenate(nodes), np.concatenate(shares)
