"""How well a template fits where it was found, each figure in one pass over its pixels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.computer import compiled

_Pixels = NDArray[np.float32]


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
    found, n_inside = 0.0, 0
    for at in range(residuals.size):
        if trusted[at] > 0:
            off = residuals[at] * factor
            off *= off
            agrees[at] = 1 / (1 + off * off)
            found += carries[at] * (trusted[at] * agrees[at])
            n_inside += 1
        else:
            agrees[at] = np.nan
    return agrees, found, n_inside


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
