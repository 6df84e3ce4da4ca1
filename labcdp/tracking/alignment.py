"""Alignment of a template with a view, to a fraction of a pixel, whatever the light, and if part of it is covered."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, isfinite, isnan, nan

import numpy as np
from numpy.typing import NDArray

from .frame import View
from .geometry import Matrix
from .level import GainOffset, Level
from .settings import SETTINGS
from .template import Template, gradients

#: Own pixels below which none is said to be covered.
_OWN_LEAST = 4


@dataclass(frozen=True, eq=False)
class Fit:
    """A template found in a view.

    Parameters
    ----------
    to_image : ndarray of float, shape (3, 3)
        Template pixels to pixels of the frame.
    quality : float
        Share of the template's structure that is found again, 0 to 1: each pixel counts with its deviation
        from the template's mean and its gradient, and with how far it was seen to move with the region so far; it is
        found again as far as the view, after gain and offset, agrees with it but for noise.
    light : (float, float)
        Gain and offset of the view's DN over the template's.
    covered : float
        Share of the region's own pixels that do not agree with the rest of them.
    in_image : float
        Share of the template's pixels that lie in the image.
    agrees : ndarray of float32, shape (n,)
        How far each template pixel is found again, 0 to 1; nan outside the image.
    values : ndarray of float32, shape (h, w)
        The view under the template.
    heights : ndarray of float, shape (k,)
        Heights of the edges around the region over those in the first frame, part by part; nan outside the image.
    """

    to_image: Matrix
    quality: float
    light: GainOffset
    covered: float
    in_image: float
    agrees: NDArray[np.float32]
    values: NDArray[np.float32]
    heights: NDArray[np.float64]


class Aligner:
    """Aligns one look of a region: Gauss-Newton steps on robustly weighted residuals (inverse compositional).

    Parameters
    ----------
    template : Template
        The region.
    planar : bool
        False for shift, scale and rotation; True for any view of a flat target (homography).
    values : ndarray of float32, shape (h, w), or None
        How the template looks; None for as in the first frame.

    Notes
    -----
    S. Baker and I. Matthews, Lucas-Kanade 20 years on: a unifying framework, Int. J. Comput. Vis. 56, 2004. Gain and
    offset are found together with each step. Steps that the image does not determine are damped, so a target that is
    alike in one direction (a disc turned, a bar shifted along) stays as predicted there.
    """

    def __init__(self, template: Template, *, planar: bool, values: NDArray[np.float32] | None = None) -> None:
        self.template, self._planar = template, planar
        self.values = template.values if values is None else values
        self._coarse, self._fine = (Level(template, self.values, planar, coarse) for coarse in (True, False))
        dx, dy = gradients(self.values)
        # How far an own pixel may change before something else is seen there: on what is not uniform more.
        self._own = np.flatnonzero(self.template.inside)
        uneven = float(self.values.ravel()[self._own].std()) if self._own.size else 0.0
        uneven = max(uneven**2 - self.template.noise_dn**2, 0.0) ** 0.5
        self._uneven = np.float32(uneven) + np.hypot(dx, dy).ravel()[self._own]
        self._carries = (np.abs(self.values - self.values.mean()) + 2 * np.hypot(dx, dy)).ravel()
        self._trust = template.trust.ravel()
        self._trust_least = SETTINGS.weight_kept * self._trust**2
        self._learnt = SETTINGS.weights_first_frames
        self._outline = Outline(template, self.values)
        self._spread_trust()

    def relooked(self, values: NDArray[np.float32]) -> Aligner:
        """Aligner of the same region that looks like `values` by now."""
        other = Aligner(self.template, planar=self._planar, values=values)
        other._trust, other._learnt = self._trust, self._learnt
        other._spread_trust()
        return other

    def align(
        self, view: View, to_image: Matrix, light: GainOffset | None = None, *, improve: bool = True
    ) -> Fit | None:
        """Improve a guess `to_image` (template pixels to pixels of the frame), or judge it as it is.

        `light` is a guess of gain and offset, as of the frame before. None if the guess leads nowhere, or if hardly
        anything of the template can be seen there.
        """
        from .level_kernel import agreement, improved

        fine = self._fine.arrays
        better = ((self._coarse.arrays, SETTINGS.coarse_steps), (fine, SETTINGS.fine_steps)) if improve else ()
        position, (gain, offset) = view.from_image @ to_image, light or (nan, 0.0)
        for level, n_steps in (*better, (fine, 0)):
            position, gain, offset, values, trusted, residuals = improved(
                level, view.values, view.bounds, position, gain, offset, n_steps
            )
            if isnan(gain):
                return None
        noise, structure = fine.noise * (1 + 1 / gain**2) ** 0.5, fine.structure
        factor = 1 / hypot(SETTINGS.agrees_noise * noise, SETTINGS.agrees_share * structure)
        agrees, match, n_inside = agreement(residuals, trusted, self._carries, factor)
        # Whatever there is agrees with noise as strong as the structure.
        quality = match / self._carried * min(1.0, (structure / max(SETTINGS.agrees_noise * noise, 1e-9)) ** 2)
        return Fit(
            view.to_image @ position,
            quality,
            (gain, offset),
            self._covered(
                residuals, trusted, hypot(SETTINGS.covered_noise * noise, SETTINGS.covered_structure_share * structure)
            ),
            n_inside / agrees.size,
            agrees,
            values.reshape(self.template.shape),
            self._outline.heights(values, trusted, gain),
        )

    def vanished(self, fit: Fit) -> float:
        """Share of the region's outline that had edges until now and has none where it was found."""
        return self._outline.gone(fit.heights)

    def learn(self, fit: Fit) -> None:
        """Learn from an accepted fit which pixels move with the region: the others belong to something else."""
        self._outline.learn(fit.heights)
        self._learnt = min(self._learnt + 1, SETTINGS.weights_frames)
        known = ~np.isnan(fit.agrees)
        new = self._trust + (fit.agrees - self._trust) / np.float32(self._learnt)
        self._trust = np.where(known, np.maximum(new, self._trust_least), self._trust)
        self._spread_trust()

    def _covered(self, residuals: NDArray[np.float32], trusted: NDArray[np.float32], most: float) -> float:
        """Share of the region's own pixels in the image that are more than `most` off their median."""
        there = trusted[self._own] > 0
        return _share_off(residuals[self._own][there], most + self._uneven[there])

    def changed(self, before: NDArray[np.float32], after: NDArray[np.float32]) -> float:
        """Share of the region's own pixels that changed from one frame to the next, both in the light of the first."""
        most = hypot(
            SETTINGS.covered_noise * 2**0.5 * self._fine.arrays.noise,
            SETTINGS.covered_structure_share * self._fine.arrays.structure,
        )
        return _share_off((after - before).ravel()[self._own], most + self._uneven)

    def _spread_trust(self) -> None:
        trust = self._trust.reshape(self.template.shape)
        self._coarse.trust_in(trust)
        self._fine.trust_in(trust)
        self._carried = max(float(self._carries @ self._fine.arrays.trust), 1e-9)


def _share_off(values: NDArray[np.float32], most: NDArray[np.float32]) -> float:
    """Share of values that are more than `most` off their median."""
    if values.size < _OWN_LEAST:
        return 0.0
    middle = np.partition(values, values.size // 2)[values.size // 2]
    return float(np.count_nonzero(np.abs(values - middle) > most)) / values.size


#: Squared gradients across a smoothed step of height 1, summed up.
_STEP_ENERGY = 0.3125


class Outline:
    """Heights of the edges around a region, part by part, over those of the look they are compared with.

    A thing that vanishes or is covered by something plain loses them at once; fog takes them slowly and from all
    sides, and then what is remembered goes along.
    """

    def __init__(self, template: Template, values: NDArray[np.float32]) -> None:
        import cv2

        from .level_kernel import Edges

        patch = template.patch.astype(np.uint8)
        square = np.ones((5, 5), np.uint8)
        edged = (cv2.dilate(patch, square) > 0) & (cv2.erode(patch, square) == 0)
        rim = (patch > 0) & (cv2.erode(patch, np.ones((3, 3), np.uint8)) == 0)
        x, y = template.points.T
        middle = template.corners.mean(axis=0)
        turn = np.arctan2(y - middle[1], x - middle[0]) / (2 * np.pi) + 0.5
        parts = np.minimum((SETTINGS.outline_parts * turn).astype(int), SETTINGS.outline_parts - 1)
        length = np.bincount(parts[rim.ravel()], minlength=SETTINGS.outline_parts).astype(np.float64)
        near = np.flatnonzero(edged.ravel())
        dx, dy = gradients(values)
        self._edges, self._width = Edges(near, parts[near], dx.ravel()[near], dy.ravel()[near]), template.shape[1]
        squares = np.square(self._edges.across) + np.square(self._edges.down)
        self._energies = np.bincount(self._edges.parts, squares, SETTINGS.outline_parts).astype(np.float64)
        clear = self._energies > _STEP_ENERGY * length * (SETTINGS.outline_clear_noise * template.noise_dn) ** 2
        self._length = np.where(clear, length, 0.0).tolist()
        self._enough = SETTINGS.outline_known_share * float(length.sum())
        self._usual = np.ones(SETTINGS.outline_parts)

    def heights(self, values: NDArray[np.float32], trusted: NDArray[np.float32], gain: float) -> NDArray[np.float64]:
        """Heights in what is seen under the template over those in the first frame; nan outside the image."""
        from .level_kernel import height_sums

        sums = height_sums(values, trusted, self._width, self._edges, SETTINGS.outline_parts)
        # Before a background that moves otherwise an edge may change its sign.
        heights: NDArray[np.float64] = np.abs(sums) / (gain * np.maximum(self._energies, 1e-9))
        return heights

    def gone(self, heights: NDArray[np.float64]) -> float:
        """Share of the outline that had edges until now and has lost them."""
        known = [
            (height / usual, length)
            for height, usual, length in zip(heights.tolist(), self._usual.tolist(), self._length, strict=True)
            if isfinite(height) and usual > SETTINGS.outline_faint_share and length > 0
        ]
        whole = sum(length for _, length in known)
        if whole <= self._enough:
            return 0.0
        light = min(
            max(
                _quantile(sorted(kept for kept, _ in known), SETTINGS.outline_light_quantile),
                SETTINGS.outline_light_least,
            ),
            1.0,
        )
        return float(sum(length for kept, length in known if kept < SETTINGS.outline_gone_share * light) / whole)

    def learn(self, heights: NDArray[np.float64]) -> None:
        """Remember the heights of a frame in which the region was found."""
        known = np.isfinite(heights)
        self._usual[known] += SETTINGS.outline_rate * (
            np.minimum(heights[known], SETTINGS.outline_height_most) - self._usual[known]
        )


def _quantile(ranked: list[float], share: float) -> float:
    """Value that a share of the ranked ones are below, interpolated: numpy's takes longer than a whole outline."""
    at = share * (len(ranked) - 1)
    low = int(at)
    return ranked[low] + (at - low) * (ranked[min(low + 1, len(ranked) - 1)] - ranked[low])
