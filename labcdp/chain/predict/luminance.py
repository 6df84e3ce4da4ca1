"""Prediction of the luminance combined of the planes of a colour filter: sums of independent pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array

from ...core.errors import PredictionError
from ..chain import Chain
from ..colour import seen_sensor
from ..luminance import cell_sensors, luminance_weights
from ..scene.lamp import LampScene
from ..scene.scene import Scene
from ..sensor import Sensor
from .capture_table import capture_table
from .mixed_pixels import is_mixed
from .nodes import KnownRates
from .pairs import Cells, ExactPrediction, evaluate_cells, with_regions_exchanged
from .prediction import checked_targets
from .rates import SeenLevels, plane_rates, veil_lx
from .stage import camera_of_stage
from .value_bins import ValueBins
from .value_table import ValueTable, value_table

FloatArray = NDArray[np.float64]

#: Steps of the sums in a standard deviation of the narrowest sum or pixel, which add 1e-4 of the variance, and most.
_STEPS, _MOST_STEPS = 40, 2**20
#: Probability of a value of a pixel below which it is left out.
_NEGLIGIBLE = 1e-12


def predict_luminance(
    chain: Chain,
    sensor: Sensor,
    stage: str,
    scenes: Sequence[Scene],
    seen_levels: SeenLevels,
    contrast: ArrayLike,
    epsilon: float,
) -> ExactPrediction:
    """Predict the CDP of the luminance of the cells of a colour filter, for the first pair of each scene.

    Parameters
    ----------
    chain : Chain
        The chain.
    sensor : Sensor
        Its sensor, of which the luminance is looked at.
    stage : str
        Name of the stage, without that of the sensor.
    scenes : sequence of Scene
        The scenes.
    seen_levels : SeenLevels
        Their levels, and the two regions.
    contrast : array_like of float
        Target contrasts, fractions, that of each scene or several of one.
    epsilon : float
        Its tolerance.

    Raises
    ------
    PredictionError
        If pixels see more than one luminance, or a pulsed lamp.

    Notes
    -----
    The pixels of a cell are independent: the distribution of their weighted sum is the convolution of theirs, which are
    those of `predict`, on even steps. Values between two steps are shared by both, which keeps the mean. CDP is within
    1e-3 where no pixel has less noise than a fifth of its DN; else the few values that there are lie on ends of
    intervals that steps cannot resolve.
    """
    if isinstance(chain.scene, LampScene):
        raise PredictionError(
            "the luminance of several planes of a pulsed lamp cannot be predicted: simulate, or choose a plane"
        )
    if is_mixed(chain):
        raise PredictionError(
            "the luminance of several planes behind a lens that blurs, or of a scene that is sampled finer than the "
            "pixels, cannot be predicted: simulate instead"
        )
    targets = checked_targets(contrast, epsilon)
    n_cells = np.broadcast_shapes(targets.shape, (len(scenes),))[0]
    targets = np.broadcast_to(targets, (n_cells,))
    pixels = _pixels(chain, sensor, stage, scenes, seen_levels)
    results = np.empty((len(fields(ExactPrediction)), n_cells))
    for number in range(n_cells):
        low, high = targets[number] * (1 - epsilon), targets[number] * (1 + epsilon)
        results[:, number] = _pair([pixel.of_scene(number % len(scenes)) for pixel in pixels], low, high)
    return ExactPrediction(*results)


class _Pixel:
    """A pixel of a cell: its weighted luminance in both regions of each scene."""

    def __init__(self, table: ValueTable, rates_e_s: FloatArray, luminances: FloatArray, offsets: FloatArray) -> None:
        self._table, self._rates, self._luminances, self._offsets = table, rates_e_s, luminances, offsets

    def of_scene(self, number: int) -> list[tuple[FloatArray, FloatArray, float]]:
        """Values, their probabilities and the saturated share of the dark and the bright region."""
        rows, saturated = self._table.rows_at(self._rates[number])
        result = []
        for region in range(2):
            row = rows[[region]].toarray()[0]
            kept = row > _NEGLIGIBLE
            values = self._luminances[kept] + self._offsets[number]
            result.append((values, row[kept] / row[kept].sum(), float(np.clip(saturated[region], 0, 1))))
        return result


def _pixels(chain: Chain, sensor: Sensor, stage: str, scenes: Sequence[Scene], seen_levels: SeenLevels) -> list[_Pixel]:
    """Return the four pixels of a cell."""
    weights, cells = luminance_weights(sensor, chain.spectrum), cell_sensors(sensor)
    names = [name for name, _ in cells]
    levels, shares, _ = seen_levels
    front = chain.front(levels, shares)
    # Luminance is a straight line over the illuminance, whose veil may differ from scene to scene.
    points = np.broadcast_to([[0.0, 1.0]], (len(scenes), 2))
    at_0, at_1 = np.broadcast_to(front.to_luminance(points), points.shape).T
    # Refuses what is not linear.
    veil_lx(front, len(scenes))
    slope = float((at_1 - at_0)[0])
    kinds: dict[str, _Pixel] = {}
    for name, part in cells:
        if name in kinds:
            continue
        camera = camera_of_stage(chain, seen_sensor(part, chain.spectrum), stage)
        per_lx_s = camera.sensor.electrons_per_lx_s(chain.spectrum)
        ((_, seen),) = plane_rates(chain, part, scenes, per_lx_s, seen_levels)
        rates = np.stack([region[:, 0] for region, _ in seen], axis=1)
        table = (capture_table if camera.merges_captures else value_table)(camera, rates)
        weight = weights[name] / names.count(name)
        lux = (table.bins.values - camera.dark_dn) / (camera.dn_per_e_s * per_lx_s)
        kinds[name] = _Pixel(table, rates, weight * slope * lux, weight * at_0)
    return [kinds[name] for name in names]


def _pair(pixels: Sequence[list[tuple[FloatArray, FloatArray, float]]], low: float, high: float) -> FloatArray:
    """Evaluate all pairs of cells of two regions."""
    sums = [_sum([pixel[region][:2] for pixel in pixels]) for region in range(2)]
    full = [1 - float(np.prod([1 - pixel[region][2] for pixel in pixels])) for region in range(2)]
    means = [float(values @ shares) for values, shares, _ in sums]
    order = [0, 1] if means[0] <= means[1] else [1, 0]
    edges = np.unique(np.concatenate([np.append(values - step / 2, values[-1] + step / 2) for values, _, step in sums]))
    rows = []
    for values, shares, step in sums:
        own = np.append(values - step / 2, values[-1] + step / 2)
        rows.append(np.diff(np.interp(edges, own, np.concatenate([[0.0], np.cumsum(shares)]))))
    bins = ValueBins(edges, (edges[1:] + edges[:-1]) / 2, np.zeros(edges.size - 1, dtype=np.bool_))
    table = ValueTable(bins, csr_array(np.stack(rows)), np.array(full), np.arange(2), KnownRates(np.arange(2.0)))
    one = np.ones((1, 1))
    dark, bright = ((np.array([[float(number)]]), one) for number in order)
    cells = Cells(dark, bright, np.zeros(1), np.array([low]), np.array([high]))
    pair = ExactPrediction(*evaluate_cells(table, cells)[:, 0])
    return np.array(list(vars(with_regions_exchanged(pair, np.array(order[0] == 1))).values()), dtype=np.float64)


def _sum(parts: Sequence[tuple[FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray, float]:
    """Return even values, their probabilities and their step for a sum of independent values."""
    from scipy.signal import fftconvolve

    deviations = [np.sqrt(max(float(shares @ (values - values @ shares) ** 2), 0.0)) for values, shares in parts]
    span = sum(float(np.ptp(values)) for values, _ in parts)
    scale = max(abs(float(values @ shares)) for values, shares in parts)
    step = max(float(np.linalg.norm(deviations)) / _STEPS, span / _MOST_STEPS, scale * 1e-9, 1e-30)
    total, start = np.ones(1), 0.0
    for values, shares in parts:
        position = (values - values.min()) / step
        lower = np.floor(position).astype(np.intp)
        size = int(lower.max()) + 2
        share = position - lower
        even = np.bincount(lower, shares * (1 - share), size) + np.bincount(lower + 1, shares * share, size)
        total, start = fftconvolve(total, even), start + float(values.min())
    total = np.maximum(total, 0.0)
    return np.asarray(start + step * np.arange(total.size)), np.asarray(total / total.sum()), step
