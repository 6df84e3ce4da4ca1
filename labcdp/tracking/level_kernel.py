"""Gauss-Newton steps that align a template with a view, and how well it fits there, passes over pixels in one call."""

from __future__ import annotations

from math import isfinite, isnan, nan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.computer import compiled, compiled_part
from .light_kernel import LevelArrays, compare, find_light, look

_Pixels = NDArray[np.float32]
_Matrix = NDArray[np.float64]


@compiled_part
def _product(one: _Matrix, other: _Matrix) -> _Matrix:
    result = np.empty((3, 3))
    for row in range(3):
        for column in range(3):
            total = 0.0
            for between in range(3):
                total += one[row, between] * other[between, column]
            result[row, column] = total
    return result


@compiled_part
def _inverse(matrix: _Matrix) -> _Matrix:
    """Inverse by cofactors, times the determinant, which moves points to the same places."""
    result = np.empty((3, 3))
    for row in range(3):
        for column in range(3):
            a, b, c, d = (column + 1) % 3, (column + 2) % 3, (row + 1) % 3, (row + 2) % 3
            result[row, column] = matrix[a, c] * matrix[b, d] - matrix[a, d] * matrix[b, c]
    return result


@compiled_part
def _sample(
    level: LevelArrays,
    image: _Pixels,
    bounds: tuple[float, float, float, float],
    to_view: _Matrix,
    values: _Pixels,
    trusted: _Pixels,
) -> None:
    """Interpolate a view under the template, and say how far each pixel counts: not outside `bounds`."""
    position = _product(to_view, level.to_template)
    a, b, c, d, e, f = position[0, 0], position[0, 1], position[0, 2], position[1, 0], position[1, 1], position[1, 2]
    g, h, i = position[2, 0], position[2, 1], position[2, 2]
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


@compiled_part
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
    sums = np.empty((n + 1, n + 1), np.float32)
    np.dot(weighted, rows.T, sums)
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
    position: _Matrix,
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
        _sample(level, image, bounds, position, values, trusted)
        if number:
            gain, offset = find_light(level, values, trusted, robust, expected)
            if not isnan(gain):
                compare(level, values, gain, offset, residuals, robust)
        else:
            gain, offset, _, residuals, robust = look(level, values, trusted, gain, offset)
            for row in range(n if n_steps else 0):
                for at in range(size):
                    rows[row, at] = level.jacobian[row, at]
        if isnan(gain) or not n_steps:
            break
        step = _step(level, trusted, residuals, robust, rows, weighted)
        change, largest = np.empty((3, 3)), 0.0
        for at in range(9):
            change[at // 3, at % 3] = at % 4 == 0
        for way in range(n - 2):
            largest = max(largest, abs(step[way]))
            for at in range(9):
                change[at // 3, at % 3] += step[way] * level.generators[way, at]
        position = _product(_product(_product(position, level.from_centred), _inverse(change)), level.centred)
        whole = position[2, 2]
        for row in range(3):
            for column in range(3):
                position[row, column] /= whole
                if not isfinite(position[row, column]):
                    gain = nan
        if isnan(gain) or largest < level.still:
            break
    return position, gain, offset, values, trusted, residuals


class Edges(NamedTuple):
    """Pixels on and beside the edges around a region.

    Parameters
    ----------
    near, parts : ndarray of int64, shape (k,)
        Their numbers in the template, and the part of the outline that each belongs to.
    across, down : ndarray of float32, shape (k,)
        Slopes of the template there.
    """

    near: NDArray[np.int64]
    parts: NDArray[np.int64]
    across: _Pixels
    down: _Pixels


@compiled
def agreement(residuals: _Pixels, trusted: _Pixels, carries: _Pixels, factor: float) -> tuple[_Pixels, float, int]:
    """How far each pixel is found again (nan outside the image), their sum by what they carry, number in the image."""
    agrees = np.empty(residuals.size, np.float32)
    match, n_inside = 0.0, 0
    for at in range(residuals.size):
        if trusted[at] > 0:
            off = residuals[at] * factor
            off *= off
            agrees[at] = 1 / (1 + off * off)
            match += carries[at] * (trusted[at] * agrees[at])
            n_inside += 1
        else:
            agrees[at] = np.nan
    return agrees, match, n_inside


@compiled
def height_sums(values: _Pixels, trusted: _Pixels, width: int, edges: Edges, n_parts: int) -> NDArray[np.float64]:
    """Products of the slopes of a view under a template and its own, summed by part; nan outside the image."""
    sums = np.zeros(n_parts)
    for number in range(edges.near.size):
        at = edges.near[number]
        column = at % width
        left, right = at - (column > 0), at + (column < width - 1)
        above = at - width if at >= width else at
        below = at + width if at + width < values.size else at
        if min(min(trusted[left], trusted[right]), min(trusted[above], trusted[below])) > 0:
            across = (values[right] - values[left]) / (right - left)
            down = (values[below] - values[above]) / ((below - above) // width)
            sums[edges.parts[number]] += across * edges.across[number] + down * edges.down[number]
        else:
            sums[edges.parts[number]] = np.nan
    return sums
