"""Alignment of a template with a view, to a fraction of a pixel, whatever the light, and if part of it is covered."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan

import numpy as np
from numpy.typing import NDArray

from .fit_kernel import align, trust_learnt
from .geometry import Matrix
from .level import GainOffset, Level
from .outline import Outline
from .template import Template, gradients
from .view import View

#: Trust that is kept in a patch and its edge whatever is learnt.
_TRUST_KEPT = 0.7
#: Frames that the trust in all pixels at the start counts like, and that are remembered of it at most.
_LEARNT_AT_FIRST, _LEARNT_AT_MOST = 4, 20
#: A light that is not known.
_ANY_LIGHT = (nan, nan)


@dataclass(frozen=True, eq=False)
class Fit:
    """A template found in a view.

    Parameters
    ----------
    to_view : ndarray of float, shape (3, 3)
        Template pixels to view pixels.
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
    heights : ndarray of float, shape (n,)
        Heights of the edges around the region over those in the first frame, part by part; nan outside the image.
    """

    to_view: Matrix
    to_image: Matrix
    quality: float
    light: tuple[float, float]
    covered: float
    in_image: float
    agrees: NDArray[np.float32]
    heights: NDArray[np.float64]


class Aligner:
    """Aligns one template: Gauss-Newton steps on robustly weighted residuals (inverse compositional).

    Parameters
    ----------
    template : Template
        What to align.
    planar : bool
        False for shift, scale and rotation; True for any view of a flat target (homography).

    Notes
    -----
    S. Baker and I. Matthews, Lucas-Kanade 20 years on: a unifying framework, Int. J. Comput. Vis. 56, 2004. Gain and
    offset are found together with each step. Steps that the image does not determine are damped, so a target that is
    alike in one direction (a disc turned, a bar shifted along) stays as predicted there.
    """

    def __init__(self, template: Template, *, planar: bool) -> None:
        self.template = template
        self._coarse, self._fine = (Level(template, planar, coarse) for coarse in (True, False))
        structure = template.values - template.values.mean()
        dx, dy = gradients(template.values)
        self._own = (np.abs(structure) + 2 * np.hypot(dx, dy)).ravel(), template.inside
        self._trust = template.trust.ravel()
        self._trust_least = _TRUST_KEPT * self._trust**2
        self._learnt = _LEARNT_AT_FIRST
        self._outline = Outline(template)
        self._spread_trust()

    def align(self, view: View, to_view: Matrix, light: GainOffset | None = None) -> Fit | None:
        """Improve a guess `to_view` (template pixels to view pixels); None if it leads nowhere.

        `light` is a guess of gain and offset, as of the frame before.
        """
        to_view, to_image, gain, offset, quality, covered, in_image, agrees, heights = align(
            view.values, (view.factors, view.corner, view.image_shape), self._coarse.pixels, self._fine.pixels, to_view,
            _ANY_LIGHT if light is None else light, self._own, self._outline.edges,
        )  # fmt: skip
        return Fit(to_view, to_image, quality, (gain, offset), covered, in_image, agrees, heights) if gain > 0 else None

    def vanished(self, fit: Fit) -> float:
        """Share of the region's outline that had edges until now and has none where it was found."""
        return self._outline.gone(fit.heights)

    def learn(self, fit: Fit) -> None:
        """Learn from an accepted fit which pixels move with the region: the others belong to something else."""
        self._outline.learn(fit.heights)
        self._learnt = min(self._learnt + 1, _LEARNT_AT_MOST)
        self._trust = trust_learnt(self._trust, self._trust_least, fit.agrees, self._learnt)
        self._spread_trust()

    def _spread_trust(self) -> None:
        trust = self._trust.reshape(self.template.shape)
        self._coarse.trust_in(trust)
        self._fine.trust_in(trust)
