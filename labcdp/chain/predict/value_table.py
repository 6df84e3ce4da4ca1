"""Exact distribution of the value of a pixel over the rate of photo-electrons, tabulated."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ..hdr import merge_dn, normal_stage
from ..isp import CodeCurve
from .camera import CameraModel
from .merged_rows import merged_rows
from .nodes import KnownRates, RateGrid, gamma_nodes, normal_nodes
from .value_bins import ValueBins

FloatArray = NDArray[np.float64]

#: Rates whose distributions are calculated in one matrix product.
_BLOCK = 64


@dataclass(frozen=True, eq=False)
class ValueTable:
    """Distributions of the values of pixels, without random numbers.

    Parameters
    ----------
    bins : ValueBins
        Values, k of them: DN as the camera gives them (see `CameraModel`), decoded codes, or bins of many values.
    rows : csr_array, shape (nodes, k)
        Probabilities at the nodes of the grid that are used.
    saturated : ndarray, shape (nodes,)
        Share of saturated pixels at each node.
    nodes : ndarray of int, shape (nodes,)
        Their numbers in the grid, rising.
    grid : RateGrid or KnownRates
        Rates of photo-electrons.
    """

    bins: ValueBins
    rows: csr_array
    saturated: FloatArray
    nodes: NDArray[np.intp]
    grid: RateGrid | KnownRates

    def rows_at(self, rates_e_s: FloatArray) -> tuple[csr_array, FloatArray]:
        """Probabilities of all values, shape (n, k), and saturated share at rates of photo-electrons, shape (n,)."""
        index, weight = self.grid.stencil(rates_e_s)
        starts = np.arange(rates_e_s.size + 1) * index.shape[1]
        column = np.searchsorted(self.nodes, index).ravel()
        mix = csr_array((weight.ravel(), column, starts), shape=(rates_e_s.size, self.nodes.size))
        return mix @ self.rows, np.asarray(mix @ self.saturated)

    def blocks(
        self, rates_e_s: FloatArray, shares: FloatArray | None = None
    ) -> Iterator[tuple[NDArray[np.intp], int, FloatArray, FloatArray]]:
        """Distributions at rates of photo-electrons, some at a time, in the order of rising means.

        Parameters
        ----------
        rates_e_s : ndarray, shape (n,), or (n, parts)
            Mean rates.
        shares : ndarray, shape (n, parts), or None
            Share of the pixels that have each of the rates of a row; None where there is one.

        Yields
        ------
        chosen : ndarray of int
            Indices of the rates.
        first : int
            First value that occurs.
        share : ndarray, shape (rates, m)
            Probability of the values from it on.
        saturated : ndarray, shape (rates,)
            Share of saturated pixels.
        """
        rates = rates_e_s.reshape(len(rates_e_s), -1)
        shares = np.ones(rates.shape) if shares is None else shares
        order = np.argsort(np.einsum("np,np->n", rates, shares), kind="stable")
        for begin in range(0, order.size, _BLOCK):
            chosen = order[begin : begin + _BLOCK]
            index, weight = self.grid.stencil(rates[chosen].ravel())
            index = np.searchsorted(self.nodes, index)
            weight *= shares[chosen].reshape(-1, 1)
            low, high = int(index.min()), int(index.max()) + 1
            first, rows = dense_rows(self.rows, low, high)
            starts = np.arange(chosen.size + 1) * (index.size // chosen.size)
            # A product of dense matrices would start threads of its own in each of ours.
            mix = csr_array((weight.ravel(), index.ravel() - low, starts), shape=(chosen.size, high - low))
            yield chosen, first, np.asarray(mix @ rows), np.asarray(mix @ self.saturated[low:high])


def value_table(camera: CameraModel, rates_e_s: FloatArray) -> ValueTable:
    """Tabulate what is needed for given rates of photo-electrons.

    Parameters
    ----------
    camera : CameraModel
        The camera.
    rates_e_s : ndarray
        Mean rates of photo-electrons per second, of any shape.
    """
    return _TableMaker(camera).table(np.unique(rates_e_s))


@dataclass(frozen=True, eq=False)
class _TableMaker:
    camera: CameraModel

    def table(self, rates_e_s: FloatArray) -> ValueTable:
        camera, grid = self.camera, self._grid
        nodes = np.unique(grid.stencil(rates_e_s)[0])
        (gains, gain_shares), (dark, dark_shares) = self._gains, self._dark
        by_gain, used = self._mixing(nodes, np.multiply.outer(grid.rates_e_s[nodes], gains), gain_shares)
        mean_e_s = np.add.outer(grid.rates_e_s[used], camera.dark_e_s * dark)
        by_dark, used = self._mixing(used, mean_e_s, dark_shares)
        bins, rows, saturated = self._rows(grid.rates_e_s[used] + (camera.dark_e_s if by_dark is None else 0.0))
        for mixing in (by_dark, by_gain):
            if mixing is not None:
                rows, saturated = mixing @ rows, np.asarray(mixing @ saturated)
        return ValueTable(bins, rows, saturated, nodes, grid)

    def _mixing(
        self, nodes: NDArray[np.intp], mean_e_s: FloatArray, shares: FloatArray
    ) -> tuple[csr_array | None, NDArray[np.intp]]:
        """Weights of other nodes in the pixels of some nodes, which have each of some mean rates, and these nodes.

        None where all pixels are alike.
        """
        if shares.size == 1:
            return None, nodes
        index, weight = self._grid.stencil(mean_e_s.ravel())
        weight = weight * np.tile(shares, nodes.size)[:, None]
        used, column = np.unique(index, return_inverse=True)
        row = np.repeat(np.arange(nodes.size), shares.size * index.shape[1])
        return csr_array((weight.ravel(), (row, column.ravel())), shape=(nodes.size, used.size)), used

    @cached_property
    def _grid(self) -> RateGrid:
        # Quasi-Monte Carlo errs by more than what wider steps do.
        step = 0.4 if self._mixes else 0.25
        return RateGrid(self.camera.exposures_s, self.camera.certain_e / self._gains[0].min(), step)

    @property
    def _mixes(self) -> bool:
        """Whether a value is made of several exposures."""
        return self.camera.hdr is not None and self.camera.hdr.method != "normal" and len(self.camera.exposures_s) > 1

    @cached_property
    def _gains(self) -> tuple[FloatArray, FloatArray]:
        """Gains of pixels for light (PRNU)."""
        spread, exposures_s = self.camera.sensor.prnu_rel, self.camera.exposures_s
        # Square root of the most electrons that all exposures not saturated hold together.
        root = max(sqrt(self.camera.certain_e / t * sum(exposures_s[i:])) for i, t in enumerate(exposures_s))
        # Rates just beyond saturation reach back to it.
        nodes, frequency = normal_nodes(spread * (1 + 8 * spread) * root)
        return 1 + spread * nodes, frequency

    @cached_property
    def _dark(self) -> tuple[FloatArray, FloatArray]:
        """Dark currents of pixels over the mean one."""
        sensor = self.camera.sensor
        if sensor.dsnu_e_s == 0:
            return np.ones(1), np.ones(1)
        order = (sensor.dark_current_e_s / sensor.dsnu_e_s) ** 2
        dark_e = self.camera.dark_e_s * self.camera.exposures_s[0]
        # Shot noise of the dark current itself is the least there is.
        return gamma_nodes(order, sqrt(dark_e))

    def _rows(self, totals_e_s: FloatArray) -> tuple[ValueBins, csr_array, FloatArray]:
        """Values, probabilities and saturated share at total rates, dark current included."""
        camera, tone_curve = self.camera, self.camera.tone_curve
        if self._mixes:
            return self._binned_rows(totals_e_s)
        values, rows = self._exact_rows(totals_e_s)
        saturated = np.asarray(rows @ (values >= camera.saturation_dn).astype(np.float64))
        if tone_curve is None:
            return ValueBins.alone(values), rows, saturated
        return code_bins(tone_curve), rows @ indicator(tone_curve.encode(values), tone_curve.n_codes), saturated

    def _exact_rows(self, totals_e_s: FloatArray) -> tuple[FloatArray, csr_array]:
        """Whole DN of a single exposure, or of a merge that takes one of them."""
        camera, hdr, count = self.camera, self.camera.hdr, len(self.camera.exposures_s)
        values: FloatArray = np.arange(2.0**camera.sensor.bits)
        net_dn = values - camera.sensor.black_level_dn
        if count == 1:
            (rows,) = camera.dn_rows(totals_e_s * camera.exposures_s[0])
            if hdr is not None:
                values = merge_dn(hdr.method, hdr.bits, [net_dn], camera.ladder).astype(np.float64)
            return values, rows
        assert hdr is not None
        stages = [normal_stage(net_dn, i, hdr.bits, camera.ladder) for i in range(count)]
        values = np.concatenate([value[taken] for value, taken in stages]).astype(np.float64)
        order = np.argsort(values, kind="stable")
        rank = np.empty_like(order)
        rank[order] = np.arange(order.size)
        starts = np.cumsum([0, *(taken.sum() for _, taken in stages)])
        total = csr_array((totals_e_s.size, values.size))
        offsets_e, frequency = self._offsets
        left = np.repeat(frequency[:, None], totals_e_s.size, axis=1)
        for i, (_, taken) in enumerate(stages):
            exposed = camera.dn_rows(totals_e_s * camera.exposures_s[i], offsets_e)
            for share, open_share in zip(exposed, left, strict=True):
                index = rank[starts[i] + np.cumsum(taken) - 1]
                chosen = share @ indicator(index[taken], values.size, np.flatnonzero(taken), taken.size)
                total = total + chosen.multiply(open_share[:, None]).tocsr()
                open_share *= share @ np.where(taken, 0.0, 1.0)
        return values[order], total

    def _binned_rows(self, totals_e_s: FloatArray) -> tuple[ValueBins, csr_array, FloatArray]:
        """Bins of a merge that mixes exposures, probabilities, and the share clipped in all."""
        camera = self.camera
        assert camera.hdr is not None
        ladder, tone_curve, (offsets_e, frequency) = camera.ladder, camera.tone_curve, self._offsets
        exposures = list(zip(*(camera.dn_rows(totals_e_s * t, offsets_e) for t in camera.exposures_s), strict=True))
        net_dn = np.arange(2.0**camera.sensor.bits) - camera.sensor.black_level_dn
        merge = partial(merged_rows, camera.hdr.method, ladder, exposures, frequency, net_dn)
        if tone_curve is None:
            bins = ValueBins.for_merge(camera)
            rows = merge(bins.edges)
        else:
            bins = code_bins(tone_curve)
            rows = merge(np.concatenate([[-np.inf], tone_curve.first_dn[1:], [tone_curve.top_dn, np.inf]]))
            clipped_by_curve = np.asarray(rows[:, [-1]].todense()).ravel()
            rows = rows @ indicator(np.minimum(np.arange(rows.shape[1]), rows.shape[1] - 2), rows.shape[1] - 1)
            if tone_curve.top_dn < ladder.merged_saturation_dn:
                return bins, rows, clipped_by_curve
        clipped = (net_dn >= ladder.saturations_dn[0]).astype(np.float64)
        saturated = np.zeros(totals_e_s.size)
        for share, exposure_rows in zip(frequency, exposures, strict=True):
            saturated += share * (exposure_rows[-1] @ clipped)
        return bins, rows, saturated

    @cached_property
    def _offsets(self) -> tuple[FloatArray, FloatArray]:
        """Offsets of pixels in electrons, and how frequent each is."""
        spread_e = self.camera.offset_spread_e
        if spread_e == 0:
            return np.zeros(1), np.ones(1)
        read_noise_e, step_e = self.camera.sensor.read_noise_e, 1 / self.camera.k_dn_per_e
        smooth_e = max(read_noise_e, spread_e / 4)
        if read_noise_e < 0.15 * step_e:
            # Nothing smooths the rounding: nodes closer than its step average over it.
            smooth_e = min(smooth_e, max(0.1 * step_e, spread_e / 40))
        nodes, frequency = normal_nodes(spread_e / smooth_e)
        return spread_e * nodes, frequency


def code_bins(tone_curve: CodeCurve) -> ValueBins:
    """Return the decoded values of all codes."""
    return ValueBins.alone(tone_curve.decode(np.arange(tone_curve.n_codes)))


def dense_rows(rows: csr_array, low: int, high: int) -> tuple[int, NDArray[np.float64]]:
    """Rows of a sparse matrix from the first column any of them uses to the last one."""
    part = rows[low:high]
    first, end = int(part.indices.min()), int(part.indices.max()) + 1
    return first, csr_array((part.data, part.indices - first, part.indptr), shape=(high - low, end - first)).toarray()


def indicator(
    column: NDArray[Any], columns: int, row: NDArray[np.intp] | None = None, rows: int | None = None
) -> csr_array:
    """Matrix of ones in one column of each of some rows."""
    row = np.arange(column.size) if row is None else row
    return csr_array((np.ones(column.size), (row, column)), shape=(rows or column.size, columns))
