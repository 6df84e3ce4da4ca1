"""Values that a merge of several exposures can have, and the bins its distribution is tabulated in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from math import ceil, hypot, lcm
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.errors import PredictionError
from ..hdr import FADE_FROM, ZERO_DN, CaptureLadder, Method, faded_share, merge_dn
from .camera import CameraModel

FloatArray = NDArray[np.float64]

#: Bins in a standard deviation of the value. What is lost is of second order, about 1e-4 of a CDP.
_BINS = 40

#: Most values in a zone with the common unit of all zones, and most values that are tabulated one by one.
_MOST, _MOST_ALONE = 20_000, 500_000
#: Parts of a bin in a standard deviation of a lump of values too many to be tabulated, and most parts of a bin.
_LUMP_PARTS, _MOST_PARTS = 3, 64

#: Most combinations of DN from the black level on that have bins of their own where pixels have little noise.
_FEW = 2000

#: Steps of a lattice in a standard deviation from which its values are binned. Values that coincide with an end of an
#: interval then matter less than 2e-4.
_FINE = 200


@dataclass(frozen=True)
class _Zone:
    """A range of luminance in which the merged value is a sum of the DN of some exposures, with constant factors.

    Parameters
    ----------
    first : int
        Longest exposure that is not clipped; it and all shorter ones enter.
    steps : tuple of int
        Factors of their DN, in units.
    unit : float
        Distance of the values, DN of the merge.
    origin : float
        Value of DN 0 in all exposures.
    low, high : float
        Range of the merged value.
    """

    first: int
    steps: tuple[int, ...]
    unit: float
    origin: float
    low: float
    high: float


def _zones(method: Method, ladder: CaptureLadder, black_level_dn: float) -> list[_Zone]:
    """List the zones of "linear" or "weighted"; those whose factors have no common unit are left out."""
    zones = []
    end = ladder.saturations_dn[0] * (1.0 if method == "linear" else FADE_FROM)
    for first in range(len(ladder)):
        factors = ladder.factors(method, first)
        relative = [Fraction(factor / factors[0]).limit_denominator(10_000) for factor in factors]
        if any(
            abs(float(ratio) * factors[0] / factor - 1) > 1e-12 for ratio, factor in zip(relative, factors, strict=True)
        ):
            continue
        common = lcm(*(ratio.denominator for ratio in relative))
        low = -np.inf if first == 0 else ladder.saturations_dn[0] * ladder.ratios[first - 1]
        high = (ladder.saturations_dn[0] if first == len(ladder) - 1 else end) * ladder.ratios[first]
        steps = tuple(int(ratio * common) for ratio in relative)
        zones.append(_Zone(first, steps, factors[0] / common, -black_level_dn * sum(factors), low, high))
    return zones


def _common_unit(zones: Sequence[_Zone]) -> float | None:
    """Largest unit that those of all zones are multiples of; None without zones."""
    if not zones:
        return None
    return zones[0].unit / lcm(
        *(Fraction(zone.unit / zones[0].unit).limit_denominator(1000).denominator for zone in zones)
    )


def _lump_dn(zone: _Zone, variances: Sequence[FloatArray]) -> FloatArray:
    """Return the standard deviation of the narrowest lumps of a sum of DN, DN of the merge; infinite without any.

    The values of each exposure, its step apart, must be filled by the noise of the others. At half a step of standard
    deviation a ripple of exp(-2 (pi / 2)^2) = 0.7 % is left.
    """
    parts = [step**2 * variance for step, variance in zip(zone.steps, variances, strict=True)]
    rests = [(step, sum(parts) - part) for step, part in zip(zone.steps, parts, strict=True)]
    narrowest = np.min([np.where(rest < step**2 / 4, rest, np.inf) for step, rest in rests], axis=0)
    return np.asarray(zone.unit * np.sqrt(narrowest))


@dataclass(frozen=True, eq=False)
class ValueBins:
    """Bins of the merged value.

    Parameters
    ----------
    edges : ndarray, shape (k + 1,)
        Rising.
    values : ndarray, shape (k,)
        Middles of the bins, or their only values.
    exact : ndarray of bool, shape (k,)
        Whether a bin holds a single value; over other bins a probability is spread evenly.
    """

    edges: FloatArray
    values: FloatArray
    exact: NDArray[np.bool_]

    @cached_property
    def starts(self) -> FloatArray:
        """Values from which the probability up to a value grows by that of each bin, and the end of the last one."""
        return np.append(np.where(self.exact, self.values, self.edges[:-1]), self.edges[-1])

    @classmethod
    def alone(cls, values: FloatArray) -> Self:
        """Bins for known values in rising order, one for each value."""
        return cls(np.append(values, values[-1] + 1), values, np.ones(values.size, dtype=np.bool_))

    @classmethod
    def for_merge(cls, camera: CameraModel) -> ValueBins:
        """Bins of the value of a camera that merges exposures by "linear" or "weighted".

        They are even in standard deviations of the value, and hold one value each where these are far apart. The last
        bin holds what is clipped in all exposures.
        """
        assert camera.hdr is not None
        method, ladder, black_dn = camera.hdr.method, camera.ladder, camera.sensor.black_level_dn
        read_dn = ladder.k_dn_per_e[0] * camera.sensor.read_noise_e
        all_dn = hypot(read_dn, ladder.k_dn_per_e[0] * camera.offset_spread_e)
        top = ladder.merged_saturation_dn
        dn = np.linspace(0, 1, 4001) ** 2 * top
        spread = _spread(method, ladder, dn, all_dn)
        position = np.concatenate([[0], np.cumsum(np.diff(dn) * 2 / (spread[1:] + spread[:-1]))])
        inner = np.interp(np.linspace(0, position[-1], ceil(position[-1] * _BINS) + 1), position, dn)
        inner[-1] = top
        # No value is below that of the least DN of all exposures.
        depth = (9 * all_dn + 1) * ladder.ratios[-1]
        below = np.arange(ceil(depth / spread[0] * _BINS), 0, -1) * (spread[0] / _BINS)
        bins: ValueBins = cls._between(np.concatenate([-below, [-ZERO_DN, ZERO_DN], inner[1:], [top * (1 + 1e-9)]]))
        bins.values[-1], bins.exact[-1] = top, True
        bins.values[below.size], bins.exact[below.size] = 0.0, True
        zones = _zones(method, ladder, black_dn)
        # Where an exposure clips in some pixels only, "linear" has values of two zones in the same range.
        shared = _common_unit(zones) if method == "linear" else None
        for zone in zones:
            shorter = ladder.ratios[zone.first :]
            variances = [read_dn**2 + ladder.k_dn_per_e[0] * dn / ratio for ratio in shorter]
            lump_dn = _lump_dn(zone, variances)
            coarse = (spread > _FINE * zone.unit) & np.isinf(lump_dn)
            fine = np.flatnonzero((dn >= zone.low) & (dn < zone.high) & coarse)
            low, high = max(zone.low, -10 * spread[0]), min(dn[fine[0]] if fine.size else np.inf, zone.high)
            unit = shared if shared is not None and high - low < _MOST * shared else zone.unit
            if high - low > _MOST_ALONE * unit:
                at = (dn >= low) & (dn <= high)
                widths = _LUMP_PARTS * spread[at] / _BINS / np.maximum(lump_dn[at], zone.unit)
                bins = bins._divided(max(ceil(widths.max()), 1), low, high)
            else:
                bins = bins._with_lattice(zone.origin, unit, low, high)
            if method == "weighted" and zone.first > 0:
                # Where a longer exposure fades, it is clipped in some pixels.
                sparse = dn[(dn >= FADE_FROM * low) & (dn <= low) & (spread <= _FINE * unit)]
                if sparse.size and np.ptp(sparse) < _MOST_ALONE * unit:
                    start, end = (sparse[0] - zone.origin) / unit, (sparse[-1] - zone.origin) / unit
                    bins = bins._with_alone(zone.origin + np.arange(ceil(start), ceil(end - 0.5)) * unit)
        # In the dark, pixels of little noise have few DN.
        count = int(_FEW ** (1 / len(ladder)))
        if 12 * all_dn < count:
            least_dn = max(int(black_dn - 6 * all_dn), 0) - black_dn
            few = np.meshgrid(*[least_dn + np.arange(count)] * len(ladder))
            alone = merge_dn(method, 20, few, ladder).ravel()
            alone = alone[np.unique(np.round(alone, 9), return_index=True)[1]]
            index = np.searchsorted(bins.edges, alone, side="right") - 1
            known = bins.exact[index] & (np.abs(bins.values[index] - alone) < 1e-8 * top)
            bins = bins._with_alone(alone[~known])
        return bins

    @classmethod
    def _between(cls, edges: FloatArray) -> Self:
        return cls(edges, (edges[1:] + edges[:-1]) / 2, np.zeros(edges.size - 1, dtype=np.bool_))

    def _divided(self, parts: int, low: float, high: float) -> ValueBins:
        """Divide the bins between two limits, so that they resolve lumps of values."""
        if parts > _MOST_PARTS:
            raise PredictionError(
                "the exposure times make too many values of the merge to be tabulated: give ratios of small whole "
                "numbers, or simulate instead"
            )
        first, last = (int(np.searchsorted(self.edges, end)) for end in (low, high))
        places = np.linspace(first, last, (last - first) * parts + 1)
        inner = np.interp(places, np.arange(self.edges.size), self.edges)
        return self._with_edges(np.concatenate([self.edges[:first], inner, self.edges[last + 1 :]]), ())

    def _with_alone(self, values: FloatArray) -> Self:
        """Return bins in which each of some values has a narrow bin."""
        width = 1e-9 * self.values[-1]
        return self._with_edges(np.sort(np.concatenate([self.edges, values - width, values + width])), values)

    def _with_edges(self, edges: FloatArray, alone: ArrayLike) -> Self:
        """Return bins with more edges, in which some more values have a bin for themselves."""
        bins = self._between(edges)
        values = np.concatenate([self.values[self.exact], alone])
        index = np.searchsorted(edges, values, side="right") - 1
        bins.values[index], bins.exact[index] = values, True
        return bins

    def _with_lattice(self, origin: float, unit: float, low: float, high: float) -> Self:
        """Replace the bins between two limits by one for each value of a lattice."""
        number = np.arange(ceil((low - origin) / unit), ceil((high - origin) / unit))
        if high <= max(low, 0.0) or number.size == 0:
            return self
        values = origin + number * unit
        values[np.abs(values) < ZERO_DN] = 0.0
        edges = origin + (np.append(number, number[-1] + 1) - 0.5) * unit
        before, after = np.searchsorted(self.edges, [edges[0] - 1e-6 * unit, edges[-1] + 1e-6 * unit])
        # The last bin may be one of the lattice's; most that is in it is clipped.
        alone = np.append(values, self.values[-1])
        return self._with_edges(np.concatenate([self.edges[:before], edges, self.edges[after:]]), alone)


def _spread(method: Method, ladder: CaptureLadder, dn: FloatArray, dark_dn: float) -> FloatArray:
    """Return the standard deviation of the merged value over its mean."""
    variances = [ratio**2 * (dark_dn**2 + 1 / 12 + ladder.k_dn_per_e[0] * dn / ratio) for ratio in ladder.ratios]
    last = len(ladder) - 1
    variance = variances[last]
    for i in reversed(range(last)):
        if method == "weighted":
            share = faded_share(dn / ladder.ratios[i], i, ladder)
        else:
            share = np.where(dn / ladder.ratios[i] < ladder.saturations_dn[0], 1 / (len(ladder) - i), 0.0)
        variance = share**2 * variances[i] + (1 - share) ** 2 * variance
    return np.sqrt(variance)
