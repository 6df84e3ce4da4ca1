"""Regions followed together: a lost one is also searched where the others put it."""

from __future__ import annotations

from collections.abc import Sequence
from math import dist, isnan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.roi import Roi
from .background import BackgroundRegion
from .frame import GreyFrame, Levels, scale_of
from .geometry import Matrix, inverse
from .region import MovingRegion
from .scene import SceneMotion, SceneNow
from .settings import SETTINGS
from .template import is_background, make_template, plain_template
from .tracked_roi import NotFollowedError, TrackedRoi


class RegionGroup:
    """Follows each region; a lost one is also searched at the position predicted by the others."""

    def __init__(self, grey: NDArray[Any], levels: Levels, rois: Sequence[Roi], planar: Sequence[bool]) -> None:
        black, usual, faint_dn = levels
        usual = 1.0 if isnan(usual) and grey.dtype == np.uint8 else usual
        scale = scale_of(grey, usual)
        step_dn = 1.0 if isnan(usual) else scale / usual
        self._levels = black, scale, step_dn, faint_dn * step_dn
        frame = GreyFrame(grey, *self._levels)
        # Frames so narrow have no structure across.
        if min(frame.shape) * frame.reduction < 2:
            raise NotFollowedError(rois[0].name)
        self._scene = SceneMotion(frame)
        self._followers = tuple(
            _follower(frame, roi, self._scene, planar=flat) for roi, flat in zip(rois, planar, strict=True)
        )
        self._companions = Companions()
        # Motions of each region and each other one, from when both were last seen.
        self._together: dict[tuple[int, int], tuple[Matrix, Matrix]] = {}
        self._remember()

    def update(self, grey: NDArray[Any]) -> tuple[TrackedRoi, ...]:
        """Find the regions in the next frame; see `Tracker`."""
        frame = GreyFrame(grey, *self._levels)
        scene = self._scene.look(frame)
        for follower in self._followers:
            follower.follow(frame, scene)
        self._keep_together(frame, scene)
        if scene.change != "blank":
            for number, follower in enumerate(self._followers):
                if not follower.seen:
                    follower.look_again(frame, scene, self._predicted_places(number))
        for follower in self._followers:
            follower.learn(frame)
        self._remember()
        return tuple(follower.result for follower in self._followers)

    def _keep_together(self, frame: GreyFrame, scene: SceneNow) -> None:
        """Regions that moved together so far still do, unless they are clearly seen elsewhere."""
        moving = {number: one for number, one in enumerate(self._followers) if isinstance(one, MovingRegion)}
        steps_seen = {number: step for number, one in moving.items() if (step := one.step) is not None}
        off = {(a, b): moving[a].off(moving[b].motion) for a in steps_seen for b in steps_seen if a != b}
        for a, b in self._companions.doubted(off):
            if moving[a].result.quality < moving[b].result.quality:
                moving[a].put_back(frame, scene, moving[b].motion)
        steps = {number: step for number, (step, _) in steps_seen.items()}
        for number in self._companions.jumped(
            steps, {number: expected for number, (_, expected) in steps_seen.items()}
        ):
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


def _follower(frame: GreyFrame, roi: Roi, scene: SceneMotion, *, planar: bool) -> MovingRegion | BackgroundRegion:
    """MovingRegion of a region that its surroundings fix, or of a plain one that stays in the scene."""
    template = make_template(frame, roi)
    if (template is None or is_background(template)) and scene.holds:
        mover = None if template is None else MovingRegion(frame, template, scene.now, planar=planar)
        return BackgroundRegion(plain_template(frame, roi), scene.now, mover)
    if template is None:
        raise NotFollowedError(roi.name)
    return MovingRegion(frame, template, scene.now, planar=planar)


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
