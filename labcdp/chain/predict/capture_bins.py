"""Values that a merge of captures of several gains and photodiodes can have, and the bins they are tabulated in."""

from __future__ import annotations

from math import ceil

import numpy as np
from numpy.typing import NDArray

from ..hdr import ZERO_DN, normal_stage
from .camera import CameraModel
from .value_bins import ValueBins

FloatArray = NDArray[np.float64]

#: Bins in a standard deviation where values of captures are blended.
_BINS = 40
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


def capture_bins(camera: CameraModel, blended: FloatArray) -> ValueBins:
    """Bins of the merged value: one for each single value, and even ones where captures are blended.

    Parameters
    ----------
    camera : CameraModel
        With a merge.
    blended : ndarray
        Values of blended captures that are so few that each occurs in many pixels, in any order.
    """
    assert camera.hdr is not None
    method, ladder = camera.hdr.method, camera.ladder
    if method in ("linear", "weighted"):
        low = -_REACH * float(_spread(camera, len(ladder) - 1, np.zeros(1))[0])
        return _with_gaps_filled(camera, _distinct(blended), [(low, ladder.merged_saturation_dn * 1.01, 0)])
    values = [capture_values(camera, number) for number in range(len(ladder))]
    zones = []
    for number in range(len(ladder) - 1 if method == "most-sensitive" else 0):
        end = ladder.saturations_dn[number] * ladder.ratios[number]
        begin = end * (1 - camera.hdr.overlap)
        low, high = _REACH * _spread(camera, number + 1, np.array([begin, end]))
        zones.append((begin - low, end + high, number))
    return _with_gaps_filled(camera, _distinct(np.concatenate([*values, blended])), zones)


def _distinct(values: FloatArray) -> FloatArray:
    """Return values in rising order, those that differ by rounding only once."""
    if values.size == 0:
        return values
    ordered = np.sort(values)
    is_new = np.diff(ordered) > _SAME * np.maximum(np.abs(ordered[1:]), 1.0)
    return np.asarray(ordered[np.concatenate([[True], is_new])])


def _with_gaps_filled(camera: CameraModel, alone: FloatArray, zones: list[tuple[float, float, int]]) -> ValueBins:
    """Return bins for single values, which are narrow in zones where other bins fill the gaps between them."""
    inside = np.zeros(alone.size, dtype=np.bool_)
    for low, high, _ in zones:
        inside |= (alone >= low) & (alone <= high)
    width = _WIDTH * np.maximum(np.abs(alone), 1.0)
    middles = ((alone[1:] + alone[:-1]) / 2)[~(inside[1:] & inside[:-1])]
    narrow = np.concatenate([alone[inside] - width[inside], alone[inside] + width[inside]])
    filled = np.concatenate([np.empty(0), *(_filled(camera, number, low, high) for low, high, number in zones)])
    edges = np.concatenate([middles, narrow, filled[_distance(filled, alone) > _SAME * np.maximum(np.abs(filled), 1)]])
    every = np.concatenate([edges, alone])
    edges = np.unique(np.concatenate([[every.min() - 1], edges, [every.max() + 1]]))
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
    """Edges between two values, even in standard deviations of the merged value from a capture on."""
    ladder = camera.ladder
    # Dense near 0, where the deviation changes most.
    dn = np.unique(np.concatenate([np.linspace(low, high, 501), np.linspace(0, 1, 4001) ** 2 * max(high, 0.0)]))
    dn = dn[(dn >= low) & (dn <= high)]
    spreads = [_spread(camera, i, dn) for i in range(len(ladder))]
    ends = [end * ratio for end, ratio in zip(ladder.saturations_dn, ladder.ratios, strict=True)]
    spread = spreads[-1]
    for i in reversed(range(number, len(ladder) - 1)):
        spread = np.where(dn < ends[i] + 5 * spreads[i + 1], spreads[i], spread)
    position = np.concatenate([[0], np.cumsum(np.diff(dn) * 2 / (spread[1:] + spread[:-1]))])
    return np.asarray(np.interp(np.linspace(0, position[-1], ceil(position[-1] * _BINS) + 1), position, dn))


def _spread(camera: CameraModel, number: int, dn: FloatArray) -> FloatArray:
    """Return the standard deviation of the scaled value of one capture over its mean."""
    capture, ratio = camera.captures[number], camera.ladder.ratios[number]
    noise_dn = capture.k_dn_per_e * CameraModel(capture.sensor, capture.settings).all_noise_e
    signal_dn = np.maximum(dn, 0.0) / ratio
    variance = noise_dn**2 + 1 / 12 + capture.k_dn_per_e * (signal_dn + capture.k_dn_per_e * capture.dark_e)
    return np.asarray(ratio * np.sqrt(variance + (capture.sensor.prnu_rel * signal_dn) ** 2))
