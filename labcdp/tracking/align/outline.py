"""The outline of the patch a region lies in: whether its edges are still there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .template import Template, gradients

#: Parts of a turn around the region in which its outline is looked at.
_PARTS = 24
#: Step of brightness over the noise from which on a part has an edge.
_CLEAR = 6.0
#: Squared gradients across a smoothed step of height 1, summed up.
_STEP_ENERGY = 0.3125
#: Share of the outline without which nothing is said.
_LEAST = 0.25
#: Share of an edge's usual height below which it is gone, and of its first height below which there is none to lose.
_GONE, _FAINT = 0.35, 0.25
#: The highest edges distinguish a loss of light from lost edges: their quantile, and the least light.
_HIGHEST, _DIMMEST = 0.85, 0.25
#: Part of what is new in a frame that is remembered, and the largest height that is.
_LEARNT, _HEIGHT_MOST = 0.25, 1.5


class Outline:
    """Heights of the edges around a region, part by part, over those of the look they are compared with.

    A thing that vanishes or is covered by something plain loses them at once; fog takes them slowly and from all
    sides, and then what is remembered goes along.
    """

    def __init__(self, template: Template, values: NDArray[np.float32]) -> None:
        import cv2

        patch = template.patch.astype(np.uint8)
        square = np.ones((5, 5), np.uint8)
        edged = (cv2.dilate(patch, square) > 0) & (cv2.erode(patch, square) == 0)
        rim = (patch > 0) & (cv2.erode(patch, np.ones((3, 3), np.uint8)) == 0)
        x, y = template.points.T
        middle = template.corners.mean(axis=0)
        turn = np.arctan2(y - middle[1], x - middle[0]) / (2 * np.pi) + 0.5
        parts = np.minimum((_PARTS * turn).astype(int), _PARTS - 1)
        length = np.bincount(parts[rim.ravel()], minlength=_PARTS).astype(np.float64)
        self._near = np.flatnonzero(edged.ravel())
        self._parts = parts[self._near]
        dx, dy = gradients(values)
        self._slopes = dx.ravel()[self._near], dy.ravel()[self._near]
        self._energies = self._sums(self._slopes[0] ** 2 + self._slopes[1] ** 2)
        clear = self._energies > _STEP_ENERGY * length * (_CLEAR * template.noise_dn) ** 2
        self._length = np.where(clear, length, 0.0)
        self._enough = _LEAST * float(length.sum())
        self._usual = np.ones(_PARTS)

    def heights(self, values: NDArray[np.float32], gain: float) -> NDArray[np.float64]:
        """Heights in a view under the template, shape (h, w), over those in the first frame; nan outside the image."""
        dx, dy = gradients(values)
        sums = self._sums(dx.ravel()[self._near] * self._slopes[0] + dy.ravel()[self._near] * self._slopes[1])
        # Before a background that moves otherwise an edge may change its sign.
        heights: NDArray[np.float64] = np.abs(sums) / (gain * np.maximum(self._energies, 1e-9))
        return heights

    def gone(self, heights: NDArray[np.float64]) -> float:
        """Share of the outline that had edges until now and has lost them."""
        known = np.isfinite(heights) & (self._usual > _FAINT) & (self._length > 0)
        length = self._length[known]
        if length.sum() <= self._enough:
            return 0.0
        kept = heights[known] / self._usual[known]
        light = min(max(float(np.quantile(kept, _HIGHEST)), _DIMMEST), 1.0)
        return float(length[kept < _GONE * light].sum() / length.sum())

    def learn(self, heights: NDArray[np.float64]) -> None:
        """Remember the heights of a frame in which the region was found."""
        known = np.isfinite(heights)
        self._usual[known] += _LEARNT * (np.minimum(heights[known], _HEIGHT_MOST) - self._usual[known])

    def _sums(self, values: NDArray[np.float32]) -> NDArray[np.float64]:
        return np.bincount(self._parts, values, _PARTS).astype(np.float64)
