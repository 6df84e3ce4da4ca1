"""A Gauss-Newton step, and what it needs of 3 x 3 matrices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core.computer import compiled

_Pixels = NDArray[np.float32]
_Matrix = NDArray[np.float64]


@compiled
def gauss_newton_step(
    jacobian: _Pixels, damping: NDArray[np.float64], noise: float, seen: _Pixels
) -> NDArray[np.float64]:
    """Step along each generator; the light is found along with it.

    `jacobian` is that of `labcdp.tracking.level_kernel.Pattern`, `seen` what `looked_at` says there; `noise` the
    standard deviation of the template's.
    """
    m, n = jacobian.shape
    products, answers, scatter = np.empty((m, m)), np.empty(m), 0.0
    weighted = np.empty(n, np.float32)
    for a in range(m):
        for i in range(n):
            weighted[i] = seen[1, i] * seen[3, i] * jacobian[a, i]
        answers[a] = _dot(weighted, seen[2])
        for b in range(a + 1):
            products[a, b] = _dot(weighted, jacobian[b])
    # The last row is of ones, so that these are the weights.
    for i in range(n):
        scatter += weighted[i] * seen[2, i] * seen[2, i]
    scatter = max(scatter / max(products[m - 1, m - 1], 1e-9), noise * noise)
    # Cholesky's decomposition: what is held back makes the products positive definite.
    for a in range(m):
        products[a, a] += damping[a] * scatter + 1e-6 * products[a, a] + 1e-9
        for b in range(a + 1):
            for c in range(b):
                products[a, b] -= products[a, c] * products[b, c]
            products[a, b] = products[a, b] ** 0.5 if a == b else products[a, b] / products[b, b]
        for c in range(a):
            answers[a] -= products[a, c] * answers[c]
        answers[a] /= products[a, a]
    for a in range(m - 1, -1, -1):
        for c in range(a + 1, m):
            answers[a] -= products[c, a] * answers[c]
        answers[a] /= products[a, a]
    return answers[: m - 2]


@compiled
def _dot(one: _Pixels, other: _Pixels) -> float:
    """Sum of products; several sums at once are quicker."""
    p = q = r = s = np.float32(0)
    n = one.size // 4 * 4
    for i in range(0, n, 4):
        p += one[i] * other[i]
        q += one[i + 1] * other[i + 1]
        r += one[i + 2] * other[i + 2]
        s += one[i + 3] * other[i + 3]
    for i in range(n, one.size):
        p += one[i] * other[i]
    return float(p + q + (r + s))


@compiled
def product(a: _Matrix, b: _Matrix) -> _Matrix:
    """Product of two matrices."""
    c = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                c[i, j] += a[i, k] * b[k, j]
    return c


@compiled
def inverse(m: _Matrix) -> _Matrix:
    """Inverse by cofactors; not finite if there is none."""
    c, one = np.empty((3, 3)), 0.0
    for i in range(3):
        for j in range(3):
            p, q, r, s = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
            c[i, j] = m[p, r] * m[q, s] - m[p, s] * m[q, r]
        one += m[0, i] * c[i, 0]
    for i in range(3):
        for j in range(3):
            c[i, j] /= one
    return c
