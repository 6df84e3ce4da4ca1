"""One region followed from frame to frame."""

from __future__ import annotations

from dataclasses import replace
from math import dist, isfinite
from typing import TypeGuard

import numpy as np
from numpy.typing import NDArray

from ..roi import Roi
from .alignment import Aligner, Fit
from .geometry import Matrix, carried, inverse, local_scale, moved, scaling, shift
from .movers import make_mover
from .place_kernel import shape_change
from .repeats import repeat_px
from .search import candidates
from .template import make_template
from .tracker import TrackedRoi
from .view import View, view_around

#: Quality below which a region is lost, and from which it is found again.
LOST_BELOW, FOUND_FROM = 0.55, 0.75
#: Quality at which no other guess is tried.
_GOOD = 0.85
#: Share of a region whose own pixels may differ before nothing is to be measured in it.
COVERED_MOST = 0.05
#: Share of its outline that may lose its edges at once: the edge to a neighbour stays if it vanishes.
VANISHED_MOST = 0.62
#: Where several places look the same: distance from the expected one, in parts of that to the next one, at which none
#: is taken; and the same after a loss of at most so many frames.
_NEAR, _NEAR_AGAIN, _SOON = 0.5, 0.25, 2
_SAME = "several places look the same"
#: Share of the template that must lie in the image.
_IN_IMAGE_LEAST = 0.4
#: Largest change of size from frame to frame, and over all.
_SIZE_STEP, _SIZE_LEAST, _SIZE_MOST = 1.25, 0.2, 6.0
#: Largest change of its shape from frame to frame: stretched, turned (rad), tilted (perspective over half its size).
_STRETCH_STEP, _TURN_STEP, _TILT_STEP = 1.1, 0.25, 0.05
#: Pixels around the expected place that are looked at: in parts of the window, and at least.
_REACH, _REACH_LEAST = 0.5, 24.0
#: Share of the last step in the motion that is expected next.
_LAST_STEP = 0.6


class Follower:
    """Finds one region in frame after frame.

    In each frame a guess (the motion so far, and what the method's mover says) is aligned with the first frame's
    template. If too little of it is found again, the surroundings are searched.
    """

    def __init__(self, method: str, grey: NDArray[np.uint8], roi: Roi) -> None:
        self._first = roi
        self._template = make_template(grey, roi)
        self._repeat_px = repeat_px(grey, self._template)
        self._aligner = Aligner(self._template, planar=method == "homography")
        self._mover = make_mover(method, self._template)
        self._from_first = inverse(self._template.to_image)
        height, width = self._template.shape
        # Template pixels to coordinates of -1 to 1 along its longer side.
        self._to_centred = scaling(2 / max(width, height)) @ shift(-width / 2, -height / 2)
        self._to_image = self._template.to_image
        self._velocity = (0.0, 0.0)
        self._light = (1.0, 0.0)
        self._lost_for = 0
        self._held: Matrix | None = None
        self._before: tuple[Matrix, tuple[float, float]] | None = None
        self._before_roi = roi
        self._result = TrackedRoi(roi, 1.0, False, "")
        view = self._view(grey, self._to_image)
        if view is not None:
            self._mover.settle(view, view.from_image @ self._to_image)

    @property
    def seen(self) -> bool:
        """Whether the place is known in this frame."""
        return self._lost_for == 0

    @property
    def motion(self) -> Matrix:
        """Pixels of the first frame to those of the frame in which it was last seen."""
        moved: Matrix = self._to_image @ self._from_first
        return moved

    @property
    def step(self) -> tuple[tuple[float, float], tuple[float, float]] | None:
        """Its last step in pixels and the one that was expected; None if it was not seen in this frame and before."""
        if self._before is None:
            return None
        to_image, velocity = self._before
        (x, y), (u, v) = self._middle(self._to_image), self._middle(to_image)
        return (x - u, y - v), velocity

    def take_back(self, reason: str) -> None:
        """Say that it is lost although it was found in this frame."""
        if self._before is not None:
            self._to_image, self._velocity = self._before
            self._lose(reason, self._result.quality, self._before_roi)

    def follow(self, grey: NDArray[np.uint8], change: str) -> None:
        """Look for it in the next frame; `change` is what became of the scene as a whole."""
        self._before = None
        if change == "blank":
            # What cannot be seen for a moment is not given up.
            self._result = TrackedRoi(self._result.roi, 0.0, True, "the frame is blank")
            if isfinite(self._repeat_px):
                self._lost_for += 1
            return
        if not self.seen:
            self._lost_for += 1
            self._result = replace(self._result, quality=0.0)
            return
        need = FOUND_FROM if change == "cut" else LOST_BELOW
        middle = self._middle(self._to_image)
        expected = shift(*self._velocity) @ self._to_image
        view = self._view(grey, expected)
        if view is None:
            self._lose("it left the image", 0.0)
            return
        best = self._best(view, expected, need)
        if best is None or best.quality < need:
            found = f"{best.quality:.0%}" if best is not None else "nothing"
            why = "the scene changed at once, and " if change == "cut" else ""
            self._lose(f"{why}{found} of the structure around it is found again", best.quality if best else 0.0)
            return
        if self._off(best, expected) > _NEAR:
            self._lose(_SAME, best.quality)
            return
        gone = self._aligner.vanished(best)
        if gone > VANISHED_MOST:
            self._lose(
                f"{gone:.0%} of its outline have lost their edges: it vanished, or something covers it", best.quality
            )
            return
        before, self._before_roi = (self._to_image, self._velocity), self._result.roi
        self._accept(view, best, middle)
        self._before = before

    def look_again(self, grey: NDArray[np.uint8], told: list[Matrix]) -> None:
        """Look for it after it was lost: where it was, and where its motion `told` by others puts it."""
        places = [motion @ self._template.to_image for motion in told]
        if self._held is not None:
            places.insert(0, self._held)
        for place in places:
            view = self._view(grey, place)
            fit = None if view is None else self._aligner.align(view, view.from_image @ place, self._light)
            if view is not None and self._again(fit) and self._off(fit, place) < _NEAR:
                self._hold(view, fit)
                return
        self._held = None
        if isfinite(self._repeat_px):
            self._look_near(grey)
            return
        view = self._view(grey, self._to_image, min(1 + 0.25 * self._lost_for, 3.0))
        if view is None:
            return
        fits = [self._aligner.align(view, guess, self._light) for guess in candidates(view, self._template, 3)]
        good = [fit for fit in fits if self._again(fit)]
        if good:
            self._hold(view, max(good, key=lambda fit: fit.quality))

    def _look_near(self, grey: NDArray[np.uint8]) -> None:
        """Look for one of several places that look the same: soon after the loss it can only be the nearest one."""
        view = self._view(grey, self._to_image) if self._lost_for <= _SOON else None
        fit = None
        if view is not None:
            fit = self._aligner.align(view, view.from_image @ self._to_image, self._light)
            if self._again(fit) and self._off(fit, self._to_image) < _NEAR_AGAIN:
                self._hold(view, fit)
                return
        if _SAME not in self._result.reason:
            self._result = replace(self._result, reason=f"{self._result.reason}; {_SAME}")

    def _again(self, fit: Fit | None) -> TypeGuard[Fit]:
        """Whether a fit is good enough to take the region for found after a loss."""
        return (
            fit is not None
            and fit.quality >= FOUND_FROM
            and self._possible(fit)
            and self._aligner.vanished(fit) <= VANISHED_MOST
        )

    def _off(self, fit: Fit, expected: Matrix) -> float:
        """Distance of a fit from the `expected` place over that to the next place that looks the same."""
        if not isfinite(self._repeat_px):
            return 0.0
        height, width = self._template.shape
        scale = local_scale(expected, (width / 2, height / 2)) * self._template.reduction
        return dist(self._middle(fit.to_image), self._middle(expected)) / (scale * self._repeat_px)

    @property
    def result(self) -> TrackedRoi:
        """What is to be told of this frame."""
        return self._result

    def _hold(self, view: View, fit: Fit) -> None:
        """Take it for found if it is seen in two frames in a row."""
        place = fit.to_image
        if self._held is None:
            self._held = place
            return
        self._held = None
        self._velocity = (0.0, 0.0)
        self._accept(view, fit, self._middle(place))

    def _best(self, view: View, expected: Matrix, need: float) -> Fit | None:
        """Best alignment from the expected place, the mover's proposal, and if need be a search."""
        guess = view.from_image @ expected
        proposal = self._mover.propose(view, guess)
        starts = [guess] if proposal is None else [proposal, guess]
        if isfinite(self._repeat_px):
            starts.reverse()
        best: Fit | None = None
        for start in starts:
            best = self._better(expected, best, self._aligner.align(view, start, self._light))
            if best is not None and best.quality - self._off(best, expected) >= _GOOD:
                return best
        for start in candidates(view, self._template, 2):
            best = self._better(expected, best, self._aligner.align(view, start, self._light))
        return best

    def _better(self, expected: Matrix, best: Fit | None, other: Fit | None) -> Fit | None:
        """Of two fits the better one, and of places that look the same the one nearer to the `expected` place."""
        if other is None or not self._possible(other):
            return best
        if best is None:
            return other
        gained = self._off(best, expected) - self._off(other, expected)
        return other if other.quality + gained > best.quality else best

    def _possible(self, fit: Fit) -> bool:
        """Whether the target can have got there: not suddenly of another size, and in the image."""
        if fit.in_image < _IN_IMAGE_LEAST:
            return False
        long, short, turned, tilted = shape_change(self._to_image, fit.to_image, self._to_centred)
        size = (long * short) ** 0.5
        frames = 1 + min(self._lost_for, 3)
        height, width = self._template.shape
        over_all = local_scale(fit.to_image, (width / 2, height / 2)) * self._template.reduction
        return (
            1 / _SIZE_STEP**frames < size < _SIZE_STEP**frames
            and long < _STRETCH_STEP**frames * short
            and abs(turned) < _TURN_STEP * frames
            and tilted < _TILT_STEP * frames
            and _SIZE_LEAST < over_all < _SIZE_MOST
        )

    def _accept(self, view: View, fit: Fit, middle: tuple[float, float]) -> None:
        self._mover.settle(view, fit.to_view)
        self._to_image = fit.to_image
        (x, y), (u, v) = self._middle(self._to_image), self._velocity
        self._velocity = (
            _LAST_STEP * (x - middle[0]) + (1 - _LAST_STEP) * u,
            _LAST_STEP * (y - middle[1]) + (1 - _LAST_STEP) * v,
        )
        self._lost_for = 0
        self._light = fit.light
        if fit.covered <= COVERED_MOST:
            self._aligner.learn(fit)
        roi = carried(self._first, self.motion)
        height, width = view.image_shape
        x0, y0, x1, y1 = roi.bounds
        if x0 < 0 or y0 < 0 or x1 > width or y1 > height:
            self._result = TrackedRoi(self._result.roi, fit.quality, True, "it leaves the image")
        elif fit.covered > COVERED_MOST:
            why = f"{fit.covered:.0%} of its own pixels differ from the rest: something covers it"
            self._result = TrackedRoi(roi, fit.quality, True, why)
        else:
            self._result = TrackedRoi(roi, fit.quality, False, "")

    def _lose(self, reason: str, quality: float, roi: Roi | None = None) -> None:
        self._lost_for += 1
        self._held = None
        self._result = TrackedRoi(self._result.roi if roi is None else roi, quality, True, reason)

    def _middle(self, to_image: Matrix) -> tuple[float, float]:
        height, width = self._template.shape
        return moved(to_image, width / 2, height / 2)

    def _view(self, grey: NDArray[np.uint8], to_image: Matrix, wider: float = 1.0) -> View | None:
        height, width = self._template.shape
        size = max(self._template.shape) * local_scale(to_image, (width / 2, height / 2))
        return view_around(grey, self._template, to_image, wider * max(_REACH * size, _REACH_LEAST))
