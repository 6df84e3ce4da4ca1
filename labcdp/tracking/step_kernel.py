"""Gauss-Newton steps that align a template with a view, compiled: see `labcdp.tracking.level`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..compiled import compiled
from ..sum_kernel import pairwise_sum
from .level_kernel import BLOCK, Bounds, Pixels, Seen, first_light, next_light, nothing_seen, sample
from .matrix_kernel import all_finite, invert, multiply, solve_positive


@compiled
def improve(
    image: NDArray[np.float32], bounds: Bounds, pixels: Pixels, to_view: NDArray[np.float64], steps: int,
    guesses: NDArray[np.float64],
) -> tuple[NDArray[np.float64], float, float]:  # fmt: skip
    """Make up to `steps` steps from `to_view`: see `labcdp.tracking.level.Level.improve`.

    Returns
    -------
    to_view : ndarray of float64, shape (3, 3)
    gain, offset : float
        Light before the last step; gain 0 if the steps lead nowhere.
    """
    seen = nothing_seen(pixels.trust.size)
    weights = np.empty((3, BLOCK), np.float32)
    place, change, other = to_view.copy(), np.empty((3, 3)), np.empty((3, 3))
    light = (0.0, 0.0, np.nan, 0.0)
    for number in range(steps):
        sample(image, bounds, place, pixels, seen)
        light = first_light(pixels, seen, guesses) if number == 0 else next_light(pixels, seen, light[2])
        if light[0] == 0:
            break
        step = _step(pixels, seen, weights)
        most = 0.0
        for k in range(step.size):
            most = max(most, abs(step[k]))
        _move(pixels, step, place, change, other)
        if not all_finite(place):
            return place, 0.0, 0.0
        if most < pixels.still:
            break
    return place, light[0], light[1]


@compiled
def _move(
    pixels: Pixels, step: NDArray[np.float64], place: NDArray[np.float64], change: NDArray[np.float64],
    other: NDArray[np.float64],
) -> None:  # fmt: skip
    """Change a place by the inverse of a step; `change` and `other`, of shape (3, 3), are written over."""
    for row in range(3):
        for column in range(3):
            change[row, column] = 1.0 if row == column else 0.0
            for k in range(step.size):
                change[row, column] += step[k] * pixels.generators[k, row, column]
    invert(change, other)
    multiply(other, pixels.centred, change)
    multiply(pixels.from_centred, change, other)
    multiply(place, other, change)
    for row in range(3):
        for column in range(3):
            place[row, column] = change[row, column] / change[2, 2]


@compiled
def _step(pixels: Pixels, seen: Seen, weights: NDArray[np.float32]) -> NDArray[np.float64]:
    """Gauss-Newton step along each generator, from the residuals in the template's DN.

    `weights`, of shape (3, `BLOCK`), is written over.
    """
    jacobian, residuals = pixels.jacobian, seen.residuals
    unknowns, n = jacobian.shape
    products, pull = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
    total = scatter = 0.0
    for start in range(0, n, BLOCK):
        stop = min(start + BLOCK, n)
        each, weighted = weights[0, : stop - start], weights[1, : stop - start]
        room = weights[2, : stop - start]
        trusted, robust, left = seen.trusted[start:stop], seen.robust[start:stop], residuals[start:stop]
        for i in range(each.size):
            each[i] = trusted[i] * robust[i]
            room[i] = each[i]
            weighted[i] = each[i] * left[i]
        total += pairwise_sum(room)
        scatter += _dot(weighted, left, room)
        for row in range(unknowns):
            slopes = jacobian[row, start:stop]
            pull[row] += _dot(weighted, slopes, room)
        for row in range(unknowns):
            slopes = jacobian[row, start:stop]
            for i in range(each.size):
                weighted[i] = slopes[i] * each[i]
            for column in range(row + 1):
                products[row, column] += _dot(weighted, jacobian[column, start:stop], room)
    least = max(scatter / max(total, 1e-9), pixels.noise**2)
    for row in range(unknowns):
        products[row, row] += pixels.damping[row] * least + 1e-6 * products[row, row] + 1e-9
    # Damped, it is positive definite; if not for all that, the step is none.
    if not solve_positive(products, pull):
        for row in range(unknowns):
            pull[row] = 0.0
    return pull[: pixels.generators.shape[0]]


@compiled
def _dot(a: NDArray[np.float32], b: NDArray[np.float32], room: NDArray[np.float32]) -> float:
    for i in range(room.size):
        room[i] = a[i] * b[i]
    return pairwise_sum(room)
