"""A plain region of the background, which keeps its position in the scene."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core.result import Finding
from ..core.roi import Roi
from .frame import GreyFrame, median, view_around
from .geometry import Matrix, carried
from .region import MovingRegion
from .scene import SceneNow
from .settings import SETTINGS
from .template import Template
from .tracked_roi import RegionState, TrackedRoi


class BackgroundRegion(RegionState):
    """Keeps a region that has no structure of its own at its place in the scene.

    Its place is that of the scene's points; what comes before it is noticed by the pixels that differ from the others,
    or by a sudden change of all. If what surrounds it is meanwhile clearly seen elsewhere, it was a plain part of a
    thing that moves, and is followed from then on.

    Parameters
    ----------
    template : Template
        The region.
    scene : SceneNow
        The first frame.
    mover : MovingRegion or None
        Follows the region with its surroundings, if these are enough.
    """

    def __init__(self, template: Template, scene: SceneNow, mover: MovingRegion | None) -> None:
        super().__init__(template)
        self._mover, self._moving, self._kept = mover, 0, True
        self._rest, self._then = template.to_image, scene
        self._contrast_least = template.light_to_show(scene.contrast / SETTINGS.background_contrast) * scene.contrast
        self._inside = template.inside
        own = template.values.ravel()[self._inside]
        self._texture = own - np.float32(median(own))
        self._light = median(own), scene.light

    @property
    def seen(self) -> bool:
        """Whether the place is known and free in this frame."""
        return not self.result.lost

    def follow(self, frame: GreyFrame, scene: SceneNow) -> None:
        """Look whether it is to be seen in the next frame."""
        if self._moving < SETTINGS.background_moves_frames:
            self._look(frame, scene)
        if self._mover is None:
            return
        self._mover.follow(frame, scene)
        if self._moving < SETTINGS.background_moves_frames:
            # A part of an object that moves is seen all the time; what is found elsewhere after a loss is not it.
            self._kept = self._mover.aligned and (self._kept or not self.result.lost)
            clear = self._kept and self.result.lost and not self._mover.result.lost
            good = self._mover.result.quality >= SETTINGS.good_quality
            self._moving = self._moving + 1 if clear and good else 0
        if self._moving >= SETTINGS.background_moves_frames:
            self.result, self._to_image = self._mover.result, self._mover.motion @ self._template.to_image

    def _look(self, frame: GreyFrame, scene: SceneNow) -> None:
        if scene.change == "blank":
            self._lose(self._finding("tracking-frame-blank"), 0.0)
            return
        if scene.contrast < self._contrast_least:
            self._lose(self._finding("tracking-region-faint"), 0.0)
            return
        motion = scene.moved_since(self._then)
        if motion is None:
            self._lose(self._finding("tracking-scene-changed", found_share=0.0), 0.0)
            return
        self._to_image = motion @ self._rest
        roi = carried(self._first, self.motion)
        height, width = frame.shape
        x0, y0, x1, y1 = roi.bounds
        view = view_around(frame, self._template.shape, self._to_image, 2.0)
        if view is None:
            self._lose(self._finding("tracking-region-gone"), 0.0)
            return
        if x0 < 0 or y0 < 0 or x1 > width or y1 > height:
            self._lose(self._finding("tracking-region-at-border"), 0.0)
            return
        own = view.under(self._to_image, self._template.shape)[self._inside]
        covered = self._covered(own, scene)
        if covered > SETTINGS.covered_share:
            self._lose(self._finding("tracking-region-covered", covered_share=covered), 1 - covered, roi)
            return
        self._light = median(own), scene.light
        self.result = TrackedRoi(roi, 1 - covered, False)

    def look_again(self, frame: GreyFrame, scene: SceneNow, predicted: list[Matrix]) -> None:
        """Search it, if it is known to move."""
        if self._moving >= SETTINGS.background_moves_frames and self._mover is not None and not self._mover.seen:
            self._mover.look_again(frame, scene, predicted)
            self.result, self._to_image = self._mover.result, self._mover.motion @ self._template.to_image

    def learn(self, frame: GreyFrame) -> None:
        """Learn how what surrounds it looks."""
        if self._mover is not None:
            self._mover.learn(frame)

    def _covered(self, own: NDArray[np.float32], scene: SceneNow) -> float:
        """Share of its pixels before which something else is."""
        light, of_scene = self._light
        middle = median(own)
        noise = self._template.noise_dn
        expected = light * scene.light / max(of_scene, 1e-6)
        if abs(middle - expected) > SETTINGS.background_sudden_share * expected + SETTINGS.background_noise * noise:
            return 1.0
        most = SETTINGS.background_noise * noise + SETTINGS.background_share * middle
        return float(np.mean(np.abs(own - middle - self._texture * (middle / max(self._light[0], 1e-6))) > most))

    def _lose(self, reason: Finding, quality: float, roi: Roi | None = None) -> None:
        self.result = TrackedRoi(self.result.roi if roi is None else roi, quality, True, (reason,))
