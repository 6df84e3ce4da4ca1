"""Plane transforms as 3 x 3 matrices on (x, y, 1), in pixels with the corner of the image at (0, 0)."""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, hypot, isfinite, nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.roi import Roi

Matrix = NDArray[np.float64]


def shift(x: float, y: float) -> Matrix:
    """Matrix that moves by (`x`, `y`)."""
    return np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])


def scaling(x: float, y: float | None = None) -> Matrix:
    """Matrix that scales by `x` and `y` (both by `x` without `y`) around the origin."""
    return np.diag([x, x if y is None else y, 1.0])


def inverse(matrix: Matrix) -> Matrix:
    """Inverse of a matrix, by cofactors: several times as fast as a general solver.

    Raises
    ------
    numpy.linalg.LinAlgError
        If there is none.
    """
    a, b, c, d, e, f, g, h, i = matrix.ravel().tolist()
    p, q, r = e * i - f * h, f * g - d * i, d * h - e * g
    determinant = a * p + b * q + c * r
    if determinant == 0:
        raise np.linalg.LinAlgError("Singular matrix")
    cofactors = [p, c * h - b * i, b * f - c * e, q, a * i - c * g, c * d - a * f, r, b * g - a * h, a * e - b * d]
    return np.array(cofactors).reshape(3, 3) / determinant


def transform(matrix: Matrix, points: NDArray[Any]) -> NDArray[np.float64]:
    """Points, shape (n, 2), moved by `matrix`."""
    moved = points @ matrix[:, :2].T + matrix[:, 2]
    result: NDArray[np.float64] = moved[:, :2] / moved[:, 2:]
    return result


def moved(matrix: Matrix, *points: tuple[float, float]) -> list[tuple[float, float]]:
    """Points moved by `matrix`, as `transform` does, without arrays; nan where that has no end."""
    a, b, c, d, e, f, g, h, i = matrix.ravel().tolist()
    there = []
    for x, y in points:
        w = g * x + h * y + i
        there.append(((a * x + b * y + c) / w, (d * x + e * y + f) / w) if w else (nan, nan))
    return there


def local_scale(matrix: Matrix, point: Sequence[float]) -> float:
    """Square root of the factor by which `matrix` enlarges areas at `point`; nan where it mirrors."""
    a, b, c, d, e, f, g, h, i = matrix.ravel().tolist()
    w = g * point[0] + h * point[1] + i
    area = (a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g)) / w**3 if w else nan
    return area**0.5 if area > 0 else nan


def carried(roi: Roi, matrix: Matrix) -> Roi:
    """Region whose corners are moved by `matrix`."""
    return Roi(roi.name, tuple(moved(matrix, *roi.corners)))


def box_of(matrix: Matrix, width: float, height: float) -> tuple[float, float, float, float]:
    """Left, top, right and bottom end of a rectangle of `width` x `height` moved by `matrix`; nan if not finite."""
    xs, ys = zip(*moved(matrix, (0, 0), (width, 0), (width, height), (0, height)), strict=True)
    # A sum is finite if all are.
    return (min(xs), min(ys), max(xs), max(ys)) if isfinite(sum(xs) + sum(ys)) else (nan, nan, nan, nan)


def shape_change(
    before: Matrix, after: Matrix, to_centred: Matrix, from_centred: Matrix
) -> tuple[float, float, float, float]:
    """How the shape of a template changed between two matrices that put it into the image, wherever it went.

    Parameters
    ----------
    before, after : ndarray of float, shape (3, 3)
        Template pixels to image pixels.
    to_centred, from_centred : ndarray of float, shape (3, 3)
        Template pixels to coordinates of -1 to 1 along its longer side, and back.

    Returns
    -------
    longest, shortest : float
        Largest and smallest factor by which lengths grew; nan if there are none.
    turned : float
        Angle by which it was turned, in rad.
    tilted : float
        Perspective over half its size.
    """
    change = to_centred @ inverse(before) @ after @ from_centred
    a, b, x, c, d, y, g, h, whole = change.ravel().tolist()
    if whole == 0:
        return nan, nan, nan, nan
    a, b, x, c, d, y, g, h = (value / whole for value in (a, b, x, c, d, y, g, h))
    # Where it went does not matter, but how its shape changed.
    a, b, c, d = a - x * g, b - x * h, c - y * g, d - y * h
    # Singular values of a 2 x 2 matrix.
    plain, mirrored = hypot(a + d, c - b), hypot(a - d, b + c)
    return (plain + mirrored) / 2, abs(plain - mirrored) / 2, atan2(c - b, a + d), max(abs(g), abs(h))
