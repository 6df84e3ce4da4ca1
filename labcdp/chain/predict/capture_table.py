"""Distribution of a value merged of captures of several gains, photodiodes and times, over the rate of electrons.

Where one capture alone counts, the distribution is that of a single exposure, exact. Where captures are blended, their
joint distribution is sampled by quasi-Monte Carlo, with the same points at each call: shared are the photons and dark
electrons of captures of one charge, the gains and dark currents of captures of one photodiode, and the offsets of those
of one readout.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, vstack

from ..hdr import ZERO_DN, mix, normal_stage, stage_of
from ..sensor import CaptureModel
from .camera import CameraModel
from .capture_bins import capture_bins, capture_values
from .nodes import KnownRates
from .quantiles import gamma_quantile, normal_points, poisson_quantile
from .value_bins import ValueBins
from .value_table import ValueTable, code_bins, value_table

FloatArray = NDArray[np.float64]

#: Standard deviations beyond which nothing is expected of a capture, and electrons by which a Poisson distribution of
#: few counts is wider.
_REACH, _FEW_E = 7.0, 15.0
#: Probability of warmer pixels that is neglected.
_NEGLIGIBLE = 1e-10
#: Most combinations of DN of which the blended values are looked at, and points from which a value is tabulated alone.
_MOST_COMBINATIONS, _FREQUENT = 20_000, 8


def capture_table(camera: CameraModel, rates_e_s: FloatArray) -> ValueTable:
    """Tabulate the merged value of a camera's captures at given rates.

    Parameters
    ----------
    camera : CameraModel
        With a merge.
    rates_e_s : ndarray
        Mean photo-electrons per second of the sensor's own photodiode, of any shape.
    """
    rates = np.unique(rates_e_s)
    same_light = np.broadcast_to(rates[:, None], (rates.size, len(camera.captures)))
    bins, rows, saturated = _tabulated(camera, same_light, is_steady=True)
    return ValueTable(bins, rows, saturated, np.arange(rates.size), KnownRates(rates))


def light_table(camera: CameraModel, rates_e_s: FloatArray) -> tuple[ValueTable, FloatArray]:
    """Tabulate the merged value of captures that see different light, as those of a pulsed lamp at different times.

    Parameters
    ----------
    camera : CameraModel
        With a merge.
    rates_e_s : ndarray, shape (n, captures)
        Mean photo-electrons per second of the sensor's own photodiode during each capture, most sensitive first.

    Returns
    -------
    table : ValueTable
        In the place of rates it has numbers of lights, which rise with the mean value.
    numbers : ndarray of float, shape (n,)
        The number of each light.
    """
    lights, light = np.unique(rates_e_s, axis=0, return_inverse=True)
    bins, rows, saturated = _tabulated(camera, lights, is_steady=False)
    order = np.argsort(rows @ bins.values, kind="stable")
    numbers = np.arange(order.size, dtype=np.float64)
    table = ValueTable(bins, csr_array(rows[order]), saturated[order], np.arange(order.size), KnownRates(numbers))
    return table, numbers[np.argsort(order)[light.ravel()]]


def _tabulated(camera: CameraModel, rates: FloatArray, is_steady: bool) -> tuple[ValueBins, csr_array, FloatArray]:
    """Return bins, probabilities and saturated share at rates of each capture, shape (n, captures)."""
    first, last = counting_captures(camera, rates)
    if camera.tone_curve is None:
        bins = capture_bins(camera, _frequent_values(camera, rates, first, last), is_steady)
    else:
        bins = code_bins(camera.tone_curve)
    merge = _Merge(camera, bins)
    parts = []
    for alone in np.unique(first[first == last]):
        chosen = np.flatnonzero((first == alone) & (last == alone))
        parts.append((chosen, *merge.rows_of_one(int(alone), rates[chosen, alone])))
    mixed = np.flatnonzero(first != last)
    groups = [list(group) for _, group in groupby(mixed, key=lambda index: (first[index], last[index]))]
    for group in groups:
        begin, end = int(first[group[0]]), int(last[group[0]]) + 1
        parts.append((np.array(group), *merge.rows_of_several(begin, end, rates[group])))
    order = np.argsort(np.concatenate([chosen for chosen, _, _ in parts]))
    rows = csr_array(vstack([rows for _, rows, _ in parts]).tocsr()[order])
    rows.sort_indices()
    return bins, rows, np.concatenate([saturated for _, _, saturated in parts])[order]


@dataclass(frozen=True, eq=False)
class _Merge:
    """A merge and the bins of its value."""

    camera: CameraModel
    bins: ValueBins

    def rows_of_one(self, number: int, rates_e_s: FloatArray) -> tuple[csr_array, FloatArray]:
        """Probabilities of all values and saturated share where a single capture counts."""
        capture, values = self.camera.captures[number], capture_values(self.camera, number)
        rates = rates_e_s * capture.light_share
        rows, _ = value_table(CameraModel(capture.sensor, capture.settings), np.unique(rates)).rows_at(rates)
        saturated = rows @ (values >= self.camera.saturation_dn).astype(np.float64)
        # Several values can have one code.
        moved = csr_array(
            (rows.data, self._columns(values)[rows.indices], rows.indptr), (rates.size, self.bins.values.size)
        )
        moved.sum_duplicates()
        return moved, np.asarray(saturated)

    def rows_of_several(self, begin: int, end: int, rates_e_s: FloatArray) -> tuple[csr_array, FloatArray]:
        """Probabilities of all values and saturated share where captures from `begin` to before `end` count."""
        draws = _Draws(self.camera.captures[begin:end])
        assert draws.quantiles

        def row(rates: list[float]) -> tuple[NDArray[np.intp], FloatArray, float]:
            values = _merged(self.camera, draws.dn(rates), begin)
            column, count = self._counts(values)
            return column, count / values.size, float((values >= self.camera.saturation_dn).mean())

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            columns, shares, saturated = zip(*pool.map(row, rates_e_s[:, begin:end].tolist()), strict=True)
        starts = np.cumsum([0, *(column.size for column in columns)])
        shape = (len(rates_e_s), self.bins.values.size)
        return csr_array((np.concatenate(shares), np.concatenate(columns), starts), shape=shape), np.array(saturated)

    def _counts(self, values: NDArray[Any]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Bins that occur, and how many of the values are in each."""
        if self.camera.tone_curve is not None:
            count = np.bincount(self._columns(values))
            column = np.flatnonzero(count)
            return column, count[column]
        # Few edges are quicker to find among the sorted values than the values among all edges.
        ordered = np.sort(values)
        first, last = self._columns(ordered[[0, -1]])
        inner = np.searchsorted(ordered, self.bins.edges[first + 1 : last + 1])
        count = np.diff(inner, prepend=0, append=ordered.size)
        occurs = np.flatnonzero(count)
        return first + occurs, count[occurs]

    def _columns(self, values: NDArray[Any]) -> NDArray[np.intp]:
        """Bins of merged values."""
        if self.camera.tone_curve is not None:
            return self.camera.tone_curve.encode(values).astype(np.intp)
        index = np.searchsorted(self.bins.edges, values, side="right") - 1
        return np.clip(index, 0, self.bins.values.size - 1)


def counting_captures(camera: CameraModel, rates_e_s: FloatArray) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First and last capture that counts in any pixel at rates of each capture, shapes (n, captures) and (n,)."""
    captures, ladder, hdr = camera.captures, camera.ladder, camera.hdr
    assert hdr is not None
    first, last = np.full((2, len(rates_e_s)), len(captures) - 1)
    if hdr.method != "most-sensitive":
        return np.zeros_like(first), last
    for i in reversed(range(len(captures) - 1)):
        low_dn, high_dn = (dn - ladder.zeros_dn[i] for dn in _reached_dn(captures[i], rates_e_s[:, i]))
        end = ladder.saturations_dn[i]
        first = np.where(low_dn < end, i, first)
        last = np.where(high_dn < end * (1 - hdr.overlap), i, last)
    return first, np.maximum(first, last)


def _frequent_values(
    camera: CameraModel, rates_e_s: FloatArray, first: NDArray[np.intp], last: NDArray[np.intp]
) -> FloatArray:
    """Blended values at rates at which there are so few that each occurs in many pixels."""
    combinations = np.ones(len(rates_e_s))
    for number, capture in enumerate(camera.captures):
        reached_dn = _reached_dn(capture, rates_e_s[:, number])
        low_dn, high_dn = (np.clip(dn, 0, 2**capture.sensor.bits - 1) for dn in reached_dn)
        combinations *= np.where((first <= number) & (number <= last), high_dn - low_dn + 1, 1.0)
    chosen = np.flatnonzero((first < last) & (combinations < _MOST_COMBINATIONS))
    frequent = [np.empty(0)]
    for index in chosen:
        counting = slice(first[index], last[index] + 1)
        captures_dn = _Draws(camera.captures[counting]).dn(rates_e_s[index, counting].tolist())
        values, count = np.unique(_merged(camera, captures_dn, int(first[index])), return_counts=True)
        frequent.append(values[count >= _FREQUENT])
    return np.unique(np.concatenate(frequent))


def _merged(camera: CameraModel, captures_dn: list[FloatArray], begin: int) -> NDArray[Any]:
    """Merge DN of captures from `begin` on, those before being saturated."""
    hdr, ladder = camera.hdr, camera.ladder
    assert hdr is not None
    net = [(dn - ladder.zeros_dn[i], i) for i, dn in enumerate(captures_dn, begin)]
    if hdr.method == "normal":
        chosen: NDArray[Any] = np.zeros((), np.int64)
        for dn, i in reversed(net):
            value, taken = normal_stage(dn, i, hdr.bits, ladder)
            chosen = np.where(taken, value, chosen)
        return chosen
    stage = stage_of(hdr.method, hdr.overlap)
    merged = mix(hdr.method, [stage(dn, i, ladder) for dn, i in net], ladder)
    return np.where(np.abs(merged) < ZERO_DN, 0.0, merged)


def _reached_dn(capture: CaptureModel, rates_e_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest DN that pixels of a capture have at rates of the sensor's own photodiode."""
    from scipy.special import gammainccinv, gammaincinv

    sensor = capture.sensor
    light_e = rates_e_s * capture.light_share * capture.exposure_s
    dark_low = dark_high = capture.dark_e
    if sensor.dsnu_e_s:
        order = (sensor.dark_current_e_s / sensor.dsnu_e_s) ** 2
        dark_low *= float(gammaincinv(order, _NEGLIGIBLE)) / order
        dark_high *= float(gammainccinv(order, _NEGLIGIBLE)) / order
    noise_e = CameraModel(sensor, capture.settings).all_noise_e
    spread_e = np.sqrt(light_e + dark_high + (sensor.prnu_rel * light_e) ** 2 + noise_e**2)
    low_e = light_e + dark_low - _REACH * spread_e
    high_e = light_e + dark_high + _REACH * spread_e + _FEW_E
    black_dn, k_dn_per_e = sensor.black_level_dn, capture.k_dn_per_e
    return black_dn + k_dn_per_e * low_e, black_dn + k_dn_per_e * high_e


@dataclass(frozen=True, eq=False)
class _Draws:
    """Points of all that is random in the pixels of some captures."""

    captures: tuple[CaptureModel, ...]

    @cached_property
    def quantiles(self) -> dict[tuple[str, Any], int]:
        """Dimension of each random quantity; the charges, which matter most, are first."""
        names: list[tuple[str, Any]] = [("charge", capture.charge) for capture in self.captures]
        offsets = [capture.readout for capture in self.captures if _offset_e(capture)]
        for number, capture in enumerate(self.captures):
            if self._noise_e(number):
                names.append(("noise", number))
            if offsets.count(capture.readout) > 1:
                names.append(("offset", capture.readout))
        for capture in self.captures:
            names += [("gain", capture.photodiode)] * (capture.sensor.prnu_rel > 0)
            names += [("dark", capture.photodiode)] * (capture.sensor.dsnu_e_s > 0)
        return {name: number for number, name in enumerate(dict.fromkeys(names))}

    def _noise_e(self, number: int) -> float:
        """Noise of reading, with the offsets where no other capture has the same."""
        capture = self.captures[number]
        shared = sum(other.readout == capture.readout for other in self.captures) > 1
        return float(np.hypot(capture.sensor.read_noise_e, 0.0 if shared else _offset_e(capture)))

    def _normal(self, kind: str, key: Any) -> FloatArray | float:
        """Return a standard normal quantity, 0 if it does not vary."""
        dimension = self.quantiles.get((kind, key))
        return 0.0 if dimension is None else normal_points(len(self.quantiles))[dimension]

    def _dark(self, capture: CaptureModel) -> FloatArray | float:
        """Return the dark currents of a photodiode over their mean."""
        dimension = self.quantiles.get(("dark", capture.photodiode))
        if dimension is None:
            return 1.0
        order = (capture.sensor.dark_current_e_s / capture.sensor.dsnu_e_s) ** 2
        return gamma_quantile(order, len(self.quantiles), dimension)

    def dn(self, rates_e_s: Sequence[float]) -> list[FloatArray]:
        """DN of each capture at its rate of the sensor's own photodiode."""
        charges: dict[int, FloatArray] = {}
        values = []
        for number, capture in enumerate(self.captures):
            sensor = capture.sensor
            if capture.charge not in charges:
                gain = np.maximum(1 + sensor.prnu_rel * self._normal("gain", capture.photodiode), 0.0)
                light_e = rates_e_s[number] * capture.light_share * capture.exposure_s
                mean_e = light_e * gain + capture.dark_e * self._dark(capture)
                dimension = self.quantiles["charge", capture.charge]
                charges[capture.charge] = poisson_quantile(mean_e, len(self.quantiles), dimension)
            signal_e = np.minimum(charges[capture.charge], float(np.float32(sensor.full_well_e)))
            signal_e = signal_e + self._noise_e(number) * self._normal("noise", number)
            signal_e += _offset_e(capture) * self._normal("offset", capture.readout)
            dn = np.rint(capture.k_dn_per_e * signal_e + sensor.black_level_dn)
            values.append(np.clip(dn, 0, 2**sensor.bits - 1))
        return values


def _offset_e(capture: CaptureModel) -> float:
    """Return the standard deviation of the offsets of a readout, electrons."""
    return CameraModel(capture.sensor, capture.settings).offset_spread_e
