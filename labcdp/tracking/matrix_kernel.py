"""Arithmetic of 3 x 3 matrices for compiled loops, without an array for each step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..compiled import compiled


@compiled
def multiply(a: NDArray[np.float64], b: NDArray[np.float64], product: NDArray[np.float64]) -> None:
    """Write ``a @ b`` into `product`, which is neither of them; each of shape (3, 3)."""
    for row in range(3):
        for column in range(3):
            product[row, column] = (
                a[row, 0] * b[0, column] + a[row, 1] * b[1, column] + a[row, 2] * b[2, column]
            )  # fmt: skip


@compiled
def invert(matrix: NDArray[np.float64], inverse: NDArray[np.float64]) -> None:
    """Write the inverse of a matrix into `inverse`, which is not itself; not finite if there is none; shape (3, 3)."""
    for row in range(3):
        for column in range(3):
            # Cofactors come with their signs if the indices go round.
            a, b = (column + 1) % 3, (column + 2) % 3
            c, d = (row + 1) % 3, (row + 2) % 3
            inverse[row, column] = matrix[a, c] * matrix[b, d] - matrix[a, d] * matrix[b, c]
    determinant = matrix[0, 0] * inverse[0, 0] + matrix[0, 1] * inverse[1, 0] + matrix[0, 2] * inverse[2, 0]
    for row in range(3):
        for column in range(3):
            inverse[row, column] /= determinant


@compiled
def all_finite(matrix: NDArray[np.float64]) -> bool:
    """Whether all of a matrix is finite, shape (3, 3)."""
    for row in range(3):
        for column in range(3):
            if not np.isfinite(matrix[row, column]):
                return False
    return True


@compiled
def solve_positive(products: NDArray[np.float64], pull: NDArray[np.float64]) -> bool:
    """Solve linear equations whose matrix is positive definite, in place, by Cholesky's factors.

    Parameters
    ----------
    products : ndarray of float64, shape (n, n)
        The matrix, of which the lower half is read and replaced by the factor.
    pull : ndarray of float64, shape (n,)
        Right side; returns the solution.

    Returns
    -------
    bool
        False if the matrix is not positive definite; the solution is then none.
    """
    n = pull.size
    for row in range(n):
        for column in range(row + 1):
            value = products[row, column]
            for k in range(column):
                value -= products[row, k] * products[column, k]
            if row > column:
                products[row, column] = value / products[column, column]
            elif value > 0:
                products[row, row] = np.sqrt(value)
            else:
                return False
    for row in range(n):
        for k in range(row):
            pull[row] -= products[row, k] * pull[k]
        pull[row] /= products[row, row]
    for row in range(n - 1, -1, -1):
        for k in range(row + 1, n):
            pull[row] -= products[k, row] * pull[k]
        pull[row] /= products[row, row]
    return True
