"""Gauss-Newton steps that align a template with a view, all passes over its pixels in one call."""

from __future__ import annotations

from math import hypot, isfinite, isnan, nan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.computer import compiled

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


@compiled
def _product(one: _Matrix, other: _Matrix) -> _Matrix:
    result = np.zeros((3, 3))
    for row in range(3):
        for column in range(3):
            for between in range(3):
                result[row, column] += one[row, between] * other[between, column]
    return result


@compiled
def _inverse(matrix: _Matrix) -> _Matrix:
    """Inverse by cofactors, not finite if there is none."""
    result = np.empty((3, 3))
    for row in range(3):
        for column in range(3):
            a, b, c, d = (column + 1) % 3, (column + 2) % 3, (row + 1) % 3, (row + 2) % 3
            result[row, column] = matrix[a, c] * matrix[b, d] - matrix[a, d] * matrix[b, c]
    whole = matrix[0, 0] * result[0, 0] + matrix[0, 1] * result[1, 0] + matrix[0, 2] * result[2, 0]
    for row in range(3):
        for column in range(3):
            result[row, column] /= whole
    return result


@compiled
def _sample(
    level: LevelArrays,
    image: _Pixels,
    bounds: tuple[float, float, float, float],
    to_view: _Matrix,
    values: _Pixels,
    trusted: _Pixels,
) -> None:
    """Interpolate a view under the template, and say how far each pixel counts: not outside `bounds`."""
    place = _product(to_view, level.to_template)
    a, b, c, d, e, f = place[0, 0], place[0, 1], place[0, 2], place[1, 0], place[1, 1], place[1, 2]
    g, h, i = place[2, 0], place[2, 1], place[2, 2]
    left, top, right, bottom = bounds
    n_rows, n_columns = image.shape
    at = 0
    for row in range(values.size // level.width):
        for column in range(level.width):
            x, y = column + 0.5, row + 0.5
            w = g * x + h * y + i
            u, v = a * x + b * y + c, d * x + e * y + f
            inside = w > 0 and left * w < u < right * w and top * w < v < bottom * w
            trusted[at] = level.trust[at] if inside else np.float32(0)
            scale = 1 / w if w != 0 else 0.0
            # The middle of the first pixel is at 0.5; beyond the last ones their values go on.
            u, v = min(max(u * scale - 0.5, 0.0), n_columns - 1.0), min(max(v * scale - 0.5, 0.0), n_rows - 1.0)
            across, down = min(int(u), n_columns - 2), min(int(v), n_rows - 2)
            to_right, to_down = np.float32(u - across), np.float32(v - down)
            above, below = image[down, across], image[down + 1, across]
            above += to_right * (image[down, across + 1] - above)
            below += to_right * (image[down + 1, across + 1] - below)
            values[at] = above + to_down * (below - above)
            at += 1


@compiled
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


@compiled
def _least_spread(level: LevelArrays, gain: float) -> float:
    """Spread of the residuals that noise, interpolation and blur leave in a light."""
    return max(level.noise * hypot(1.0, 1 / gain), _ALLOWED * level.structure)


@compiled
def _compare(
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
    scale = np.float32(1 / (_ROBUST * spread))
    for at in range(values.size):
        off = residuals[at] * scale
        off = one + off * off
        robust[at] = one / (off * off)
    return spread


@compiled
def _light(
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
    if not _GAIN_LEAST < gain < _GAIN_MOST:
        return nan, 0.0
    return gain, mean_v - gain * (level.middle + mean_t)


@compiled
def _in_light(
    level: LevelArrays, values: _Pixels, trusted: _Pixels, gain: float, offset: float
) -> tuple[float, float, float, _Pixels, _Pixels]:
    """Compare a view in the light that is found in three steps: from a guess, or from all pixels if its gain is nan."""
    residuals, robust = np.empty(values.size, np.float32), np.ones(values.size, np.float32)
    expected, spread = gain, 0.0
    if not isnan(gain):
        spread = _compare(level, values, gain, offset, residuals, robust)
    for _ in range(3):
        gain_before, offset_before = gain, offset
        gain, offset = _light(level, values, trusted, robust, expected)
        if isnan(gain):
            break
        spread = _compare(level, values, gain, offset, residuals, robust)
        changed = gain - gain_before
        middle = (changed * level.middle + offset - offset_before) / max(level.structure, 1e-9)
        if max(abs(changed), abs(middle)) < _SETTLED * gain and not isnan(gain_before):
            break
    return gain, offset, spread, residuals, robust


@compiled
def _look(
    level: LevelArrays, values: _Pixels, trusted: _Pixels, gain: float, offset: float
) -> tuple[float, float, float, _Pixels, _Pixels]:
    """Compare a view with the template, starting from a guess of the light; gain nan for none, or if that fails.

    A large bright thing in front of the target spoils a start from all pixels, but not one from a known light.
    """
    guessed = _in_light(level, values, trusted, gain, offset)
    # None fits better than one that leaves only noise.
    if isnan(gain) or (not isnan(guessed[0]) and _CHANGED * guessed[2] <= _least_spread(level, guessed[0])):
        return guessed
    seen = _in_light(level, values, trusted, nan, 0.0)
    # A guess is kept unless the light has clearly changed.
    if not isnan(seen[0]) and (isnan(guessed[0]) or seen[2] < _CHANGED * guessed[2]):
        return seen
    return guessed


@compiled
def _step(
    level: LevelArrays, trusted: _Pixels, residuals: _Pixels, robust: _Pixels, rows: _Pixels, weighted: _Pixels
) -> NDArray[np.float64]:
    """Gauss-Newton step along each generator, light found along with it; `rows` are the Jacobian's, and one more."""
    n = len(level.jacobian)
    for at in range(residuals.size):
        rows[n, at] = residuals[at]
    for row in range(n + 1):
        for at in range(residuals.size):
            weighted[row, at] = rows[row, at] * (trusted[at] * robust[at])
    sums = np.dot(weighted, rows.T)
    products, step = np.empty((n, n)), np.empty(n)
    # The last row of the Jacobian is of ones.
    scatter = max(sums[n, n] / max(sums[n - 1, n - 1], 1e-9), level.noise**2)
    # Cholesky's factor, and both substitutions.
    for row in range(n):
        step[row] = sums[row, n]
        for column in range(row + 1):
            rest = np.float64(sums[row, column])
            if row == column:
                rest += level.damping[row] * scatter + 1e-6 * rest + 1e-9
            for before in range(column):
                rest -= products[row, before] * products[column, before]
            products[row, column] = rest**0.5 if row == column else rest / products[column, column]
        for before in range(row):
            step[row] -= products[row, before] * step[before]
        step[row] /= products[row, row]
    for row in range(n - 1, -1, -1):
        for after in range(row + 1, n):
            step[row] -= products[after, row] * step[after]
        step[row] /= products[row, row]
    return step


@compiled
def improved(
    level: LevelArrays,
    image: _Pixels,
    bounds: tuple[float, float, float, float],
    place: _Matrix,
    gain: float,
    offset: float,
    n_steps: int,
) -> tuple[_Matrix, float, float, _Pixels, _Pixels, _Pixels]:
    """Compare a view with the template at a place, and improve that in up to `n_steps` steps.

    Returns the place; gain (nan if it led nowhere) and offset, the view under the template, how far each pixel counts
    and its residual, all before the last step.
    """
    n, size = level.jacobian.shape
    values, trusted = np.empty(size, np.float32), np.empty(size, np.float32)
    rows, weighted = np.empty((n + 1, size), np.float32), np.empty((n + 1, size), np.float32)
    expected, residuals, robust = gain, values, values
    for number in range(max(n_steps, 1)):
        _sample(level, image, bounds, place, values, trusted)
        if number:
            gain, offset = _light(level, values, trusted, robust, expected)
            if not isnan(gain):
                _compare(level, values, gain, offset, residuals, robust)
        else:
            gain, offset, _, residuals, robust = _look(level, values, trusted, gain, offset)
            for row in range(n if n_steps else 0):
                for at in range(size):
                    rows[row, at] = level.jacobian[row, at]
        if isnan(gain) or not n_steps:
            break
        step = _step(level, trusted, residuals, robust, rows, weighted)
        change, largest = np.eye(3), 0.0
        for way in range(n - 2):
            largest = max(largest, abs(step[way]))
            for at in range(9):
                change[at // 3, at % 3] += step[way] * level.generators[way, at]
        place = _product(_product(_product(place, level.from_centred), _inverse(change)), level.centred)
        whole = place[2, 2]
        for row in range(3):
            for column in range(3):
                place[row, column] /= whole
                if not isfinite(place[row, column]):
                    gain = nan
        if isnan(gain) or largest < level.still:
            break
    return place, gain, offset, values, trusted, residuals
