"""Comparison of a template with a view, and steps that align both, pixel by pixel."""

from __future__ import annotations

from math import hypot, isnan, nan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.computer import compiled
from .step_kernel import gauss_newton_step, inverse, product

#: Residuals from which on pixels count little, in standard deviations of the residuals.
_ROBUST = 2.5
#: Residual that is always allowed, in parts of the template's structure: interpolation, blur.
_ALLOWED = 0.06
#: Pixels without which nothing is said.
_PIXELS_LEAST = 6
#: Factor by which residuals must be smaller for a light that was not expected.
_CHANGED = 0.75
#: Least and most change of the light between the first frame and this one.
_GAIN_LEAST, _GAIN_MOST = 0.05, 12.0
#: Change of the light after which no other one is looked for: of the gain, and of the middle in parts of the structure.
_SETTLED = 1e-4
#: Pixels from which on only every fourth one goes into a median.
_MANY = 800

_Pixels = NDArray[np.float32]
_Matrix = NDArray[np.float64]


class Pattern(NamedTuple):
    """A template in one size.

    Parameters
    ----------
    jacobian : ndarray of float32, shape (m + 2, n)
        Change of each pixel along each way to move, deviations of the pixels from their mean, and ones.
    trust : ndarray of float32, shape (n,)
        How far each pixel counts.
    ways : ndarray of float, shape (m, 3, 3)
        Generators of the ways to move.
    damping : ndarray of float, shape (m + 2,)
        How far each is held back.
    frames : ndarray of float, shape (3, 3, 3)
        Its pixels to template pixels, these to coordinates of about -1 to 1, and back.
    numbers : ndarray of float, shape (5,)
        Its columns; the step after which no other one is made; mean and standard deviation of the pixels, and that of
        their noise.
    """

    jacobian: _Pixels
    trust: _Pixels
    ways: _Matrix
    damping: NDArray[np.float64]
    frames: _Matrix
    numbers: NDArray[np.float64]


@compiled
def improved(
    view: _Pixels, bounds: NDArray[np.float64], start: _Matrix, pattern: Pattern, steps: int, gain: float, offset: float
) -> tuple[_Matrix, float, float]:
    """Make up to `steps` Gauss-Newton steps from a place; light is found along with each.

    `bounds` are left, top, right and bottom end of the image in the view; gain and offset a guess of the light: DN =
    gain * DN of the first frame + offset, nan for none. Returns the new place and the light before the last step; its
    gain is nan if they led nowhere.
    """
    jacobian, trust, ways, damping, frames, numbers = pattern
    expected = gain
    place, seen = start, np.empty((4, trust.size), np.float32)
    gain, offset = looked_at(view, bounds, place, pattern, gain, offset, seen)
    for number in range(steps):
        if number:
            _sample(view, bounds, product(place, frames[0]), int(numbers[0]), trust, seen)
            gain, offset = _light(jacobian[-2], numbers, seen, expected)
            if not isnan(gain):
                _compare(jacobian[-2], numbers, seen, gain, offset)
        if isnan(gain):
            break
        step = gauss_newton_step(jacobian, damping, numbers[4], seen)
        change, largest = np.zeros((3, 3)), 0.0
        for k in range(step.size):
            largest = max(largest, abs(step[k]))
            for i in range(3):
                for j in range(3):
                    change[i, j] += step[k] * ways[k, i, j]
        for i in range(3):
            change[i, i] += 1
        place = product(place, product(product(frames[2], inverse(change)), frames[1]))
        whole = place[2, 2]
        for i in range(3):
            for j in range(3):
                place[i, j] /= whole
        # Also if anything is not finite.
        if not abs(place.sum()) < np.inf:
            return place, nan, 0.0
        if largest < numbers[1]:
            break
    return place, gain, offset


@compiled
def looked_at(
    view: _Pixels,
    bounds: NDArray[np.float64],
    place: _Matrix,
    pattern: Pattern,
    gain: float,
    offset: float,
    seen: _Pixels,
) -> tuple[float, float]:
    """Compare the view at a place with the pattern, starting from a guess of the light, nan for none.

    A large bright thing in front of the target spoils a start from all pixels, but not one from a known light.

    `seen`, of shape (4, n), gets the view there, how far each pixel counts, what is left of the view in the template's
    DN, and how far that fits. Returns gain and offset of the light; a gain of nan if it cannot be compared.
    """
    jacobian, trust, _, _, frames, numbers = pattern
    deviations = jacobian[-2]
    _sample(view, bounds, product(place, frames[0]), int(numbers[0]), trust, seen)
    guessed, its_offset, its_spread = nan, 0.0, 0.0
    for attempt in range(2):
        expected, spread = gain, 0.0
        if isnan(gain):
            for i in range(trust.size):
                seen[3, i] = 1
        else:
            spread = _compare(deviations, numbers, seen, gain, offset)
        # The light is found in three steps: from a guess, or from all pixels without one.
        for _ in range(3):
            before, offset_before = gain, offset
            gain, offset = _light(deviations, numbers, seen, expected)
            if isnan(gain):
                break
            spread = _compare(deviations, numbers, seen, gain, offset)
            middle = abs((gain - before) * numbers[2] + offset - offset_before) / max(numbers[3], 1e-9)
            if abs(gain - before) < _SETTLED * gain and middle < _SETTLED * gain:
                break
        if attempt == 1:
            # A guess is kept unless the light has clearly changed.
            if isnan(guessed) or (not isnan(gain) and spread < _CHANGED * its_spread):
                return gain, offset
            _compare(deviations, numbers, seen, guessed, its_offset)
            return guessed, its_offset
        # None fits better than one that leaves only noise.
        if isnan(expected) or (not isnan(gain) and _CHANGED * spread <= _least_spread(numbers, gain)):
            return gain, offset
        guessed, its_offset, its_spread = gain, offset, spread
        gain, offset = nan, 0.0
    return gain, offset


@compiled
def _sample(
    view: _Pixels, bounds: NDArray[np.float64], place: _Matrix, columns: int, trust: _Pixels, seen: _Pixels
) -> None:
    """Values of a view under the pattern, interpolated, and how far they count: not outside the image."""
    height, width = view.shape
    for at in range(trust.size):
        u, v = at % columns + 0.5, at // columns + 0.5
        w = place[2, 0] * u + place[2, 1] * v + place[2, 2]
        x = (place[0, 0] * u + place[0, 1] * v + place[0, 2]) / w
        y = (place[1, 0] * u + place[1, 1] * v + place[1, 2]) / w
        inside = w > 0 and bounds[0] < x < bounds[2] and bounds[1] < y < bounds[3]
        seen[1, at] = trust[at] if inside else np.float32(0)
        # The middle of the first pixel is at 0.5; beyond the first and the last one nothing changes.
        x, y = max(min(x - 0.5, width - 1.0), 0.0), max(min(y - 0.5, height - 1.0), 0.0)
        x0, y0 = int(x), int(y)
        x1, y1 = min(x0 + 1, width - 1), min(y0 + 1, height - 1)
        across, down = np.float32(x - x0), np.float32(y - y0)
        upper = view[y0, x0] + across * (view[y0, x1] - view[y0, x0])
        lower = view[y1, x0] + across * (view[y1, x1] - view[y1, x0])
        seen[0, at] = upper + down * (lower - upper)


@compiled
def _light(deviations: _Pixels, numbers: NDArray[np.float64], seen: _Pixels, expected: float) -> tuple[float, float]:
    """Light by weighted least squares; a gain of nan if that is not possible.

    An expected gain counts as much as the whole template: a patch and changing surroundings contain little
    information on it.
    """
    total = square = of_template = of_view = of_both = 0.0
    for i in range(deviations.size):
        weight, t, v = seen[1, i] * seen[3, i], deviations[i], seen[0, i]
        total += weight
        of_template += weight * t
        square += weight * t * t
        of_view += weight * v
        of_both += weight * t * v
    if not total >= _PIXELS_LEAST:
        return nan, 0.0
    mean_t, mean_v = of_template / total, of_view / total
    power = square - mean_t * of_template
    gain = (of_both - mean_t * of_view) / power if power > 0 else 0.0
    if not isnan(expected):
        whole = numbers[3] ** 2 * deviations.size
        gain = (power * gain + whole * expected) / (power + whole)
    if _GAIN_LEAST < gain < _GAIN_MOST:
        return gain, mean_v - gain * (numbers[2] + mean_t)
    return nan, 0.0


@compiled
def _compare(deviations: _Pixels, numbers: NDArray[np.float64], seen: _Pixels, gain: float, offset: float) -> float:
    """Compare a view with the pattern in a light; the standard deviation of most residuals."""
    n, every = deviations.size, 4 if deviations.size > _MANY else 1
    factor, constant = np.float32(1 / gain), np.float32(offset / gain + numbers[2])
    for i in range(n):
        seen[2, i] = seen[0, i] * factor - deviations[i] - constant
    some = np.empty((n + every - 1) // every, np.float32)
    for i in range(some.size):
        some[i] = abs(seen[2, every * i])
    spread = max(1.4826 * _middle_of(some), _least_spread(numbers, gain))
    narrow, one = np.float32(1 / (_ROBUST * spread)), np.float32(1)
    for i in range(n):
        off = seen[2, i] * narrow
        denominator = one + off * off
        seen[3, i] = one / (denominator * denominator)
    return spread


@compiled
def _least_spread(numbers: NDArray[np.float64], gain: float) -> float:
    """Spread of the residuals that noise, interpolation and blur leave in a light."""
    return float(max(numbers[4] * hypot(1, 1 / gain), _ALLOWED * numbers[3]))


@compiled
def _middle_of(values: _Pixels) -> float:
    """Upper median, by Hoare's selection; the values are reordered."""
    middle, low, high = values.size // 2, 0, values.size - 1
    while low < high:
        pivot, i, j = values[(low + high) // 2], low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            break
    return float(values[middle])
