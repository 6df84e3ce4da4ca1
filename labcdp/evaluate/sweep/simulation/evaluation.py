"""Evaluation of a run of the imaging chain: signal, contrast and CDP behind each stage."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import repeat
from math import inf, isfinite, nan, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .... import metrics
from ....chain import ChainRun, Checkerboard, Signal
from ....chain.point_spread import pixel_means
from ....core.errors import InputError
from ....core.quantity import Quantity
from ....metrics.contrast import TargetContrasts, each_contrast
from ....metrics.pair import bound_of_contrast
from .rows import PairRow, RegionRow, SimulationEvaluation, StageLuminance, StageRow

#: Parts of a region, from its edge to the centre of the lens, in each of which the values follow the vignetting along
#: a line; across all of them a tone curve bends it.
_PARTS = 16

#: Relative step of a luminance that is rounded; well above the steps of float32.
_ROUNDING = 1e-5


def relative_illuminance(signal: Signal) -> NDArray[np.float64] | None:
    """Illuminance over that on the axis, shape of the signal, by its inverse; None for a signal without vignetting.

    Any inverse through a lens is L = c(value) / V - glare, so V is in proportion to 1 / (L(one value) - L(another)).
    """
    values = signal.values
    low, high = (np.full(values.shape, value, values.dtype) for value in (0, max(values.max(), 1)))
    slope = signal.to_luminance(high).astype(np.float64) - signal.to_luminance(low)
    nearest = float(slope.min())
    if nearest <= 0 or float(slope.max()) <= nearest * (1 + 1e-6):
        return None
    relative: NDArray[np.float64] = nearest / slope
    return relative


def axial_where_saturated(
    luminance: NDArray[Any], signal: Signal, relative: NDArray[np.float64] | None
) -> NDArray[Any]:
    """Luminance with saturated pixels set to the luminance that their value has on the axis.

    A saturated pixel shows a lowest luminance. Divided by the vignetting, equal values would differ, and with them
    regions in which nothing can be told apart.
    """
    if relative is None or signal.saturated is None or not signal.saturated.any():
        return luminance
    # L = c / V - glare at the same value on the axis (V = 1) and at the edge gives c and the glare.
    sample = signal.to_luminance(np.full(signal.values.shape, signal.values.max(), signal.values.dtype))
    edge, axis = int(relative.argmin()), int(relative.argmax())
    at_edge, at_axis = float(sample.flat[edge]), float(sample.flat[axis])
    subtracted = (at_edge - at_axis) / (1 / float(relative.flat[edge]) - 1) - at_axis
    axial = (luminance + subtracted) * relative - subtracted
    # Equal values are equal again; without this rounding would be their noise.
    step = _ROUNDING * abs(at_axis)
    return np.where(signal.saturated, np.rint(axial / step) * step, luminance).astype(luminance.dtype)


def without_fall_off(values: NDArray[Any], relative: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values of a region, shape (n,), without the part that follows the relative illuminance, shape (n,); same mean."""
    order = np.argsort(relative, kind="stable")
    x, y = relative[order], values[order].astype(np.float64)
    starts = np.unique(np.linspace(0, x.size, min(_PARTS, max(1, x.size // 8)), endpoint=False).astype(np.intp))
    counts = np.diff(np.append(starts, x.size))

    def centred(part: NDArray[np.float64]) -> NDArray[np.float64]:
        return part - np.repeat(np.add.reduceat(part, starts) / counts, counts)

    mean = float(y.mean())
    x, y = centred(x), centred(y)
    squares = np.add.reduceat(x * x, starts)
    slopes = np.divide(np.add.reduceat(x * y, starts), squares, out=np.zeros(counts.size), where=squares > 0)
    left = y - np.repeat(slopes, counts) * x
    if np.abs(left).max() <= _ROUNDING * abs(mean):
        return np.full(x.shape, mean)
    # Each line takes two degrees of freedom off the noise.
    noise: NDArray[np.float64] = mean + left * np.sqrt(x.size / max(x.size - 2 * counts.size, 1))
    return noise


def pixels_behind(signal: Signal) -> tuple[NDArray[Any], NDArray[Any], NDArray[np.float64] | None]:
    """Return values, luminance and relative illuminance of the pixels behind a stage."""
    relative = relative_illuminance(signal) if signal.oversampling == 1 else None
    luminance = axial_where_saturated(signal.luminance_cd_m2, signal, relative)
    return pixel_means(signal.values, signal.oversampling), pixel_means(luminance, signal.oversampling), relative


def distributions(luminance: NDArray[Any], masks: Mapping[str, NDArray[np.bool_]]) -> dict[str, metrics.Distribution]:
    """Return the distribution of the luminance in each region that has pixels."""
    pixels_by_region = ((region, luminance[mask]) for region, mask in masks.items())
    return {region: metrics.Distribution.from_array(pixels) for region, pixels in pixels_by_region if pixels.size}


def evaluate_run(run: ChainRun, contrast: TargetContrasts = None, epsilon: float = 0.5) -> SimulationEvaluation:
    """Evaluate every stage of a run.

    Parameters
    ----------
    run : ChainRun
        A chain's run.
    contrast : float, tuple of float or None
        Weber contrasts to be detected, fractions above 0; None for that of each pair in the scene.
    epsilon : float
        Relative tolerance of the contrast, above 0 and up to 1.

    Returns
    -------
    SimulationEvaluation

    Raises
    ------
    InputError
        If contrast or epsilon are out of their range.
    """
    return SimulationEvaluation(
        run, contrast, epsilon, tuple(evaluate_stage(run, stage, contrast, epsilon) for stage in run)
    )


def evaluate_stage(run: ChainRun, name: str, contrast: TargetContrasts = None, epsilon: float = 0.5) -> StageRow:
    """Evaluate one stage of a run; the other parameters and errors as for `evaluate_run`."""
    signal, scene = run[name], run.chain.scene
    masks = {region: mask for region, mask in scene.regions().items() if mask.any()}
    true_means = _true_means(run, masks)
    values, luminance, relative = pixels_behind(signal)
    seen = distributions(luminance, masks)
    one_pixel = isinstance(scene, Checkerboard) and scene.square_px == 1
    pixels = luminance if one_pixel else None
    # Free a large frame before its distributions are used.
    del luminance
    question = contrast, epsilon
    pairs = [row for pair in scene.pairs() for row in _pairs(name, pair, true_means, question, seen, pixels)]
    regions = []
    for region, mask in masks.items():
        own_values = values[mask] if relative is None else without_fall_off(values[mask], relative[mask])
        native = metrics.Distribution.from_array(own_values)
        ratios = metrics.snr(native), metrics.snr_10log10_db(native), metrics.snr_20log10_db(native)
        what = name, signal.quantity, signal.unit, region, true_means[region], native.mean, _deviation(native)
        regions.append(RegionRow(*(*_seen_region(signal, seen[region], mask), *what, *ratios)))
    full = {region.region: bool(region.bound) for region in regions}
    bounded = (replace(pair, bound=bound_of_contrast(full[pair.bright], full[pair.dark])) for pair in pairs)
    return StageRow(name, tuple(regions), tuple(bounded))


def evaluate_pair(
    run: ChainRun, name: str, contrast: TargetContrasts = None, epsilon: float = 0.5
) -> tuple[tuple[PairRow, ...], StageLuminance, StageLuminance]:
    """Evaluate the first pair of regions behind one stage of a run: at each contrast, its dark and its bright region.

    Parameters as for `evaluate_stage`; nearest neighbours are left out.

    Raises
    ------
    InputError
        If the scene has no pair; and as `evaluate_run`.
    """
    signal, scene = run[name], run.chain.scene
    pair = next(iter(scene.pairs()), None)
    if pair is None:
        raise InputError("the scene has no two regions of different luminance: give a checkerboard or a step chart")
    masks = {region: mask for region, mask in scene.regions().items() if region in pair}
    seen = distributions(pixels_behind(signal)[1], masks)
    rows = _pairs(name, pair, _true_means(run, masks), (contrast, epsilon), seen)
    dark, bright = (StageLuminance(*_seen_region(signal, seen[region], masks[region])) for region in pair)
    return tuple(rows), dark, bright


def _seen_region(
    signal: Signal, light: metrics.Distribution, mask: NDArray[np.bool_]
) -> tuple[float, float, Quantity, float]:
    """Return mean, standard deviation, SNR and saturated share of a region."""
    saturated = 0.0 if signal.saturated is None else float(signal.saturated[mask].mean())
    return light.mean, _deviation(light), metrics.snr(light), saturated


def _true_means(run: ChainRun, masks: Mapping[str, NDArray[np.bool_]]) -> dict[str, float]:
    """Mean luminance of the scene in each region; for uniform regions the value of the scene's parameters."""
    given = {level.name: level.luminance_cd_m2 for level in run.chain.scene.levels()}
    scene = pixel_means(run["scene"].values, run["scene"].oversampling)
    return {
        region: given[region] if region in given else float(scene[mask].mean(dtype=np.float64))
        for region, mask in masks.items()
    }


def _pairs(
    stage: str,
    pair: tuple[str, str],
    true_means: Mapping[str, float],
    task: tuple[TargetContrasts, float],
    seen: Mapping[str, metrics.Distribution],
    pixels: NDArray[Any] | None = None,
) -> Iterator[PairRow]:
    """Yield a pair of the dark and the bright region at each contrast to be detected, with its tolerance."""
    (dark, bright), (contrast, epsilon) = pair, task
    # 1.3 / 1 - 1 is not 0.3 in binary.
    true_contrast = round(true_means[bright] / true_means[dark] - 1, 12) if true_means[dark] else inf
    targets = [true_contrast if target is None else target for target in each_contrast(contrast)]
    names, regions = (stage, dark, bright), (seen[bright], seen[dark])
    if max(region.values[-1] for region in regions) <= 0 or not all(map(isfinite, targets)):
        nothing = Quantity(nan, nan)
        row = PairRow(*names, true_contrast, nan, nan, None, None, nothing, nothing, metrics.d_prime(*regions))
        yield from repeat(row, len(targets))
        return
    means = metrics.weber_contrast_of_means(*regions), _mean_contrast(*regions)
    ratios = metrics.csnr(*regions), metrics.cnr(*regions), metrics.d_prime(*regions)
    neighbours = repeat(None, len(targets)) if pixels is None else metrics.cdp_neighbours(pixels, targets, epsilon)
    for cdp, cdp_of_pixels in zip(metrics.cdp(*regions, targets, epsilon), neighbours, strict=True):
        yield PairRow(*names, true_contrast, *means, cdp, cdp_of_pixels, *ratios)


def _mean_contrast(bright: metrics.Distribution, dark: metrics.Distribution) -> float:
    """Mean of bright / dark - 1: each bright pixel meets each dark one, so it is a product of means."""
    lit = dark.values > 0
    if not lit.any():
        return nan
    return bright.mean * float(np.average(1 / dark.values[lit], weights=dark.weights[lit])) - 1


def _deviation(region: metrics.Distribution) -> float:
    mean_square = float(np.average((region.values - region.mean) ** 2, weights=region.weights))
    return sqrt(mean_square)
