"""Pixels that see more than one luminance of a scene: a point spread, or a scene sampled finer than the pixels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import PredictionError
from ..chain import Chain
from ..optics import Optics
from ..scene.scene import Scene
from ..scene.spectra import level_samples

FloatArray = NDArray[np.float64]

#: Classes of luminance, of equal width, in which the pixels of a region are counted.
_CLASSES = 64
#: Fields of scenes that say how bright they are; all others are geometry.
_BRIGHTNESS = ("luminance_cd_m2", "luminances_cd_m2", "background_cd_m2", "contrast")


def is_mixed(chain: Chain) -> bool:
    """Whether pixels see more than one level."""
    return getattr(chain.scene, "oversampling", 1) > 1 or any(
        isinstance(stage, Optics) and stage.spreads_points for _, stage in chain.before
    )


def mixed_pair(
    chain: Chain, scenes: Sequence[Scene], levels_lx: FloatArray, pixel_pitch_m: float
) -> list[tuple[FloatArray, FloatArray]]:
    """Illuminance of the pixels of the first pair's dark and bright region.

    Parameters
    ----------
    chain : Chain
        With optics.
    scenes : sequence of Scene
        One for each of n cells, with the same regions.
    levels_lx : ndarray, shape (n, levels)
        Illuminance of each level where it is alone.
    pixel_pitch_m : float
        Of the sensor.

    Returns
    -------
    list of (ndarray, ndarray)
        For each region the illuminances in lux, shape (n, classes), and the share of its pixels that have them. A scene
        that is seen through a linear stage is the sum of its levels, each weighted with the part of a pixel's light
        that comes from it.

    Raises
    ------
    PredictionError
        If the optics are of another kind.
    """
    optics = next((stage for _, stage in chain.before if isinstance(stage, Optics)), None)
    if optics is None:
        raise PredictionError(
            "the scene is sampled finer than the pixels, which needs the standard optics: simulate instead"
        )
    keys = [_geometry(scene) for scene in scenes]
    # Of scenes that differ in brightness only, the first one says it for all.
    firsts = dict(zip(reversed(keys), reversed(scenes), strict=True))
    parts_by_key = {key: _parts(scene, optics, pixel_pitch_m) for key, scene in firsts.items()}
    result = []
    for region in (0, 1):
        most = max(parts[region][1].size for parts in parts_by_key.values())
        lux, shares = np.empty((len(scenes), most)), np.zeros((len(scenes), most))
        for key, parts in parts_by_key.items():
            cells = np.array([cell_key == key for cell_key in keys])
            mixtures, counted = parts[region]
            seen = levels_lx[cells] @ mixtures.T
            # What is missing has an illuminance that occurs, and no share.
            lux[cells] = np.pad(seen, ((0, 0), (0, most - counted.size)), mode="edge")
            shares[cells, : counted.size] = counted
        result.append((lux, shares))
    return result


def _geometry(scene: Scene) -> Any:
    """Return the parameters that determine the share of each level in each pixel."""
    return tuple((name, repr(value)) for name, value in vars(scene).items() if name not in _BRIGHTNESS)


def _parts(scene: Scene, optics: Optics, pixel_pitch_m: float) -> list[tuple[FloatArray, FloatArray]]:
    """Mixtures of the levels, shape (classes, levels), and their shares, for the dark and the bright region."""
    oversampling = getattr(scene, "oversampling", 1)
    regions = scene.regions()
    levels = scene.levels()
    samples = level_samples(scene)
    seen: FloatArray = np.stack(
        [optics.spread(samples[level.name].astype(float), pixel_pitch_m, oversampling) for level in levels]
    )
    luminance = np.tensordot(np.array([level.luminance_cd_m2 for level in levels]), seen, 1).astype(np.float64)
    return [_classes(seen[:, regions[name]].T, luminance[regions[name]]) for name in scene.pairs()[0]]


def _classes(mixtures: FloatArray, luminance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean mixtures of classes of pixels of like luminance, and the share of the pixels in each."""
    edges = np.linspace(luminance.min(), luminance.max(), _CLASSES + 1)[1:-1]
    alike = np.ptp(luminance) < 1e-9 * luminance.max()
    number = np.zeros(luminance.size, np.intp) if alike else np.searchsorted(edges, luminance)
    count = np.bincount(number, minlength=_CLASSES)
    sums = np.stack([np.bincount(number, column, minlength=_CLASSES) for column in mixtures.T], axis=1)
    return sums[count > 0] / count[count > 0, None], count[count > 0] / luminance.size
