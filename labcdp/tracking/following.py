"""Regions followed through a video, each by its own template, and with the help of the others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..roi import Roi
from .follower import Follower
from .geometry import Matrix, inverse
from .pairs import Companions
from .scene import SceneWatch
from .tracker import TrackedRoi, grey_frame


class FollowingTracker:
    """Follows each region; one that is lost is also looked for where the others say it should be."""

    def __init__(self, method: str, grey: NDArray[np.uint8], rois: Sequence[Roi]) -> None:
        self._shape = (grey.shape[0], grey.shape[1])
        self._followers = tuple(Follower(method, grey, roi) for roi in rois)
        self._scene = SceneWatch(grey)
        self._companions = Companions()
        # Motions of each region and each other one, from when both were last seen.
        self._together: dict[tuple[int, int], tuple[Matrix, Matrix]] = {}
        self._remember()

    def update(self, grey: NDArray[np.uint8]) -> tuple[TrackedRoi, ...]:
        """Find the regions in the next frame; see `Tracker`."""
        frame = grey_frame(grey, self._shape)
        change = self._scene.look(frame)
        for follower in self._followers:
            follower.follow(frame, change)
        self._keep_together()
        if change != "blank":
            for number, follower in enumerate(self._followers):
                if not follower.seen:
                    follower.look_again(frame, self._told(number))
        self._remember()
        return tuple(follower.result for follower in self._followers)

    def _keep_together(self) -> None:
        found = {number: step for number, follower in enumerate(self._followers) if (step := follower.step) is not None}
        steps = {number: step for number, (step, _) in found.items()}
        for number in self._companions.jumped(steps, {number: expected for number, (_, expected) in found.items()}):
            self._followers[number].take_back("it jumped away from the region it moved with")

    def _told(self, number: int) -> list[Matrix]:
        """Where the regions that are seen say that another one is, nearest region first."""
        there = self._followers[number]
        near = sorted(
            (other for other, follower in enumerate(self._followers) if other != number and follower.seen),
            key=lambda other: np.hypot(*np.subtract(self._followers[other].result.roi.centre, there.result.roi.centre)),
        )
        told = []
        for other in near[:2]:
            if (number, other) in self._together:
                motion, of_other = self._together[number, other]
                told.append(self._followers[other].motion @ inverse(of_other) @ motion)
        return told

    def _remember(self) -> None:
        motions = {number: follower.motion for number, follower in enumerate(self._followers) if follower.seen}
        for a in motions:
            for b in motions:
                if a != b:
                    self._together[a, b] = motions[a], motions[b]
