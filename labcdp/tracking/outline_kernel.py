"""Heights of edges part by part, compiled: see `labcdp.tracking.outline`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled import compiled
from .select_kernel import kth_smallest

#: Share of an edge's usual height below which it is gone, and of its first height below which there is none to lose.
_GONE, _FAINT = 0.35, 0.25
#: Light that went at once is told from edges that went by the highest ones: their quantile, and the least light.
_HIGHEST, _DIMMEST = 0.85, 0.25
#: Part of what is new in a frame that is remembered, and the largest height that is.
_LEARNT, _HEIGHT_MOST = 0.25, 1.5


class Edges(NamedTuple):
    """What the heights of the edges around a region are told from.

    Parameters
    ----------
    columns : int
        Template pixels of a row.
    near, parts : ndarray of int64, shape (k,)
        Template pixels that are looked at, and the part of the outline each belongs to.
    slopes : ndarray of float32, shape (2, k)
        Gradients of the template there, along x and y.
    energies : ndarray of float64, shape (p,)
        Sums of the squared gradients of each part.
    """

    columns: int
    near: NDArray[np.int64]
    parts: NDArray[np.int64]
    slopes: NDArray[np.float32]
    energies: NDArray[np.float64]


@compiled
def heights_of(
    values: NDArray[np.float32], agrees: NDArray[np.float32], gain: float, edges: Edges
) -> NDArray[np.float64]:
    """Heights of the edges of each part in a view over those in the first frame, shape (p,).

    Parameters
    ----------
    values, agrees : ndarray of float32, shape (n,)
        The view under each template pixel, row by row; nan where one lies outside the image: the part is then nan too.
    gain : float
        Gain of the view's DN over the template's.
    """
    columns, slopes, parts = edges.columns, edges.slopes, edges.parts
    heights = np.zeros(edges.energies.size)
    last = values.size // columns - 1
    for k in range(edges.near.size):
        pixel = edges.near[k]
        x, y = pixel % columns, pixel // columns
        # Central differences, one-sided at the ends.
        left, right = max(x - 1, 0), min(x + 1, columns - 1)
        above, below = max(y - 1, 0), min(y + 1, last)
        along = (values[y * columns + right] - values[y * columns + left]) / (right - left)
        down = (values[below * columns + x] - values[above * columns + x]) / (below - above)
        if np.isnan(agrees[pixel]):
            heights[parts[k]] = np.nan
        heights[parts[k]] += along * slopes[0, k] + down * slopes[1, k]
    for part in range(heights.size):
        # Before a background that moves otherwise an edge may change its sign.
        heights[part] = abs(heights[part]) / (gain * max(edges.energies[part], 1e-9))
    return heights


@compiled
def remembered(usual: NDArray[np.float64], heights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Heights that are usual from the ones until now and those of another frame, nan where not known; shape (p,)."""
    changed = np.empty_like(usual)
    for part in range(usual.size):
        change = _LEARNT * (min(heights[part], _HEIGHT_MOST) - usual[part])
        changed[part] = usual[part] + change if np.isfinite(heights[part]) else usual[part]
    return changed


@compiled
def gone(heights: NDArray[np.float64], usual: NDArray[np.float64], length: NDArray[np.float64], enough: float) -> float:
    """Share of an outline that had edges until now and has lost them.

    Parameters
    ----------
    heights, usual : ndarray of float64, shape (p,)
        Height of each part over that in the first frame, now (nan if not known) and as a rule.
    length : ndarray of float64, shape (p,)
        Length of each part; 0 where there is no edge to lose.
    enough : float
        Length up to which nothing is said.
    """
    kept, lengths = np.empty(heights.size, np.float32), np.empty(heights.size)
    n = 0
    whole = 0.0
    for part in range(heights.size):
        if np.isfinite(heights[part]) and usual[part] > _FAINT and length[part] > 0:
            kept[n], lengths[n] = heights[part] / usual[part], length[part]
            whole += length[part]
            n += 1
    return share_gone(kept[:n], lengths[:n], _GONE, _HIGHEST, _DIMMEST) if whole > enough else 0.0


@compiled
def share_gone(
    kept: NDArray[np.float32], length: NDArray[np.float64], part: float, highest: float, dimmest: float
) -> float:
    """Share of an outline whose edges are below `part` of their usual height, but for light that went.

    Parameters
    ----------
    kept : ndarray of float32, shape (k,)
        Height of each part over the usual one; at least one.
    length : ndarray of float64, shape (k,)
        Length of each part.
    highest, dimmest : float
        Quantile of `kept` that tells how much light there is, and the least light.
    """
    at = highest * (kept.size - 1)
    below = int(at)
    low = kth_smallest(kept, below)
    high = kth_smallest(kept, min(below + 1, kept.size - 1))
    light = min(max(low + (at - below) * (high - low), dimmest), 1.0)
    gone = whole = 0.0
    for k in range(kept.size):
        whole += length[k]
        if kept[k] < part * light:
            gone += length[k]
    return gone / whole
