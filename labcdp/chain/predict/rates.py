"""Scenes of a chain as rates of photo-electrons in the pixels of their first pair of regions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError, PredictionError
from ..chain import Chain
from ..colour import SeenPlane, seen_planes, seen_sensor
from ..scene.scene import Scene
from ..scene.spectra import spectra_of
from ..sensor import Sensor
from ..signal import Signal
from .camera import CameraModel
from .mixed_pixels import is_mixed, mixed_pair
from .prediction import PatchRates

FloatArray = NDArray[np.float64]
#: Levels and their shares, shapes (cells, levels), and the indices of two of them.
SeenLevels: TypeAlias = tuple[FloatArray, FloatArray, tuple[int, int]]


def pair_rates(
    chain: Chain,
    sensor: Sensor,
    camera: CameraModel,
    cells: Sequence[Scene],
    seen: SeenLevels,
) -> PatchRates:
    """Return the rates of the pixels of two regions of each scene, which `scene_levels` has found."""
    levels, shares, pair = seen
    front = chain.front(levels, shares)
    # Of a single capture, its own.
    per_lx_s = camera.sensor.electrons_per_lx_s(chain.spectrum)
    veil_e_s = veil_lx(front, len(levels)) * per_lx_s
    if sensor.colour_filter or spectra_of(chain.scene):
        return _coloured_rates(chain, sensor, cells, per_lx_s, veil_e_s, seen)
    if is_mixed(chain):
        (dark, dark_shares), (bright, bright_shares) = mixed_pair(chain, cells, front.values, sensor.pixel_pitch_m)
        return PatchRates(per_lx_s * dark, per_lx_s * bright, veil_e_s, dark_shares, bright_shares)
    dark, bright = (front.values[:, index] * per_lx_s for index in pair)
    return PatchRates(dark, bright, veil_e_s)


def scene_contrast(dark: FloatArray, bright: FloatArray) -> FloatArray:
    """Return the Weber contrast of each cell's scene."""
    if not (dark > 0).all():
        raise InputError("the dark region has a luminance of 0 and its contrast is infinite: give a target contrast")
    # 1.3 / 1 - 1 is not 0.3 in binary.
    return np.asarray(np.round(bright / dark - 1, 12))


def _coloured_rates(
    chain: Chain,
    sensor: Sensor,
    cells: Sequence[Scene],
    per_lx_s: float,
    veil_e_s: FloatArray,
    seen_levels: SeenLevels,
) -> PatchRates:
    """Rates of the pixels of each plane that is looked at, with their shares, for regions of several spectra."""
    patches: list[list[tuple[FloatArray, FloatArray]]] = [[], []]
    for plane, seen in plane_rates(chain, sensor, cells, per_lx_s, seen_levels):
        for patch, (rates, parts) in zip(patches, seen, strict=True):
            patch.append((rates, plane.share * parts))
    (dark, dark_shares), (bright, bright_shares) = (
        tuple(np.concatenate(arrays, axis=1) for arrays in zip(*patch, strict=True)) for patch in patches
    )
    return PatchRates(dark, bright, veil_e_s, dark_shares, bright_shares)


def plane_rates(
    chain: Chain,
    sensor: Sensor,
    cells: Sequence[Scene],
    per_lx_s: float,
    seen_levels: SeenLevels,
) -> Iterator[tuple[SeenPlane, Sequence[tuple[FloatArray, FloatArray]]]]:
    """Yield each plane that is looked at with the rates of both regions' pixels, veil included, and their shares."""
    levels, shares, pair = seen_levels
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


def scenes_of_cells(scene: Scene, fields: Mapping[str, Sequence[Any]]) -> list[Scene]:
    """Return the scene with the values of each cell."""
    if not fields:
        return [scene]
    cells = zip(*fields.values(), strict=True)
    return [replace(scene, **dict(zip(fields, values, strict=True))) for values in cells]  # type: ignore[type-var]


def scene_levels(scenes: Sequence[Scene], regions: tuple[str, str] | None = None) -> SeenLevels:
    """Levels and their shares, shapes (cells, levels), and the indices of two regions, None for those of a pair."""
    pairs = scenes[0].pairs() if regions is None else (regions,)
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
