"""Prediction of a pulsed lamp and its surroundings: at its phase, or over all phases of a lamp at random."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.errors import PredictionError
from ..chain import Chain
from ..colour import seen_sensor
from ..lamp import CaptureTime
from ..scene.lamp import LampScene
from ..sensor import Sensor
from .camera import CameraModel
from .mixed_pixels import is_mixed
from .pairs import ExactPrediction, with_regions_exchanged
from .prediction import CaptureRates, captured_moments, predict_captures
from .rates import pair_rates, scene_levels
from .stage import camera_of_stage, sensor_of_stage

FloatArray = NDArray[np.float64]
#: Cells of several captures that are predicted at once: the distributions at all their phases are held, some MB a cell.
_CELLS = 8
#: First nodes over the phase of a pulsed lamp at random.
_PHASES = 48
#: Share of the period times change of what is followed, above which an interval is divided; parts that it then has, and
#: how often at most.
_STEP, _PARTS, _REFINEMENTS = 5e-4, 4, 4


def predict_lamp(
    chain: Chain,
    sensor: Sensor,
    stage: str,
    cells: Sequence[LampScene],
    camera: CameraModel,
    contrast: ArrayLike,
    epsilon: float,
) -> ExactPrediction:
    """Predict the lamp and its surroundings in each cell; the contrast is that of the brighter one at each phase.

    Parameters
    ----------
    chain : Chain
        The chain, whose scene is a lamp.
    sensor : Sensor
        The sensor with its captures.
    stage : str
        Name of the stage, without that of the sensor.
    cells : sequence of LampScene
        The lamps.
    camera : CameraModel
        What is predicted.
    contrast : array_like of float
        Target contrasts, fractions, that of each cell or several of one cell.
    epsilon : float
        Its tolerance.
    """
    if is_mixed(chain):
        raise PredictionError("a pulsed lamp behind a lens that blurs cannot be predicted: simulate, or set no blur")
    targets = np.asarray(contrast, dtype=np.float64)
    n_cells = np.broadcast_shapes(targets.shape, (len(cells),))[0]
    cells, times = list(cells) * (n_cells // len(cells)), capture_times(chain, sensor, stage)
    targets = np.broadcast_to(targets, (n_cells,))

    size = n_cells if len(times) == 1 else _CELLS
    parts = []
    for begin in range(0, n_cells, size):
        part = slice(begin, begin + size)
        parts.append(_predict_part(chain, sensor, camera, cells[part], times, targets[part], epsilon))
    return ExactPrediction(*np.concatenate(parts, axis=1))


def _predict_part(
    chain: Chain,
    sensor: Sensor,
    camera: CameraModel,
    cells: Sequence[LampScene],
    times: Sequence[CaptureTime],
    targets: FloatArray,
    epsilon: float,
) -> FloatArray:
    """Predict some cells, shape (fields, cells)."""
    names = [field.name for field in fields(ExactPrediction)]
    is_lamp_dark = np.array([cell.luminance_cd_m2 < cell.background_cd_m2 for cell in cells])

    def evaluate(nodes: _Nodes) -> tuple[FloatArray, FloatArray]:
        rates = lamp_rates(chain, sensor, camera, [cells[number] for number in nodes.cell], nodes.phase, times)
        each, is_lamp_brighter = predict_captures(camera, rates, targets[nodes.cell], epsilon)
        # Rises with the light of the lamp, through 0 where it is as bright as its surroundings.
        position = (each.cdp + 2 * each.above) * np.where(is_lamp_brighter, 1.0, -1.0)
        each = with_regions_exchanged(each, is_lamp_brighter == is_lamp_dark[nodes.cell])
        return np.stack([getattr(each, name) for name in names]), position

    return _over_phases(cells, times, evaluate)


class _Nodes(NamedTuple):
    """Cells and phases, in rising order."""

    cell: NDArray[np.intp]
    phase: FloatArray


def _over_phases(
    cells: Sequence[LampScene],
    times: Sequence[CaptureTime],
    evaluate: Callable[[_Nodes], tuple[FloatArray, FloatArray]],
) -> FloatArray:
    """Return the mean of values over the phase of each cell, shape (values, cells).

    By the trapezoidal rule, with more nodes where a value that is followed changes: a contrast passes an end of its
    interval within a small part of the period.
    """
    starts = [cell.lamp.phase_nodes(times, _PHASES) if cell.phase is None else [cell.phase] for cell in cells]
    new = _Nodes(np.repeat(np.arange(len(cells)), [len(start) for start in starts]), np.concatenate(starts))
    nodes, values, followed = _Nodes(np.empty(0, np.intp), np.empty(0)), np.empty((0, 0)), np.empty(0)
    for is_last in (*[False] * _REFINEMENTS, True):
        new_values, new_followed = evaluate(new)
        cell, phase = (np.concatenate(arrays) for arrays in zip(nodes, new, strict=True))
        order = np.lexsort((phase, cell))
        nodes = _Nodes(cell[order], phase[order])
        values = np.concatenate([values.reshape(len(new_values), -1), new_values], axis=1)[:, order]
        followed = np.concatenate([followed, new_followed])[order]
        width = np.where(np.diff(nodes.cell) == 0, np.diff(nodes.phase), 0.0)
        wide = np.flatnonzero(width * np.abs(np.diff(followed)) > _STEP)
        if is_last or not wide.size:
            break
        inner = nodes.phase[wide, None] + width[wide, None] * np.arange(1, _PARTS) / _PARTS
        new = _Nodes(np.repeat(nodes.cell[wide], _PARTS - 1), inner.ravel())
    shares = (np.append(width, 0.0) + np.append(0.0, width)) / 2
    shares[np.isin(nodes.cell, [number for number, cell in enumerate(cells) if cell.phase is not None])] = 1.0
    return np.asarray(np.add.reduceat(shares * values, np.searchsorted(nodes.cell, np.arange(len(cells))), axis=1))


def lamp_rates(
    chain: Chain,
    sensor: Sensor,
    camera: CameraModel,
    cells: Sequence[LampScene],
    phases: FloatArray,
    times: Sequence[CaptureTime],
) -> CaptureRates:
    """Return the rates of the pixels around the lamp and in it during each capture, each cell at its phase."""
    frames = [replace(cell, phase=phase % 1.0) for cell, phase in zip(cells, phases.tolist(), strict=True)]
    by_capture = []
    for time in times:
        scenes = [frame.seen_by(time) for frame in frames]
        seen = scene_levels(scenes, ("background", "lamp"))
        by_capture.append(pair_rates(chain, sensor, camera, scenes, seen))
    return CaptureRates.joined(by_capture)


def capture_times(chain: Chain, sensor: Sensor, stage: str) -> list[CaptureTime]:
    """Return the times of what is made into the values of a stage, most sensitive capture first."""
    assert chain.settings is not None
    times, number = chain.capture_times(sensor), chain.recorded_names.index(stage)
    if number < len(times):
        return [times[number]]
    models = sensor.capture_models(chain.settings, chain.spectrum)
    return [times[index] for index in sorted(range(len(times)), key=lambda index: -models[index].sensitivity_s)]


@dataclass(frozen=True, eq=False)
class LampSignal:
    """Merged signal of the pixels of a pulsed lamp over its phase.

    Parameters
    ----------
    phases : ndarray, shape (n,)
        From a phase to the same one of the next period.
    mean_dn, variance_dn2 : ndarray, shape (n,)
        Of the pixels at each phase, above dark signal and veil.
    saturated : ndarray, shape (n,)
        Share of saturated pixels.
    off_dn : float
        Mean with the lamp off.
    """

    phases: FloatArray
    mean_dn: FloatArray
    variance_dn2: FloatArray
    saturated: FloatArray
    off_dn: float


def lamp_signals(chain: Chain, cells: Sequence[LampScene], stage: str) -> list[LampSignal]:
    """Predict the signal of lamps behind a stage that several captures are merged into.

    Parameters
    ----------
    chain : Chain
        The chain, whose scene is a lamp.
    cells : sequence of LampScene
        The lamps.
    stage : str
        Name of the stage, as in a run.
    """
    sensor, name = sensor_of_stage(chain, stage)
    camera = camera_of_stage(chain, seen_sensor(sensor, chain.spectrum), name)
    times = capture_times(chain, sensor, name)
    signals: list[LampSignal] = []
    for begin in range(0, len(cells), _CELLS):
        signals += _signals(chain, sensor, camera, cells[begin : begin + _CELLS], times)
    return signals


def _signals(
    chain: Chain, sensor: Sensor, camera: CameraModel, cells: Sequence[LampScene], times: Sequence[CaptureTime]
) -> list[LampSignal]:
    phases = [cell.lamp.phase_nodes(times, _PHASES) for cell in cells]
    # Without the lamp, last: a steady one at the light in between.
    dark = [
        replace(cell, luminance_cd_m2=cell.luminance_cd_m2 * cell.off_level / cell.lamp.mean_level, duty=1.0)
        for cell in cells
    ]
    counts = [nodes.size for nodes in phases]
    lamps = [cell for cell, count in zip(cells, counts, strict=True) for _ in range(count)] + dark
    rates = lamp_rates(chain, sensor, camera, lamps, np.concatenate([*phases, np.zeros(len(dark))]), times)
    _, (lamp_e_s, parts) = rates.patches
    mean, variance, saturated = captured_moments(camera, lamp_e_s, parts)
    mean = mean - (camera.dark_dn + camera.dn_per_e_s * rates.veil_e_s)
    ends = np.cumsum(counts)
    spans = [slice(end - count, end) for end, count in zip(ends.tolist(), counts, strict=True)]
    return [
        LampSignal(nodes, mean[span], variance[span], saturated[span], float(mean[ends[-1] + number]))
        for number, (nodes, span) in enumerate(zip(phases, spans, strict=True))
    ]
