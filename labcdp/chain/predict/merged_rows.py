"""Probabilities of merged values: the exposures of a pixel share its fixed pattern and are independent otherwise."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from math import ceil, sqrt
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..hdr import FADE_FROM, ExposureLadder, Method, faded_share, weighted_stage
from .piecewise import Cumulative, fewer_values, merged, merged_evenly
from .value_bins import BINS, Noise, ValueBins, Zone, is_smooth, merge_factors, zones

if TYPE_CHECKING:
    from scipy.sparse import csr_array

FloatArray = NDArray[np.float64]

# DN of each exposure that occur, and their probabilities, shape (DN, pixels).
_Dense: TypeAlias = Sequence[tuple[slice, FloatArray]]

#: Probability below which an outcome is left out.
_NEGLIGIBLE = 1e-13
#: Pixels (rates times offsets) tabulated together, enough for NumPy's calls to pay off.
_PIXELS = 96
#: Least standard deviation of a lattice, in steps, from which it can be smoothed, and number of values from which the
#: values of an exposure are replaced by fewer nodes.
_SMOOTH_STEPS, _MANY = 1.5, 64
#: Width of the blocks that nodes stand for, in standard deviations of the rest.
_BLOCK = 0.6

#: Most values of a zone that are all calculated, where they could be binned as well and where not; most bins else.
_LONGEST, _LONGEST_LUMPED, _MOST_BINS = 3000, 16_000, 30_000


@dataclass(frozen=True, eq=False)
class ExposureRows:
    """Probabilities of the DN of each exposure for a list of rates, at several offsets of the pixel.

    Parameters
    ----------
    rows : sequence of sequence of csr_array
        ``rows[offset][exposure]``, shape (rates, DN), longest exposure first.
    offset_shares : ndarray, shape (offsets,)
        Share of the pixels with each offset.
    net_dn : ndarray, shape (DN,)
        DN above black level.
    noise : Noise
        Read noise and spread of the offsets.
    """

    rows: Sequence[Sequence[csr_array]]
    offset_shares: FloatArray
    net_dn: FloatArray
    noise: Noise

    def dense(self, exposure: int, part: slice) -> tuple[slice, FloatArray]:
        """DN that occur, and their probabilities, shape (DN, offsets * rates)."""
        parts = [rows[exposure][part] for rows in self.rows]
        low = min(int(one.indices.min()) for one in parts)
        high = max(int(one.indices.max()) for one in parts) + 1
        dense = np.concatenate([one[:, low:high].toarray() for one in parts])
        return slice(low, high), np.ascontiguousarray(dense.T)

    def over_offsets(self, below: FloatArray) -> FloatArray:
        """Mean over the offsets, from shape (k, offsets * rates) to (k, rates)."""
        return np.tensordot(below.reshape(below.shape[0], self.offset_shares.size, -1), self.offset_shares, (1, 0))


# Quasi-Monte Carlo meets 2e-4 from 2^14 to 2^16 points a rate on, 10^8 for a map: slower than the convolutions here.
def merged_rows(
    method: Method, ladder: ExposureLadder, exposures: ExposureRows, edges: FloatArray, nodes: NDArray[np.intp]
) -> list[tuple[int, FloatArray]]:
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
        Bins of the merged value, rising; they hold all values.
    nodes : ndarray of int
        Number of each rate in its grid, rising.

    Returns
    -------
    list of (int, ndarray)
        For each rate the first bin that occurs, and the probabilities from it on.
    """
    stage_edges = [edges]
    stage_edges += [
        ValueBins.of_merge(method, ladder, exposures.noise, start=i).edges for i in range(1, len(ladder) - 1)
    ]
    merge = _Merge(method, ladder, exposures, stage_edges, zones(method, ladder, exposures.noise.black_level_dn))
    # Rates that are far apart have no DN in common.
    runs = np.split(np.arange(nodes.size), np.flatnonzero(np.diff(nodes) > 1) + 1)
    count = max(_PIXELS // exposures.offset_shares.size, 1)
    parts = [
        slice(begin, min(begin + count, int(run[-1]) + 1))
        for run in runs
        for begin in range(int(run[0]), int(run[-1]) + 1, count)
    ]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        blocks = pool.map(merge.rows, parts)
        return [row for block in blocks for row in block]


@dataclass(frozen=True, eq=False)
class _Merge:
    """A merge of tabulated exposures; `edges` are the bins of what is merged from each exposure on."""

    method: Method
    ladder: ExposureLadder
    exposures: ExposureRows
    edges: Sequence[FloatArray]
    zones: Sequence[Zone]

    def rows(self, part: slice) -> list[tuple[int, FloatArray]]:
        """Probabilities of the bins of the whole merge, for some rates."""
        dense = [self.exposures.dense(i, part) for i in range(len(self.ladder))]
        parts = self._linear(dense) if self.method == "linear" else self._weighted(dense)
        return _bins(parts, self.edges[0], self.exposures)

    def _weighted(self, dense: _Dense) -> list[Cumulative]:
        """Parts of the distribution: of what does not fade all sums, and the exposures that do merged into it."""
        first, rest = self._without_fading(dense)
        for i in reversed(range(first)):
            window, share = self._cut(dense[i], clipped=False)
            if share.max(initial=0) < _NEGLIGIBLE:
                continue
            clipped = self._cut(dense[i], clipped=True)[1].sum(axis=0)
            net_dn = self.exposures.net_dn[window]
            if i == 0:
                left = Cumulative(rest.places, rest.below * clipped, rest.steps)
                return [left, self._with_exposure(i, rest, net_dn, share)]
            if clipped.max() > _NEGLIGIBLE:
                # Clipped values all leave the rest as it is.
                net_dn = np.append(net_dn, self.ladder.saturation_dn)
                share = np.concatenate([share, clipped[None]])
            rest = self._with_exposure(i, rest, net_dn, share)
        return [rest]

    def _without_fading(self, dense: _Dense) -> tuple[int, Cumulative]:
        """Longest exposure from which on none fades, and the distribution of what is merged from there on."""
        last = len(dense) - 1
        fading = self.ladder.saturation_dn * FADE_FROM
        for first in range(last):
            if all(self._net_dn(one)[-1] < fading for one in dense[first:last]) and (
                self._net_dn(dense[last])[-1] < self.ladder.saturation_dn
            ):
                alone = all(self._cut(one, clipped=False)[1].max(initial=0) < _NEGLIGIBLE for one in dense[:first])
                sums = self._sums(first, dense[first:], longest=_LONGEST if alone else 0)
                if sums:
                    return first, sums[0]
        values, _ = weighted_stage(self._net_dn(dense[last]), last, self.ladder)
        return last, Cumulative.of_values(values, dense[last][1])

    def _linear(self, dense: _Dense) -> list[Cumulative]:
        """Parts of the distribution by the longest exposure that is not clipped, value by value if they are few."""
        done = [self._clipped_in_all(dense[-1])]
        for first in range(len(dense)):
            open_ = [self._cut(one, clipped=False) for one in dense[first:]]
            if any(share.max(initial=0) < _NEGLIGIBLE for _, share in open_):
                continue
            if first > 0:
                chance = self._cut(dense[first - 1], clipped=True)[1].sum(axis=0)
                if chance.max() < _NEGLIGIBLE:
                    break
                open_[0] = (open_[0][0], open_[0][1] * chance)
            done += self._sums(first, open_) or [self._binned_sums(first, open_)]
        return done

    def _sums(self, first: int, dense: _Dense, longest: int = _LONGEST) -> list[Cumulative]:
        """Distribution of the sum of DN with constant factors, by convolution.

        Empty if there are more than `longest` sums that could be binned as well, or far too many.
        """
        from scipy.fft import irfft, next_fast_len, rfft

        zone = next((zone for zone in self.zones if zone.first == first), None)
        if zone is None:
            return []
        spans = [step * (window.stop - window.start - 1) for step, (window, _) in zip(zone.steps, dense, strict=True)]
        if sum(spans) > (longest if is_smooth(zone.steps, _variances(dense)) else _LONGEST_LUMPED):
            return []
        length = sum(spans) + 1
        fast = next_fast_len(length, real=True)
        product: Any = 1.0
        for step, span, (_, share) in zip(zone.steps, spans, dense, strict=True):
            # Pixels in rows, as transforms are fastest along contiguous values.
            spaced = np.zeros((share.shape[1], span + 1))
            spaced[:, ::step] = share.T
            product = product * rfft(spaced, fast)
        sums = irfft(product, fast)[:, :length].T
        lowest = sum(step * window.start for step, (window, _) in zip(zone.steps, dense, strict=True))
        return [Cumulative.of_values(zone.origin + zone.unit * (lowest + np.arange(length)), sums)]

    def _binned_sums(self, first: int, dense: _Dense) -> Cumulative:
        """Return the same in even bins, for sums that are too many: a DN between two bins belongs to both in parts."""
        from scipy.fft import irfft, next_fast_len, rfft
        from scipy.sparse import csr_array

        factors = merge_factors(self.method, self.ladder, first)
        terms = [factor * self._net_dn(one) for factor, one in zip(factors, dense, strict=True)]
        lowest, highest = (sum(float(term[end]) for term in terms) for end in (0, -1))
        # Few bins are narrower, those of single values among them.
        begin, end = np.searchsorted(self.edges[0], [lowest, highest])
        widths = np.diff(self.edges[0][max(begin - 1, 0) : end + 1])
        width = max(float(np.quantile(widths, 0.1)) / 2, (highest - lowest) / _MOST_BINS)
        places = [(term - term[0]) / width for term in terms]
        length = sum(int(place[-1]) + 1 for place in places) + 1
        fast = next_fast_len(length, real=True)
        product: Any = 1.0
        for place, (_, share) in zip(places, dense, strict=True):
            left = place.astype(np.intp)
            bins = (np.concatenate([left, left + 1]), np.tile(np.arange(left.size), 2))
            split = csr_array((np.concatenate([left + 1 - place, place - left]), bins))
            product = product * rfft(np.ascontiguousarray((split @ share).T), fast)
        below = np.zeros((length + 1, dense[0][1].shape[1]))
        np.cumsum(irfft(product, fast)[:, :length].T, axis=0, out=below[1:])
        return Cumulative(lowest + width * np.linspace(-0.5, length - 0.5, length + 1), below, False)

    def _with_exposure(self, i: int, rest: Cumulative, net_dn: FloatArray, share: FloatArray) -> Cumulative:
        """Merge the given values of exposure `i` into the rest, which it fades out of or not."""
        ladder, ratio = self.ladder, self.ladder.ratios[i]
        own_weight = faded_share(net_dn, i, ladder)
        if net_dn[-1] < FADE_FROM * ladder.saturation_dn:
            step = own_weight[0] * ratio
            parts = ceil(BINS / sqrt(max(min(_variances([(slice(0), share)])), 1 / 12)))
            return merged_evenly(rest, step * net_dn[0], step, 1 - own_weight[0], share, parts)
        if net_dn.size > _MANY and not self._combed:
            spread = rest.smallest_spread()
            if rest.even and spread >= _SMOOTH_STEPS * (rest.places[1] - rest.places[0]):
                rest = rest.smoothed()
            if not rest.steps:
                width = _BLOCK * (1 - own_weight) * spread / (np.maximum(own_weight, 1e-3) * ratio)
                net_dn, share = fewer_values(net_dn, share, width)
        own_part, factor = weighted_stage(net_dn, i, ladder)
        return merged(rest, own_part, factor, share, self.edges[i])

    @property
    def _combed(self) -> bool:
        """Whether single electrons show in the DN, so that no smooth function goes through their probabilities.

        Half an electron of read noise leaves a ripple of 0.7 % of them; with many electrons to a DN they do not show.
        """
        k_dn_per_e = self.ladder.k_dn_per_e
        return self.exposures.noise.read_dn < 0.5 * k_dn_per_e and k_dn_per_e > 0.05

    def _net_dn(self, one: tuple[slice, FloatArray]) -> FloatArray:
        return self.exposures.net_dn[one[0]]

    def _cut(self, one: tuple[slice, FloatArray], *, clipped: bool) -> tuple[slice, FloatArray]:
        """Return the clipped DN, or those that are not."""
        window, share = one
        bound = window.start + int(np.searchsorted(self._net_dn(one), self.ladder.saturation_dn))
        if clipped:
            return slice(bound, window.stop), share[bound - window.start :]
        return slice(window.start, bound), share[: bound - window.start]

    def _clipped_in_all(self, shortest: tuple[slice, FloatArray]) -> Cumulative:
        share = self._cut(shortest, clipped=True)[1].sum(axis=0, keepdims=True)
        return Cumulative.of_values(np.array([self.ladder.merged_saturation_dn]), share)


def _variances(dense: _Dense) -> list[float]:
    """Smallest variance of any pixel's DN, for each exposure."""
    variances = []
    for _, share in dense:
        dn = np.arange(share.shape[0])[:, None]
        total = np.maximum(share.sum(axis=0), 1e-300)
        mean = (share * dn).sum(axis=0) / total
        variances.append(float(((share * (dn - mean) ** 2).sum(axis=0) / total).min()))
    return variances


def _bins(done: Sequence[Cumulative], edges: FloatArray, exposures: ExposureRows) -> list[tuple[int, FloatArray]]:
    """Probabilities of the bins in all parts of the distribution together, for each rate."""
    lowest, highest = min(one.places[0] for one in done), max(one.places[-1] for one in done)
    first = max(int(np.searchsorted(edges, lowest, side="right")) - 1, 0)
    end = min(int(np.searchsorted(edges, highest, side="right")) + 1, edges.size)
    below: Any = 0.0
    for one in done:
        below = below + Cumulative(one.places, exposures.over_offsets(one.below), one.steps).at(edges[first:end])
    share = np.maximum(np.diff(below, axis=0), 0)
    rows = []
    for row in share.T:
        occurs = np.flatnonzero(row > _NEGLIGIBLE)
        rows.append((first + int(occurs[0]), row[occurs[0] : occurs[-1] + 1].copy()))
    return rows
