"""Prediction of a whole chain without random numbers, for its first pair of regions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.errors import InputError, PredictionError
from ..chain import Chain
from ..colour import SeenPlane, seen_planes, seen_sensor
from ..isp import CodeCurve
from ..scene.lamp import LampScene, light_of_frame
from ..scene.scene import Scene
from ..scene.spectra import spectra_of
from ..sensor import Sensor
from ..signal import Signal
from .camera import CameraModel
from .mixed_pixels import is_mixed, mixed_pair
from .pairs import ExactPrediction
from .prediction import PatchRates, predict

FloatArray = NDArray[np.float64]
#: Phases of a pulsed lamp at random.
_PHASES = 64


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
    if isinstance(chain.scene, LampScene):
        return _over_phases(chain, cells, camera, contrast, epsilon)
    levels, shares, pair = scene_levels(cells)
    front = chain.front(levels, shares)
    # Of a single capture, its own.
    per_lx_s = camera.sensor.electrons_per_lx_s(chain.spectrum)
    veil_e_s = veil_lx(front, len(levels)) * per_lx_s
    if contrast is None:
        contrast = _scene_contrast(*(levels[:, index] for index in pair))
    if sensor.colour_filter or spectra_of(chain.scene):
        return _brighter_first(camera, _coloured_rates(chain, sensor, cells, per_lx_s, veil_e_s), contrast, epsilon)
    if is_mixed(chain):
        (dark, dark_shares), (bright, bright_shares) = mixed_pair(chain, cells, front.values, sensor.pixel_pitch_m)
        rates = PatchRates(per_lx_s * dark, per_lx_s * bright, veil_e_s, dark_shares, bright_shares)
    else:
        dark, bright = (front.values[:, index] * per_lx_s for index in pair)
        rates = PatchRates(dark, bright, veil_e_s)
    return predict(camera, rates, contrast, epsilon)


def _over_phases(
    chain: Chain, cells: Sequence[Any], camera: CameraModel, contrast: ArrayLike | None, epsilon: float
) -> ExactPrediction:
    """Predict a pulsed lamp and its surroundings: at its phase, or the mean over all phases of a lamp at random."""
    if is_mixed(chain):
        raise PredictionError("a pulsed lamp behind a lens that blurs cannot be predicted: simulate, or set no blur")
    levels, shares, pair = scene_levels(cells)
    phases = [cell.at_phases(_PHASES) for cell in cells]
    frames = [light_of_frame(scene, chain.exposures_s, 0) for scenes in phases for scene in scenes]
    seen = np.array([[level.luminance_cd_m2 for level in frame.levels()] for frame in frames])
    seen_shares = np.repeat(shares, len(phases[0]), axis=0)
    front = chain.front(seen, seen_shares)
    per_lx_s = camera.sensor.electrons_per_lx_s(chain.spectrum)
    targets = _scene_contrast(*(levels[:, index] for index in pair)) if contrast is None else np.asarray(contrast)
    n_targets = np.broadcast_shapes(targets.shape, (len(cells),))[0]
    n_phases = len(phases[0])
    rates = [np.reshape(front.values[:, index] * per_lx_s, (len(cells), n_phases)) for index in pair]
    veil = np.reshape(veil_lx(front, len(frames)) * per_lx_s, (len(cells), n_phases))
    dark, bright, veils = (np.broadcast_to(array, (n_targets, n_phases)).ravel() for array in (*rates, veil))
    wanted = np.repeat(np.broadcast_to(targets, (n_targets,)), n_phases)
    each = predict(camera, PatchRates(dark, bright, veils), wanted, epsilon)
    names = [field.name for field in fields(ExactPrediction)]
    return ExactPrediction(*(np.reshape(getattr(each, name), (n_targets, n_phases)).mean(axis=1) for name in names))


def _scene_contrast(dark: FloatArray, bright: FloatArray) -> FloatArray:
    """Return the Weber contrast of each cell's scene."""
    if not (dark > 0).all():
        raise InputError("the dark region has a luminance of 0 and its contrast is infinite: give a target contrast")
    # 1.3 / 1 - 1 is not 0.3 in binary.
    return np.asarray(np.round(bright / dark - 1, 12))


def _coloured_rates(
    chain: Chain, sensor: Sensor, cells: Sequence[Scene], per_lx_s: float, veil_e_s: FloatArray
) -> PatchRates:
    """Rates of the pixels of each plane that is looked at, with their shares, for regions of several spectra."""
    patches: list[list[tuple[FloatArray, FloatArray]]] = [[], []]
    for plane, seen in plane_rates(chain, sensor, cells, per_lx_s):
        for patch, (rates, parts) in zip(patches, seen, strict=True):
            patch.append((rates, plane.share * parts))
    (dark, dark_shares), (bright, bright_shares) = (
        tuple(np.concatenate(arrays, axis=1) for arrays in zip(*patch, strict=True)) for patch in patches
    )
    return PatchRates(dark, bright, veil_e_s, dark_shares, bright_shares)


def plane_rates(
    chain: Chain, sensor: Sensor, cells: Sequence[Scene], per_lx_s: float
) -> Iterator[tuple[SeenPlane, Sequence[tuple[FloatArray, FloatArray]]]]:
    """Yield each plane that is looked at with the rates of both regions' pixels, veil included, and their shares."""
    levels, shares, pair = scene_levels(cells)
    spectra = spectra_of(chain.scene)
    reference = seen_sensor(sensor, chain.spectrum).electrons_per_lx_s(chain.spectrum) / sensor.pixel_pitch_m**2
    for plane in seen_planes(sensor):
        factors = [plane.relative(level, spectra, chain.spectrum) for level in chain.scene.levels()]
        front = chain.front(levels * factors, shares)
        scale = per_lx_s * plane.per_cd_m2(chain.spectrum) / reference
        if is_mixed(chain):
            seen = mixed_pair(chain, cells, front.values, sensor.pixel_pitch_m)
        else:
            seen = [(front.values[:, [index]], np.ones((len(cells), 1))) for index in pair]
        yield plane, [(scale * lux, parts) for lux, parts in seen]


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
    changed = replace(
        changed,
        snr_dark=changed.snr_bright,
        snr_bright=changed.snr_dark,
        saturated_share=changed.saturated_share_dark,
        saturated_share_dark=changed.saturated_share,
    )
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


def sensor_of_stage(chain: Chain, stage: str) -> tuple[Sensor, str]:
    """Sensor that a stage belongs to, and the stage's name without the sensor's."""
    for sensor_name, sensor in chain.sensors:
        for name in chain.recorded_names:
            if chain.sensor_stage_name(name, sensor_name) == stage:
                if isinstance(sensor, Sensor):
                    return sensor, name
                raise PredictionError(
                    f"sensor {sensor_name!r} is not an EMVA 1288 sensor, the only kind that can be predicted: "
                    "simulate instead"
                )
    known = [
        chain.sensor_stage_name(name, sensor_name) for sensor_name, _ in chain.sensors for name in chain.recorded_names
    ]
    raise PredictionError(
        f"stage is {stage!r}, which cannot be predicted: give one of {', '.join(known) or 'a sensor'}"
    )


def camera_of_stage(chain: Chain, sensor: Sensor, stage: str) -> CameraModel:
    """Sensor, exposures, merge and tone curve up to a stage."""
    assert chain.settings is not None
    names = chain.recorded_names
    index = names.index(stage)
    if index < len(chain.capture_names):
        capture = sensor.capture_models(chain.settings, chain.spectrum)[index]
        return CameraModel(capture.sensor, capture.settings)
    curves = [curve for name, curve in chain.behind if names.index(name) <= index]
    if len(curves) > 1 or not all(isinstance(curve, CodeCurve) for curve in curves):
        raise PredictionError(
            f"{stage} follows stages other than a single tone curve: simulate, or choose an earlier stage"
        )
    curve = curves[0] if curves else None
    tone_curve = curve if isinstance(curve, CodeCurve) else None
    return CameraModel(sensor, chain.settings, chain.hdr, tone_curve, chain.spectrum)


def scenes_of_cells(scene: Scene, fields: Mapping[str, Sequence[Any]]) -> list[Scene]:
    """Return the scene with the values of each cell."""
    if not fields:
        return [scene]
    cells = zip(*fields.values(), strict=True)
    return [replace(scene, **dict(zip(fields, values, strict=True))) for values in cells]  # type: ignore[type-var]


def scene_levels(scenes: Sequence[Scene]) -> tuple[FloatArray, FloatArray, tuple[int, int]]:
    """Levels and their shares, shapes (cells, levels), and the places of the dark and the bright one."""
    pairs = scenes[0].pairs()
    cells = [scene.levels() for scene in scenes]
    if not pairs or not cells[0]:
        raise InputError(
            "the scene has no two regions of known, different luminance: give a checkerboard, step chart or patches"
        )
    names = [level.name for level in cells[0]]
    if any([level.name for level in levels] != names for levels in cells):
        raise PredictionError("the scenes have different regions: sweep over their luminance only, or simulate")
    luminances = np.array([[level.luminance_cd_m2 for level in levels] for levels in cells])
    shares = np.array([[level.share for level in levels] for levels in cells])
    dark, bright = pairs[0]
    return luminances, shares, (names.index(dark), names.index(bright))


def veil_lx(front: Signal, cells: int) -> FloatArray:
    """Illuminance that the inverse maps to luminance 0, shape (cells,)."""
    scale = float(front.values.max()) or 1.0
    points = np.array([[0.0, scale / 2, scale]])
    luminance = np.broadcast_to(front.to_luminance(np.broadcast_to(points, (cells, 3))), (cells, 3))
    slope = (luminance[:, 2] - luminance[:, 0]) / scale
    middle = (luminance[:, 2] + luminance[:, 0]) / 2
    if not np.allclose(luminance[:, 1], middle, rtol=1e-9, atol=1e-9 * np.abs(luminance).max()):
        raise PredictionError("a stage before the sensor is not linear in luminance: simulate instead")
    # What is subtracted cannot be negative; where nothing is, rounding could make it so.
    veil: FloatArray = np.maximum(-luminance[:, 0] / slope, 0.0)
    return veil
