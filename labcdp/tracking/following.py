"""Regions followed through a video, each by its own template, and with the help of the others."""

from __future__ import annotations

from collections.abc import Sequence
from math import dist, isnan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.result import Finding
from ..core.roi import Roi
from .followed import Followed, NotFollowedError, TrackedRoi
from .follower import Follower
from .geometry import Matrix, carried, inverse
from .scene import SceneNow, SceneWatch
from .settings import SETTINGS
from .sight import Levels, Sight, median, scale_of, view_around
from .template import Template, is_background, make_template, plain_template


class Resting(Followed):
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
    mover : Follower or None
        Follows the region with its surroundings, if these are enough.
    """

    def __init__(self, template: Template, scene: SceneNow, mover: Follower | None) -> None:
        super().__init__(template)
        self._mover, self._moving = mover, 0
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

    def follow(self, sight: Sight, scene: SceneNow) -> None:
        """Look whether it is to be seen in the next frame."""
        if self._moving < SETTINGS.background_moves_frames:
            self._look(sight, scene)
        if self._mover is None:
            return
        self._mover.follow(sight, scene)
        if self._moving < SETTINGS.background_moves_frames:
            clear = (
                self.result.lost and not self._mover.result.lost and self._mover.result.quality >= SETTINGS.good_quality
            )
            self._moving = self._moving + 1 if clear else 0
        if self._moving >= SETTINGS.background_moves_frames:
            self.result, self._to_image = self._mover.result, self._mover.motion @ self._template.to_image

    def _look(self, sight: Sight, scene: SceneNow) -> None:
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
        height, width = sight.shape
        x0, y0, x1, y1 = roi.bounds
        view = view_around(sight, self._template.shape, self._to_image, 2.0)
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

    def look_again(self, sight: Sight, scene: SceneNow, predicted: list[Matrix]) -> None:
        """Search it, if it is known to move."""
        if self._moving >= SETTINGS.background_moves_frames and self._mover is not None and not self._mover.seen:
            self._mover.look_again(sight, scene, predicted)
            self.result, self._to_image = self._mover.result, self._mover.motion @ self._template.to_image

    def learn(self, sight: Sight) -> None:
        """Learn how what surrounds it looks."""
        if self._mover is not None:
            self._mover.learn(sight)

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


class FollowingTracker:
    """Follows each region; a lost one is also searched at the position predicted by the others."""

    def __init__(self, grey: NDArray[Any], levels: Levels, rois: Sequence[Roi], planar: Sequence[bool]) -> None:
        black, usual, faint_dn = levels
        usual = 1.0 if isnan(usual) and grey.dtype == np.uint8 else usual
        scale = scale_of(grey, usual)
        step_dn = 1.0 if isnan(usual) else scale / usual
        self._levels = black, scale, step_dn, faint_dn * step_dn
        sight = Sight(grey, *self._levels)
        # Frames so narrow have no structure across.
        if min(sight.shape) * sight.reduction < 2:
            raise NotFollowedError(rois[0].name)
        self._scene = SceneWatch(sight)
        self._followers = tuple(
            _follower(sight, roi, self._scene, planar=flat) for roi, flat in zip(rois, planar, strict=True)
        )
        self._companions = Companions()
        # Motions of each region and each other one, from when both were last seen.
        self._together: dict[tuple[int, int], tuple[Matrix, Matrix]] = {}
        self._remember()

    def update(self, grey: NDArray[Any]) -> tuple[TrackedRoi, ...]:
        """Find the regions in the next frame; see `Tracker`."""
        sight = Sight(grey, *self._levels)
        scene = self._scene.look(sight)
        for follower in self._followers:
            follower.follow(sight, scene)
        self._keep_together(sight, scene)
        if scene.change != "blank":
            for number, follower in enumerate(self._followers):
                if not follower.seen:
                    follower.look_again(sight, scene, self._predicted_places(number))
        for follower in self._followers:
            follower.learn(sight)
        self._remember()
        return tuple(follower.result for follower in self._followers)

    def _keep_together(self, sight: Sight, scene: SceneNow) -> None:
        """Regions that moved together so far still do, unless they are clearly seen elsewhere."""
        moving = {number: one for number, one in enumerate(self._followers) if isinstance(one, Follower)}
        found = {number: step for number, one in moving.items() if (step := one.step) is not None}
        off = {(a, b): moving[a].off(moving[b].motion) for a in found for b in found if a != b}
        for a, b in self._companions.doubted(off):
            if moving[a].result.quality < moving[b].result.quality:
                moving[a].put_back(sight, scene, moving[b].motion)
        steps = {number: step for number, (step, _) in found.items()}
        for number in self._companions.jumped(steps, {number: expected for number, (_, expected) in found.items()}):
            moving[number].take_back("tracking-region-jumped")

    def _predicted_places(self, number: int) -> list[Matrix]:
        """Positions of a region predicted by the visible ones, nearest region first."""
        there = self._followers[number]
        near = sorted(
            (other for other, follower in enumerate(self._followers) if other != number and follower.seen),
            key=lambda other: np.hypot(*np.subtract(self._followers[other].result.roi.centre, there.result.roi.centre)),
        )
        predicted = []
        for other in near[:2]:
            if (number, other) in self._together:
                motion, of_other = self._together[number, other]
                predicted.append(self._followers[other].motion @ inverse(of_other) @ motion)
        return predicted

    def _remember(self) -> None:
        motions = {number: follower.motion for number, follower in enumerate(self._followers) if follower.seen}
        for a in motions:
            for b in motions:
                if a != b:
                    self._together[a, b] = motions[a], motions[b]


def _follower(sight: Sight, roi: Roi, scene: SceneWatch, *, planar: bool) -> Follower | Resting:
    """Follower of a region that its surroundings fix, or of a plain one that stays in the scene."""
    template = make_template(sight, roi)
    if (template is None or is_background(template)) and scene.holds:
        mover = None if template is None else Follower(sight, template, scene.now, planar=planar)
        return Resting(plain_template(sight, roi), scene.now, mover)
    if template is None:
        raise NotFollowedError(roi.name)
    return Follower(sight, template, scene.now, planar=planar)


class Companions:
    """Watches the steps of regions against each other."""

    def __init__(self) -> None:
        self._apart: dict[tuple[int, int], float] = {}
        self._off: dict[tuple[int, int], float] = {}

    def jumped(self, steps: dict[int, tuple[float, float]], expected: dict[int, tuple[float, float]]) -> set[int]:
        """Which regions jumped against one they moved with.

        Parameters
        ----------
        steps : dict of int to (float, float)
            Steps in pixels since the frame before of the regions seen in both.
        expected : dict of int to (float, float)
            The steps that were expected of them.

        Returns
        -------
        set of int
            Of two such regions the one whose step was expected less.
        """
        jumped = set()
        for a in steps:
            for b in steps:
                if a >= b:
                    continue
                apart = dist(steps[a], steps[b])
                usual = self._apart.get((a, b))
                if usual is not None and usual < SETTINGS.together_px and apart > SETTINGS.jump_px + usual:
                    off = {key: dist(steps[key], expected[key]) for key in (a, b)}
                    jumped.add(max(off, key=lambda key: off[key]))
                    continue
                self._apart[a, b] = apart if usual is None else usual + SETTINGS.together_rate * (apart - usual)
        return jumped

    def doubted(self, off: dict[tuple[int, int], float]) -> list[tuple[int, int]]:
        """Which pairs, moved as one thing until now, do so no longer.

        Parameters
        ----------
        off : dict of (int, int) to float
            Pixels from where the second region's motion since the first frame carries the first one to where it is.

        Returns
        -------
        list of (int, int)
            Such pairs.
        """
        doubted = []
        for pair, this in off.items():
            usual = self._off.get(pair, this)
            if usual < SETTINGS.together_px and this > SETTINGS.doubt_px + SETTINGS.doubt_usual * usual:
                doubted.append(pair)
            self._off[pair] = usual + SETTINGS.together_rate * (this - usual)
        return doubted
