"""Weights of interpolation by polynomials."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def lagrange_weights(nodes: FloatArray, at: NDArray[Any]) -> FloatArray:
    """Weights of the values at the nodes in the polynomial through them.

    Parameters
    ----------
    nodes : ndarray, shape (k,) or (n, k)
        Distinct nodes, the same for each place or a row for each.
    at : ndarray, shape (n,)
        Places.

    Returns
    -------
    ndarray, shape (n, k)
    """
    columns = np.broadcast_to(nodes, (at.size, nodes.shape[-1]))
    weights = np.ones(columns.shape)
    for j in range(columns.shape[1]):
        for k in range(columns.shape[1]):
            if k != j:
                weights[:, j] *= (at - columns[:, k]) / (columns[:, j] - columns[:, k])
    return weights
