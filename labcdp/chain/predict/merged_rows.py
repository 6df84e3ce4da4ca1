"""Probabilities of the value of a merge that mixes exposures, by quasi-Monte Carlo: the same points at each call."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache, partial, reduce
from math import ceil, log2, prod

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ..hdr import CaptureLadder, Method, linear_stage, mix, weighted_stage

FloatArray = NDArray[np.float64]

#: Logarithms to base 2 of the points for each rate and of the fewest for an offset; offsets share the points. A CDP is
#: then within 2e-4 of that by all combinations in the usual case (see `predict`).
_POINTS, _FEWEST = 15, 8
#: Most combinations of DN that are all merged instead.
_ALL = 8192
#: Probability of a DN below which it is left out.
_NEGLIGIBLE = 1e-9


def merged_rows(
    method: Method,
    ladder: CaptureLadder,
    exposures: Sequence[Sequence[csr_array]],
    offset_shares: FloatArray,
    net_dn: FloatArray,
    edges: FloatArray,
) -> csr_array:
    """Probability of each bin of the merged value by "linear" or "weighted".

    Parameters
    ----------
    method : {"linear", "weighted"}
        Merge method.
    ladder : CaptureLadder
        The exposures, at least two.
    exposures : sequence of sequence of csr_array
        Probabilities of the DN at a list of rates, ``exposures[offset][exposure]`` of shape (rates, DN), longest
        exposure first: the exposures of a pixel share its fixed pattern and are independent otherwise.
    offset_shares : ndarray, shape (offsets,)
        Share of the pixels with each offset.
    net_dn : ndarray, shape (DN,)
        DN above black level.
    edges : ndarray, shape (k + 1,)
        Bins of the merged value, rising. The last one also holds what is above: "weighted" exceeds the saturation by up
        to an electron where only the shorter of nearly equal exposures is clipped.

    Returns
    -------
    csr_array, shape (rates, k)
    """
    stage = weighted_stage if method == "weighted" else linear_stage
    stages = [stage(net_dn, i, ladder) for i in range(len(ladder))]
    merge = partial(mix, method, ladder=ladder)
    offsets = []
    for share, rows in zip(offset_shares, exposures, strict=True):
        power = max(_POINTS + ceil(log2(share)), _FEWEST)
        offsets.append(
            _Pixels([_Exposure.of(*exposure, power) for exposure in zip(rows, stages, strict=True)], merge, power)
        )
    ends_of_all = np.append(edges[:-1], np.inf)

    def row(rate: int) -> tuple[NDArray[np.intp], FloatArray]:
        """Bins that occur, and their probabilities."""
        merged = [pixels.merged(rate) for pixels in offsets]
        first = np.searchsorted(ends_of_all, min(values[0] for values, _ in merged), side="right") - 1
        last = np.searchsorted(ends_of_all, max(values[-1] for values, _ in merged), side="right")
        below = np.zeros(last - first + 1)
        for share, (values, chance) in zip(offset_shares, merged, strict=True):
            below += share * chance.take(np.searchsorted(values, ends_of_all[first : last + 1]))
        total = np.diff(below)
        occurs = np.flatnonzero(total)
        return first + occurs, total[occurs]

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        row_parts = list(pool.map(row, range(exposures[0][0].shape[0])))
    columns, shares = (np.concatenate(arrays) for arrays in zip(*row_parts, strict=True))
    starts = np.cumsum([0, *(occurs.size for occurs, _ in row_parts)])
    return csr_array((shares, columns, starts), shape=(len(row_parts), edges.size - 1))


@dataclass(frozen=True, eq=False)
class _Exposure:
    """DN of an exposure that occur at each rate: their probabilities, points, and what they add to a merge."""

    starts: NDArray[np.intp]
    share: FloatArray
    points: NDArray[np.intp]
    parts: tuple[FloatArray, FloatArray]

    @classmethod
    def of(cls, rows: csr_array, stage: tuple[FloatArray, FloatArray], power: int) -> _Exposure:
        """Leave out what is negligible, and make the rest add up to 1."""
        rows.sort_indices()
        kept = rows.data > _NEGLIGIBLE
        starts = np.concatenate([[0], np.cumsum(kept)])[rows.indptr]
        share = rows.data[kept]
        share /= np.repeat(np.add.reduceat(share, starts[:-1]), np.diff(starts))
        points = np.diff(np.rint(np.cumsum(share) * 2**power), prepend=0.0).astype(np.intp)
        signal, rest = (part.take(rows.indices[kept]) for part in stage)
        return cls(starts, share, points, (signal, rest))

    def at(self, rate: int) -> tuple[FloatArray, NDArray[np.intp], list[FloatArray]]:
        """Probabilities, points and parts at one rate."""
        span = slice(*self.starts[rate : rate + 2])
        return self.share[span], self.points[span], [part[span] for part in self.parts]


@dataclass(frozen=True, eq=False)
class _Pixels:
    """Pixels of one offset, with 2^`power` points for each rate."""

    exposures: Sequence[_Exposure]
    merge: Callable[[Sequence[Sequence[FloatArray]]], FloatArray]
    power: int

    def merged(self, rate: int) -> tuple[FloatArray, FloatArray]:
        """Values in rising order, and the probability below each and of all: of all combinations, or of points."""
        shares, points, parts = zip(*(exposure.at(rate) for exposure in self.exposures), strict=True)
        if prod(share.size for share in shares) <= _ALL:
            values = self.merge(list(zip(*(np.ix_(*part) for part in zip(*parts, strict=True)), strict=True))).ravel()
            order = values.argsort()
            below = np.cumsum(reduce(np.multiply.outer, shares).ravel()[order])
            return values[order], np.concatenate([[0.0], below / below[-1]])
        ranks = _ranks(len(parts), self.power)
        values = self.merge(
            [[_drawn(part, *at) for part in both] for both, *at in zip(parts, points, ranks, strict=True)]
        )
        values.sort()
        return values, _even(values.size)


def _drawn(part: FloatArray, points: NDArray[np.intp], rank: NDArray[np.intp]) -> FloatArray:
    """Value of each point, or one for all."""
    return part[:1] if (part == part[0]).all() else part.repeat(points).take(rank)


@lru_cache(maxsize=64)
def _ranks(dimensions: int, power: int) -> list[NDArray[np.intp]]:
    """Rank of each of 2^power Sobol points, moved by a random digital shift, along each dimension."""
    from scipy.stats.qmc import Sobol

    points = Sobol(dimensions, scramble=False, bits=power).random_base2(power)
    shifts = np.random.default_rng(1).integers(2**power, size=dimensions)
    ranks = (points * 2**power).astype(np.intp) ^ shifts
    # Values that are in order already are quicker to find and to sort.
    return list(np.ascontiguousarray(ranks[ranks[:, 0].argsort()].T))


@lru_cache(maxsize=16)
def _even(count: int) -> FloatArray:
    """Probability below each of some points, and of all."""
    return np.linspace(0.0, 1.0, count + 1)
