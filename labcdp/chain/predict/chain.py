"""Prediction of a whole chain without random numbers, for its first pair of regions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...core.errors import InputError
from ..chain import Chain
from ..colour import seen_sensor
from ..luminance import is_combined
from ..scene.lamp import LampScene
from ..scene.spectra import spectra_of
from .camera import CameraModel
from .lamp import predict_lamp
from .luminance import predict_luminance
from .pairs import ExactPrediction, with_regions_exchanged
from .prediction import PatchRates, predict
from .rates import pair_rates, scene_contrast, scene_levels, scenes_of_cells
from .stage import camera_of_stage, sensor_of_stage


def predict_chain(
    chain: Chain,
    scenes: Mapping[str, Sequence[Any]] | None = None,
    *,
    stage: str | None = None,
    contrast: ArrayLike | None = None,
    epsilon: float = 0.5,
) -> ExactPrediction:
    """Predict CDP and its relatives behind one stage, on the optical axis.

    Parameters
    ----------
    chain : Chain
        With one EMVA 1288 sensor; the stages before it must be linear in luminance, the only one behind it may be a
        tone curve.
    scenes : mapping of str to sequence, or None
        Fields of the scene with a value for each of n cells, for example ``luminance_cd_m2``; None for the scene as
        it is, one cell.
    stage : str or None
        A stage at or behind the sensor, None for the last.
    contrast : array_like of float, or None
        Weber contrast to be detected, a fraction, that of each cell, or several of one cell; None for that of each
        cell's scene.
    epsilon : float
        Its tolerance.

    Returns
    -------
    ExactPrediction
        Arrays of shape (n,), n the number of cells or contrasts.

    Raises
    ------
    InputError
        If the chain cannot be predicted so, or a value is out of its range.
    """
    sensor, name = sensor_of_stage(chain, stage or chain.stage_names[-1])
    camera = camera_of_stage(chain, seen_sensor(sensor, chain.spectrum), name)
    cells = scenes_of_cells(chain.scene, scenes or {})
    seen = scene_levels(cells)
    if contrast is None:
        levels, _, pair = seen
        contrast = scene_contrast(*(levels[:, index] for index in pair))
    if is_combined(sensor):
        return predict_luminance(chain, sensor, name, cells, seen, contrast, epsilon)
    lamps = [cell for cell in cells if isinstance(cell, LampScene)]
    if lamps:
        return predict_lamp(chain, sensor, name, lamps, camera, contrast, epsilon)
    rates = pair_rates(chain, sensor, camera, cells, seen)
    is_coloured = bool(sensor.colour_filter or spectra_of(chain.scene))
    return (_brighter_first if is_coloured else predict)(camera, rates, contrast, epsilon)


def _brighter_first(camera: CameraModel, rates: PatchRates, contrast: ArrayLike, epsilon: float) -> ExactPrediction:
    """Predict pairs of which colour can make the darker region the brighter one: it then is the bright one of CDP."""
    dark, bright = rates.patches()
    full_e_s = (camera.saturation_dn - camera.dark_dn) / camera.dn_per_e_s
    dark_mean, bright_mean = (np.sum(np.minimum(e_s, full_e_s) * shares, axis=1) for e_s, shares in (dark, bright))
    is_changed = dark_mean > bright_mean
    if not is_changed.any():
        return predict(camera, rates, contrast, epsilon)
    veil = np.broadcast_to(rates.veil_e_s, is_changed.shape)
    straight = predict(camera, rates, contrast, epsilon)
    changed = predict(camera, PatchRates(bright[0], dark[0], veil, bright[1], dark[1]), contrast, epsilon)
    changed = with_regions_exchanged(changed, is_changed)
    names = [field.name for field in fields(ExactPrediction)]
    return ExactPrediction(*(np.where(is_changed, getattr(changed, name), getattr(straight, name)) for name in names))


def known_transitions(chain: Chain, stage: str | None = None) -> tuple[float, ...]:
    """Luminances of the dark region at which a merge leaves each capture but the least sensitive.

    Parameters
    ----------
    chain : Chain
        As for `predict_chain`.
    stage : str or None
        Name of the stage, None for the last.

    Returns
    -------
    tuple of float
        None without a merge, or of a chain that cannot be predicted.
    """
    if chain.hdr is None or chain.settings is None:
        return ()
    try:
        sensor, _ = sensor_of_stage(chain, stage or chain.stage_names[-1])
        sensor = seen_sensor(sensor, chain.spectrum)
        camera = CameraModel(sensor, chain.settings, chain.hdr, spectrum=chain.spectrum)
        ladder = camera.ladder
        levels, shares, (dark, _) = scene_levels([chain.scene])
        front = chain.front(levels, shares)
    except InputError:
        return ()
    # A veil that does not depend on the scene is there without it, too.
    per_lx = sensor.electrons_per_lx_s(chain.spectrum)
    veil_e_s = float(chain.front(0 * levels, shares).values[0, dark]) * per_lx
    electrons_s = float(front.values[0, dark]) * per_lx - veil_e_s
    if electrons_s == 0:
        return ()
    luminances = []
    for index, capture in enumerate(camera.captures[:-1]):
        net_dn = ladder.saturations_dn[index]
        if chain.hdr.method == "normal":
            threshold_dn = 2 ** (chain.hdr.bits / len(ladder) * (index + 1)) / ladder.ratios[index]
            net_dn = min(net_dn, threshold_dn)
        if chain.hdr.method == "most-sensitive":
            net_dn *= 1 - chain.hdr.overlap / 2
        signal_e = (net_dn + ladder.zeros_dn[index] - capture.sensor.black_level_dn) / capture.k_dn_per_e
        rate = (signal_e - capture.dark_e) / capture.exposure_s / capture.light_share
        # Light and the other glare grow with the scene.
        luminances.append(float(levels[0, dark]) * (rate - veil_e_s) / electrons_s)
    return tuple(luminance for luminance in luminances if luminance > 0)
