"""Probabilities of one exposure: from mean electrons to digital numbers, as sparse rows."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..sensor import digitise

if TYPE_CHECKING:
    from scipy.sparse import csr_array


def dense_rows(rows: csr_array, low: int, high: int) -> tuple[int, NDArray[np.float64]]:
    """Rows of a sparse matrix from the first column any of them uses to the last one."""
    from scipy.sparse import csr_array

    part = rows[low:high]
    first, end = int(part.indices.min()), int(part.indices.max()) + 1
    return first, csr_array((part.data, part.indices - first, part.indptr), shape=(high - low, end - first)).toarray()


def indicator(
    column: NDArray[Any], columns: int, row: NDArray[np.intp] | None = None, rows: int | None = None
) -> csr_array:
    """Matrix of ones in one column of each of some rows."""
    from scipy.sparse import csr_array

    row = np.arange(column.size) if row is None else row
    return csr_array((np.ones(column.size), (row, column)), shape=(rows or column.size, columns))


FloatArray = NDArray[np.float64]

#: Half the width of the windows in standard deviations; 3e-12 of a normal distribution lies outside.
_REACH = 7.0


@dataclass(frozen=True)
class Readout:
    """What turns electrons into digital numbers, at one gain.

    Parameters
    ----------
    full_well_e, k_dn_per_e, black_level_dn, bits
        As those of `Sensor`; `k_dn_per_e` at the gain.
    noise_e : float
        Standard deviation of everything normal that is added to the electrons.
    """

    full_well_e: float
    k_dn_per_e: float
    black_level_dn: float
    bits: int
    noise_e: float

    def certain_e(self, offset_e: float) -> float:
        """Mean electrons from which the DN is that of a full pixel or the highest, for offsets up to `offset_e`."""
        end_e = (2**self.bits - self.black_level_dn) / self.k_dn_per_e + _REACH * self.noise_e + offset_e
        limit_e = max(min(self.full_well_e, end_e), 1.0)
        return float(limit_e + (_REACH + 1) * np.sqrt(limit_e) + 60)

    def dn_rows(self, mean_e: FloatArray, offsets_e: Iterable[float] = (0.0,)) -> Iterator[csr_array]:
        """Probability of each DN for each of several means, at each of several offsets.

        Parameters
        ----------
        mean_e : ndarray, shape (n,)
            Mean photo and dark electrons.
        offsets_e : iterable of float
            Offsets of pixels in electrons.

        Yields
        ------
        scipy.sparse.csr_array, shape (n, 2^bits)

        Notes
        -----
        P(DN = d) = sum over n of P(n; mean) P(d | n): Poisson counts n up to the full well, which holds all that is
        above, each followed by normal noise, rounding and clipping. The sum takes every count; where both factors are
        smooth over many counts, every second, fourth, ..., which for normal densities is exact to 1e-8 up to a step
        of their common width.
        """
        electrons = electron_rows(mean_e, self.full_well_e, self.noise_e)
        occurs = np.bincount(electrons.indices) > 0
        for offset_e in offsets_e:
            yield electrons @ self._dn_of_count(offset_e, occurs)

    def _dn_of_count(self, offset_e: float, occurs: NDArray[np.bool_]) -> csr_array:
        """Probability of each DN for each count 0, 1, ... and the full well that occurs, shape (counts, 2^bits)."""
        from scipy.sparse import csr_array
        from scipy.special import ndtr

        place = np.flatnonzero(occurs)
        count, states = np.minimum(place, self.full_well_e), ceil(self.full_well_e)
        top = 2**self.bits - 1
        if self.noise_e == 0:
            dn = digitise((count + offset_e).astype(np.float32), self.k_dn_per_e, self.black_level_dn, self.bits)
            return csr_array((np.ones(count.size), (place, dn)), shape=(states + 1, top + 1))
        centre_dn = self.k_dn_per_e * (count + offset_e) + self.black_level_dn
        noise_dn = self.k_dn_per_e * self.noise_e
        width = min(2 * ceil(_REACH * noise_dn) + 2, top + 1)
        first = np.clip(np.floor(centre_dn - width / 2 + 1), 0, top + 1 - width)
        edges = first[:, None] + np.arange(width + 1) - 0.5
        edges[edges < 0] = -np.inf
        edges[edges > top] = np.inf
        share = np.diff(ndtr((edges - centre_dn[:, None]) / noise_dn), axis=1)
        column = (first[:, None] + np.arange(width)).astype(np.int32)
        starts = np.searchsorted(place, np.arange(states + 2)) * width
        return csr_array((share.ravel(), column.ravel(), starts), shape=(states + 1, top + 1))


def electron_rows(mean_e: FloatArray, full_well_e: float, noise_e: float) -> csr_array:
    """Probability of each electron count, the full well last, shape (n, ceil(full well) + 1); see `Readout.dn_rows`."""
    from scipy.sparse import csr_array
    from scipy.special import gammaln, pdtrc, xlogy

    states = ceil(full_well_e)
    reach = _REACH * np.sqrt(mean_e) + 15
    step = _count_step(mean_e, mean_e + reach < full_well_e, noise_e)
    first = (np.maximum(mean_e - reach, 0) // step).astype(np.int64) * step
    last = np.minimum(mean_e + reach, states - 1).astype(np.int64)
    sizes = np.maximum((last - first) // step + 1, 0)
    row = np.repeat(np.arange(mean_e.size), sizes)
    begin = np.cumsum(sizes) - sizes
    count = first[row] + (np.arange(row.size) - begin[row]) * step[row]
    # A table of log n! is quicker than its evaluation for each row.
    log_factorial = gammaln(np.arange(count.max(initial=0) + 1) + 1.0)
    share = step[row] * np.exp(xlogy(count, mean_e[row]) - mean_e[row] - log_factorial[count])
    full = pdtrc(states - 1, mean_e)
    reached = np.flatnonzero(full > 0)
    return csr_array(
        (
            np.concatenate([share, full[reached]]),
            (np.concatenate([row, reached]), np.concatenate([count, np.full(reached.size, states)])),
        ),
        shape=(mean_e.size, states + 1),
    )


def _count_step(mean_e: FloatArray, below_full: NDArray[np.bool_], noise_e: float) -> NDArray[np.int64]:
    """Step of the sum over counts: a power of 2 below 0.9 of the common width of shot noise and read noise."""
    if noise_e == 0:
        return np.ones(mean_e.size, dtype=np.int64)
    width = 1 / np.hypot(1 / noise_e, 1 / np.sqrt(np.maximum(mean_e, 1e-300)))
    power = np.floor(np.log2(np.maximum(0.9 * width, 1)))
    # A Poisson distribution of few counts is too skew to be treated as a normal one.
    smooth = below_full & (mean_e > 100)
    return np.where(smooth, 2**power, 1).astype(np.int64)
