"""Probabilities of the value of a merge that mixes exposures, by quasi-Monte Carlo: the same points at each call."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache, reduce
from math import ceil, log2, prod
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..hdr import ExposureLadder, Method, linear_stage, mix, weighted_stage

if TYPE_CHECKING:
    from scipy.sparse import csr_array

FloatArray = NDArray[np.float64]

#: Logarithms to base 2 of the points for each rate and of the fewest for an offset; offsets share the points. A CDP is
#: then within 2e-4 of that by all combinations in the usual case (see `predict`).
_POINTS, _FEWEST = 15, 8
#: Most combinations of DN that are all merged instead.
_ALL = 8192
#: Probability of a DN below which it is left out.
_NEGLIGIBLE = 1e-9


@dataclass(frozen=True, eq=False)
class ExposureRows:
    """Probabilities of the DN of each exposure for a list of rates, at several offsets of the pixel.

    Parameters
    ----------
    rows : sequence of sequence of csr_array
        ``rows[offset][exposure]``, shape (rates, DN), longest exposure first: the exposures of a pixel share its fixed
        pattern and are independent otherwise.
    offset_shares : ndarray, shape (offsets,)
        Share of the pixels with each offset.
    net_dn : ndarray, shape (DN,)
        DN above black level.
    """

    rows: Sequence[Sequence[csr_array]]
    offset_shares: FloatArray
    net_dn: FloatArray


def merged_rows(
    method: Method, ladder: ExposureLadder, exposures: ExposureRows, edges: FloatArray
) -> tuple[csr_array, FloatArray]:
    """Probability of each bin of the merged value by "linear" or "weighted".

    Parameters
    ----------
    method : {"linear", "weighted"}
        How the exposures are merged.
    ladder : ExposureLadder
        The exposures, at least two.
    exposures : ExposureRows
        Their probabilities.
    edges : ndarray, shape (k + 1,)
        Bins of the merged value, rising. The last one also holds what is above: "weighted" exceeds the saturation by up
        to an electron where only the shorter of nearly equal exposures is clipped.

    Returns
    -------
    rows : csr_array, shape (rates, k)
    means : ndarray, shape (k,)
        Mean value in each bin over all rates, its middle where there is none.
    """
    from scipy.sparse import csr_array

    stage = weighted_stage if method == "weighted" else linear_stage
    stages = [stage(exposures.net_dn, i, ladder) for i in range(len(ladder))]
    offsets = [
        _Pixels(method, ladder, stages, max(_POINTS + ceil(log2(share)), _FEWEST), [_occurring(one) for one in rows])
        for share, rows in zip(exposures.offset_shares, exposures.rows, strict=True)
    ]

    ends_of_all = np.append(edges[:-1], np.inf)

    def row(rate: int) -> tuple[NDArray[Any], ...]:
        """Bins that occur, their probabilities, and the sum of the values in each."""
        merged = [pixels.merged(rate) for pixels in offsets]
        first = np.searchsorted(ends_of_all, min(values[0] for values, _ in merged), side="right") - 1
        last = np.searchsorted(ends_of_all, max(values[-1] for values, _ in merged), side="right")
        below, sums = np.zeros((2, last - first + 1))
        for share, (values, chance) in zip(exposures.offset_shares, merged, strict=True):
            ends = np.searchsorted(values, ends_of_all[first : last + 1])
            below += share * chance.take(ends)
            sums += share * np.concatenate([[0.0], np.cumsum(values * np.diff(chance))]).take(ends)
        total = np.diff(below)
        occurs = np.flatnonzero(total)
        return first + occurs, total[occurs], np.diff(sums)[occurs]

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        found = list(pool.map(row, range(exposures.rows[0][0].shape[0])))
    columns, shares, sums = (np.concatenate(arrays) for arrays in zip(*found, strict=True))
    starts = np.cumsum([0, *(occurs.size for occurs, *_ in found)])
    weight = np.bincount(columns, shares, edges.size - 1)
    middle = (edges[1:] + edges[:-1]) / 2
    means = np.divide(np.bincount(columns, sums, edges.size - 1), weight, out=middle, where=weight > 1e-9)
    rows = csr_array((shares, columns, starts), shape=(len(found), edges.size - 1))
    return rows, np.clip(means, edges[:-1], edges[1:])


@dataclass(frozen=True, eq=False)
class _Pixels:
    """Pixels of one offset: `stages` holds what each DN of each exposure adds to a merge, `exposures` which occur."""

    method: Method
    ladder: ExposureLadder
    stages: Sequence[tuple[FloatArray, FloatArray]]
    power: int
    exposures: Sequence[csr_array]

    def merged(self, rate: int) -> tuple[FloatArray, FloatArray]:
        """Values in rising order, and the probability below each and of all: of all combinations, or of points."""
        spans = [slice(*rows.indptr[rate : rate + 2]) for rows in self.exposures]
        dn: list[NDArray[Any]] = [rows.indices[span] for rows, span in zip(self.exposures, spans, strict=True)]
        share = [rows.data[span] for rows, span in zip(self.exposures, spans, strict=True)]
        if prod(one.size for one in dn) <= _ALL:
            values = self._mixed(np.ix_(*dn)).ravel()
            order = values.argsort()
            below = np.cumsum(reduce(np.multiply.outer, share).ravel()[order])
            return values[order], np.concatenate([[0.0], below / below[-1]])
        values = self._mixed(
            [
                one.repeat(np.diff(np.rint(np.cumsum(chance) * 2**self.power).astype(np.intp), prepend=0)).take(rank)
                for one, chance, rank in zip(dn, share, _ranks(len(dn), self.power), strict=True)
            ]
        )
        values.sort()
        return values, _even(self.power)

    def _mixed(self, dn: Sequence[NDArray[Any]]) -> FloatArray:
        """Values of the merge for DN that broadcast together."""
        parts = [(own.take(one), rest.take(one)) for one, (own, rest) in zip(dn, self.stages, strict=True)]
        return mix(self.method, parts, self.ladder)


def _occurring(rows: csr_array) -> csr_array:
    """Leave out what is negligible, and make the rest add up to 1."""
    from scipy.sparse import csr_array

    rows.sort_indices()
    kept = rows.data > _NEGLIGIBLE
    starts = np.concatenate([[0], np.cumsum(kept)])[rows.indptr]
    share = rows.data[kept]
    total = np.add.reduceat(share, starts[:-1])
    return csr_array((share / np.repeat(total, np.diff(starts)), rows.indices[kept], starts), shape=rows.shape)


@lru_cache(maxsize=64)
def _ranks(dimensions: int, power: int) -> list[NDArray[np.intp]]:
    """Rank of each of 2^power Sobol points along each dimension."""
    from scipy.stats.qmc import Sobol

    # Each interval of this size holds one point.
    points = Sobol(dimensions, rng=0).random_base2(power)
    return list(np.ascontiguousarray((points * 2**power).astype(np.intp).T))


@lru_cache(maxsize=16)
def _even(power: int) -> FloatArray:
    """Probability below each of 2^power points, and of all."""
    return np.linspace(0.0, 1.0, 2**power + 1)
