"""A view under a template in the light of the first frame, found by robust least squares."""

from __future__ import annotations

from math import hypot, isnan, nan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.computer import compiled_part

#: Pixels without which nothing is said.
_PIXELS_LEAST = 6
#: Change of the light after which no other one is looked for: of the gain, and of the middle in parts of the structure.
_SETTLED = 1e-4
#: Pixels from which on only every fourth one goes into a median.
_MANY = 800

_Pixels = NDArray[np.float32]
_Matrix = NDArray[np.float64]


class LevelArrays(NamedTuple):
    """A template in one size.

    Parameters
    ----------
    values, trust : ndarray of float32, shape (n,)
        Its pixels row by row, and how far each counts.
    width : int
        Pixels of a row.
    jacobian : ndarray of float32, shape (m + 2, n)
        Change of each pixel along each way to move; deviations from the middle; ones.
    middle, structure, noise : float
        Mean and standard deviation of the pixels, and standard deviation of their noise.
    generators : ndarray of float, shape (m, 9)
        Matrices of the ways to move, in centred coordinates.
    damping : ndarray of float, shape (m + 2,)
        How far each is held back where the image says little.
    to_template, centred, from_centred : ndarray of float, shape (3, 3)
        Pixels of this size to those of the template; these to centred coordinates, and back.
    still : float
        Step after which no other one is made.
    robust, allowed, changed, gain_least, gain_most : float
        See `labcdp.tracking.settings.TrackingSettings`.
    """

    values: _Pixels
    trust: _Pixels
    width: int
    jacobian: _Pixels
    middle: float
    structure: float
    noise: float
    generators: _Matrix
    damping: _Matrix
    to_template: _Matrix
    centred: _Matrix
    from_centred: _Matrix
    still: float
    robust: float
    allowed: float
    changed: float
    gain_least: float
    gain_most: float


@compiled_part
def _middle_of(values: _Pixels) -> float:
    """Value that half of them are below; changes their order."""
    first, last, wanted = 0, values.size - 1, values.size // 2
    while first < last:
        pivot = values[(first + last) // 2]
        low, high = first, last
        while low <= high:
            while values[low] < pivot:
                low += 1
            while pivot < values[high]:
                high -= 1
            if low <= high:
                values[low], values[high] = values[high], values[low]
                low += 1
                high -= 1
        if wanted <= high:
            last = high
        elif wanted >= low:
            first = low
        else:
            break
    return float(values[wanted])


@compiled_part
def _least_spread(level: LevelArrays, gain: float) -> float:
    """Spread of the residuals that noise, interpolation and blur leave in a light."""
    return max(level.noise * hypot(1.0, 1 / gain), level.allowed * level.structure)


@compiled_part
def compare(
    level: LevelArrays, values: _Pixels, gain: float, offset: float, residuals: _Pixels, robust: _Pixels
) -> float:
    """Compare a view with the template in a light; standard deviation of most residuals."""
    one, factor, shift = np.float32(1), np.float32(1 / gain), np.float32(offset / gain)
    for at in range(values.size):
        residuals[at] = values[at] * factor - level.values[at] - shift
    every = 4 if residuals.size > _MANY else 1
    n_some = (residuals.size + every - 1) // every
    # The place of the weights serves for the sizes of some residuals before.
    for at in range(n_some):
        robust[at] = abs(residuals[every * at])
    spread = max(1.4826 * _middle_of(robust[:n_some]), _least_spread(level, gain))
    scale = np.float32(1 / (level.robust * spread))
    for at in range(values.size):
        off = residuals[at] * scale
        off = one + off * off
        robust[at] = one / (off * off)
    return spread


@compiled_part
def find_light(
    level: LevelArrays, values: _Pixels, trusted: _Pixels, robust: _Pixels, expected: float
) -> tuple[float, float]:
    """Light by weighted least squares; gain nan if that is not possible.

    An expected gain counts as much as the whole template: a patch and changing surroundings contain little
    information on it.
    """
    deviations = level.jacobian[-2]
    total, of_template, square, of_view, of_both = 0.0, 0.0, 0.0, 0.0, 0.0
    for at in range(values.size):
        weight, deviation, value = trusted[at] * robust[at], deviations[at], values[at]
        total += weight
        of_template += weight * deviation
        square += weight * deviation * deviation
        of_view += weight * value
        of_both += weight * value * deviation
    if not total >= _PIXELS_LEAST:
        return nan, 0.0
    mean_t, mean_v = of_template / total, of_view / total
    power = square - mean_t * of_template
    gain = (of_both - mean_t * of_view) / power if power > 0 else 0.0
    if not isnan(expected):
        whole = level.structure**2 * values.size
        gain = (power * gain + whole * expected) / (power + whole)
    if not level.gain_least < gain < level.gain_most:
        return nan, 0.0
    return gain, mean_v - gain * (level.middle + mean_t)


@compiled_part
def _in_light(
    level: LevelArrays, values: _Pixels, trusted: _Pixels, gain: float, offset: float
) -> tuple[float, float, float, _Pixels, _Pixels]:
    """Compare a view in the light that is found in three steps: from a guess, or from all pixels if its gain is nan."""
    residuals, robust = np.empty(values.size, np.float32), np.ones(values.size, np.float32)
    expected, spread = gain, 0.0
    if not isnan(gain):
        spread = compare(level, values, gain, offset, residuals, robust)
    for _ in range(3):
        gain_before, offset_before = gain, offset
        gain, offset = find_light(level, values, trusted, robust, expected)
        if isnan(gain):
            break
        spread = compare(level, values, gain, offset, residuals, robust)
        changed = gain - gain_before
        middle = (changed * level.middle + offset - offset_before) / max(level.structure, 1e-9)
        if max(abs(changed), abs(middle)) < _SETTLED * gain and not isnan(gain_before):
            break
    return gain, offset, spread, residuals, robust


@compiled_part
def look(
    level: LevelArrays, values: _Pixels, trusted: _Pixels, gain: float, offset: float
) -> tuple[float, float, float, _Pixels, _Pixels]:
    """Compare a view with the template, starting from a guess of the light; gain nan for none, or if that fails.

    A large bright thing in front of the target spoils a start from all pixels, but not one from a known light.
    """
    guessed = _in_light(level, values, trusted, gain, offset)
    # None fits better than one that leaves only noise.
    if isnan(gain) or (not isnan(guessed[0]) and level.changed * guessed[2] <= _least_spread(level, guessed[0])):
        return guessed
    seen = _in_light(level, values, trusted, nan, 0.0)
    # A guess is kept unless the light has clearly changed.
    if not isnan(seen[0]) and (isnan(guessed[0]) or seen[2] < level.changed * guessed[2]):
        return seen
    return guessed
