"""Values that a merge of captures of several gains and photodiodes can have, and the bins they are tabulated in."""

from __future__ import annotations

from math import ceil
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..hdr import ZERO_DN, normal_stage
from .camera import CameraModel
from .value_bins import ValueBins

FloatArray = NDArray[np.float64]

#: Low and high end of a range of values in which captures are blended, and the capture whose noise they have.
Zone: TypeAlias = tuple[float, float, int]

#: Bins in a standard deviation where values of captures are blended, and single values in it that make them needless:
#: what lies between these counts as the nearest, which adds 1 / (12 * 20^2) = 2e-4 of the variance.
_BINS, _CLOSE = 40, 20
#: Standard deviations of the less sensitive capture around an overlap in which blended values lie.
_REACH = 10.0
#: Half the width of the bin of a single value, and distance up to which two are one, relative to the value.
_WIDTH, _SAME = 1e-9, 1e-8


def capture_values(camera: CameraModel, number: int) -> FloatArray:
    """Return the merged value of each DN of a capture where it alone counts, shape (2^bits,).

    Parameters
    ----------
    camera : CameraModel
        With a merge.
    number : int
        The capture, the most sensitive being 0.
    """
    ladder = camera.ladder
    net = np.arange(2.0 ** camera.captures[number].sensor.bits) - ladder.zeros_dn[number]
    assert camera.hdr is not None
    if camera.hdr.method == "normal":
        value, _ = normal_stage(net, number, camera.hdr.bits, ladder)
        return value.astype(np.float64)
    scaled = net * ladder.ratios[number]
    return np.where(np.abs(scaled) < ZERO_DN, 0.0, scaled)


def capture_bins(camera: CameraModel, blended: FloatArray, is_steady: bool = True) -> ValueBins:
    """Bins of the merged value: one for each single value, and even ones where these are too far apart.

    Parameters
    ----------
    camera : CameraModel
        With a merge.
    blended : ndarray
        Values of blended captures that are so few that each occurs in many pixels, in any order.
    is_steady : bool
        Whether all captures see the same light; else blended values lie anywhere between those of two captures.
    """
    assert camera.hdr is not None
    if camera.hdr.method in ("linear", "weighted"):
        return _with_gaps_filled(camera, _distinct(blended), _ranges(camera))
    values = [capture_values(camera, number) for number in range(len(camera.ladder))]
    blends = camera.hdr.method == "most-sensitive"
    zones = [] if not blends else _overlaps(camera) if is_steady else _ranges(camera)
    return _with_gaps_filled(camera, _distinct(np.concatenate([*values, blended])), zones)


def _ranges(camera: CameraModel) -> list[Zone]:
    """Return the range of values in which each capture is the most sensitive that counts."""
    ladder, start, zones = camera.ladder, -_REACH * float(_spread(camera, len(camera.ladder) - 1, 0.0)), []
    for number, (end, ratio) in enumerate(zip(ladder.saturations_dn, ladder.ratios, strict=True)):
        is_last = number == len(ladder) - 1
        stop = end * ratio * 1.01 if is_last else end * ratio + _REACH / 2 * float(_spread(camera, number, end * ratio))
        zones.append((start, stop, number))
        start = stop
    return zones


def _overlaps(camera: CameraModel) -> list[Zone]:
    """Return where values of two captures are blended: near those of the one, and as far as the other's noise goes."""
    assert camera.hdr is not None
    ladder, zones = camera.ladder, []
    for number in range(len(ladder) - 1):
        end = ladder.saturations_dn[number] * ladder.ratios[number]
        begin = end * (1 - camera.hdr.overlap)
        for noise_of in (number, number + 1):
            low, high = (_REACH * float(_spread(camera, noise_of, dn)) for dn in (begin, end))
            zones.append((begin - low, end + high, noise_of))
    return zones


def _distinct(values: FloatArray) -> FloatArray:
    """Return values in rising order, those that differ by rounding only once."""
    if values.size == 0:
        return values
    ordered = np.sort(values)
    is_new = np.diff(ordered) > _SAME * np.maximum(np.abs(ordered[1:]), 1.0)
    return np.asarray(ordered[np.concatenate([[True], is_new])])


def _with_gaps_filled(camera: CameraModel, alone: FloatArray, zones: list[Zone]) -> ValueBins:
    """Return bins for single values, and for what lies in zones between those that are far apart there."""
    padded = np.concatenate([[-np.inf], alone, [np.inf]])
    limit = np.zeros(alone.size + 1)
    filled = [np.empty(0)]
    for low, high, number in zones:
        if alone.size:
            # Gaps that reach into the zone, by the noise at their upper end.
            inside = (padded[1:] > low) & (padded[:-1] < high)
            spread = _spread(camera, number, np.clip(padded[1:], low, high))
            limit = np.where(inside, np.where(limit > 0, np.minimum(limit, spread), spread), limit)
        filled.append(_filled(camera, number, low, high))
    is_wide = (limit > 0) & (np.diff(padded) > limit / _CLOSE) if alone.size else np.ones(1, dtype=np.bool_)
    inner = np.concatenate(filled)
    inner = inner[is_wide[np.searchsorted(padded, inner) - 1]]
    inner = inner[_distance(inner, alone) > _SAME * np.maximum(np.abs(inner), 1)]
    width = _WIDTH * np.maximum(np.abs(alone), 1.0)
    narrow = np.concatenate([(alone - width)[is_wide[:-1]], (alone + width)[is_wide[1:]]])
    middles = ((alone[1:] + alone[:-1]) / 2)[~is_wide[1:-1]]
    every = np.concatenate([middles, narrow, inner, alone])
    edges = np.unique(np.concatenate([[every.min() - 1], middles, narrow, inner, [every.max() + 1]]))
    values, exact = (edges[1:] + edges[:-1]) / 2, np.zeros(edges.size - 1, dtype=np.bool_)
    index = np.searchsorted(edges, alone, side="right") - 1
    values[index], exact[index] = alone, True
    return ValueBins(edges, values, exact)


def _distance(values: FloatArray, others: FloatArray) -> FloatArray:
    """Distance of values to the nearest of others, which rise."""
    padded = np.concatenate([[-np.inf], others, [np.inf]])
    index = np.searchsorted(padded, values)
    return np.asarray(np.minimum(values - padded[index - 1], padded[index] - values))


def _filled(camera: CameraModel, number: int, low: float, high: float) -> FloatArray:
    """Edges between two values, even in standard deviations of the scaled value of a capture."""
    # Dense near 0, where the deviation changes most.
    dn = np.unique(np.concatenate([np.linspace(low, high, 501), np.linspace(0, 1, 2001) ** 2 * max(high, 0.0)]))
    dn = dn[(dn >= low) & (dn <= high)]
    spread = _spread(camera, number, dn)
    position = np.concatenate([[0], np.cumsum(np.diff(dn) * 2 / (spread[1:] + spread[:-1]))])
    return np.asarray(np.interp(np.linspace(0, position[-1], ceil(position[-1] * _BINS) + 1), position, dn))


def _spread(camera: CameraModel, number: int, dn: FloatArray | float) -> FloatArray:
    """Return the standard deviation of the scaled value of one capture over its mean."""
    capture, ratio = camera.captures[number], camera.ladder.ratios[number]
    noise_dn = capture.k_dn_per_e * CameraModel(capture.sensor, capture.settings).all_noise_e
    signal_dn = np.maximum(dn, 0.0) / ratio
    variance = noise_dn**2 + 1 / 12 + capture.k_dn_per_e * (signal_dn + capture.k_dn_per_e * capture.dark_e)
    return np.asarray(ratio * np.sqrt(variance + (capture.sensor.prnu_rel * signal_dn) ** 2))
