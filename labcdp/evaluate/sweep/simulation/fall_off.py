"""Vignetting of a simulated lens: it is known, so it is neither noise, nor luminance of a saturated pixel."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....chain import Signal

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
    """Luminance in which each saturated pixel has what its value stands for on the axis, as all others there have.

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
    """Values of a region, shape (n,), about their mean without what follows the relative illuminance, shape (n,)."""
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
