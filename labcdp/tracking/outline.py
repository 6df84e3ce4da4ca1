"""The outline of the patch a region lies in: whether its edges are still there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .outline_kernel import Edges, gone, remembered
from .template import Template, gradients

#: Parts of a turn around the region in which its outline is looked at.
_PARTS = 24
#: Step of brightness over the noise from which on a part has an edge.
_CLEAR = 6.0
#: Squared gradients across a smoothed step of height 1, summed up.
_STEP_ENERGY = 0.3125
#: Share of the outline without which nothing is said.
_LEAST = 0.25


class Outline:
    """Heights of the edges around a region, part by part, over those in the first frame.

    A thing that vanishes or is covered by something plain loses them at once; fog takes them slowly and from all
    sides, and then what is remembered goes along.
    """

    def __init__(self, template: Template) -> None:
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
        near = np.flatnonzero(edged.ravel())
        dx, dy = gradients(template.values)
        slopes = np.stack([dx.ravel()[near], dy.ravel()[near]])
        energies = np.bincount(parts[near], np.square(slopes).sum(axis=0), _PARTS).astype(np.float64)
        #: What its heights are told from.
        self.edges = Edges(template.shape[1], near, parts[near], slopes, energies)
        clear = energies > _STEP_ENERGY * length * (_CLEAR * template.noise_dn) ** 2
        self._length = np.where(clear, length, 0.0)
        self._enough = _LEAST * float(length.sum())
        self._usual = np.ones(_PARTS)

    def gone(self, heights: NDArray[np.float64]) -> float:
        """Share of the outline that had edges until now and has lost them."""
        return gone(heights, self._usual, self._length, self._enough)

    def learn(self, heights: NDArray[np.float64]) -> None:
        """Remember the heights of a frame in which the region was found."""
        self._usual = remembered(self._usual, heights)
