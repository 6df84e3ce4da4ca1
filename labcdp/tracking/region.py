"""One region followed from frame to frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from enum import Enum
from math import dist, hypot, isfinite

from ..core.result import Finding
from ..core.roi import Roi
from .alignment import Fit
from .appearance import Appearance, Match, shape_allows
from .correlation import Response
from .frame import GreyFrame, view_around
from .geometry import Matrix, carried, local_scale, shift
from .scene import SceneNow
from .settings import SETTINGS
from .template import Template
from .tracked_roi import RegionState, TrackedRoi

_SAME = "tracking-places-alike"
_LEFT = ("tracking-region-gone", "tracking-region-at-border")


class State(Enum):
    """State of a region in a frame; `docs/concepts/tracking.md` draws them."""

    SEEN = "its position is confirmed"
    HIDDEN = "its position is known, but nothing is to be measured there"
    LOST = "its position is not known"
    SIGHTED = "it may be seen again, and is if the next frame agrees"


class MovingRegion(RegionState):
    """Finds one region in frame after frame.

    In each frame the expected positions (by its motion so far, and at rest with the scene) are aligned with the first
    look. If too little of it is found again, the correlation filter decides: it sees the region, or the whole frame is
    searched.
    """

    def __init__(self, frame: GreyFrame, template: Template, scene: SceneNow, *, planar: bool) -> None:
        super().__init__(template)
        self._velocity, self._light, self._quality = (0.0, 0.0), (1.0, 0.0), 1.0
        self._found: Match | None = None
        self._left, self._lost_for = False, 0
        self._held: Matrix | None = None
        self._before: tuple[Matrix, tuple[float, float]] | None = None
        self._before_roi = template.roi
        self._rest = self._to_image, scene
        self._expected_light = self._light
        self._appearance = Appearance(frame, template, planar=planar)
        self._appearance.find_repeats(frame, self._possible)

    @property
    def state(self) -> State:
        """Its state in this frame."""
        if self._lost_for > 0:
            return State.LOST if self._held is None else State.SIGHTED
        return State.HIDDEN if self.result.lost else State.SEEN

    @property
    def seen(self) -> bool:
        """Whether its position is known in this frame."""
        return self.state in (State.SEEN, State.HIDDEN)

    @property
    def aligned(self) -> bool:
        """Whether it was seen in this frame as it looked before."""
        return self._found is not None and self._found.response is None

    @property
    def step(self) -> tuple[tuple[float, float], tuple[float, float]] | None:
        """Its last step in pixels and the one that was expected; None if it was not seen in this frame and before."""
        if self._before is None:
            return None
        to_image, velocity = self._before
        (x, y), (u, v) = self._appearance.middle(self._to_image), self._appearance.middle(to_image)
        return (x - u, y - v), velocity

    def take_back(self, code: str) -> None:
        """Take it for lost, with the code of the reason, although it was found in this frame."""
        if self._before is not None:
            self._to_image, self._velocity = self._before
            self._lose(self._finding(code), self.result.quality, self._before_roi)

    def follow(self, frame: GreyFrame, scene: SceneNow) -> None:
        """Look for it in the next frame."""
        self._before, self._found = None, None
        self._expected_light = self._light_in(scene)
        if scene.change == "blank":
            # What cannot be seen for a moment is not given up.
            self.result = TrackedRoi(self.result.roi, 0.0, True, (self._finding("tracking-frame-blank"),))
            if isfinite(self._appearance.repeat_px):
                self._lost_for += 1
            return
        if not self.seen:
            self._lost_for += 1
            self.result = replace(self.result, quality=0.0)
            return
        match = self._best(frame, scene)
        if match is None or (match.response is None and match.fit.quality < SETTINGS.lost_quality):
            quality = 0.0 if match is None else match.fit.quality
            gone = view_around(frame, self._template.shape, next(self._expected(scene)), 0) is None
            code = "tracking-scene-changed" if scene.change == "cut" else "tracking-not-found"
            reason = self._finding("tracking-region-gone") if gone else self._finding(code, found_share=float(quality))
            self._lose(reason, quality)
            return
        if all(self._appearance.off(match.fit, position) > SETTINGS.alike_share for position in self._expected(scene)):
            self._lose(self._finding(_SAME), match.fit.quality)
            return
        lost = match.aligner.vanished(match.fit) if match.response is None else 0.0
        if lost > SETTINGS.outline_lost_share and not self._agrees(frame, match, SETTINGS.filter_again):
            self._lose(self._finding("tracking-outline-lost", lost_share=float(lost)), match.fit.quality)
            return
        before, self._before_roi = (self._to_image, self._velocity), self.result.roi
        self._accept(frame, scene, match)
        self._before = before

    def look_again(self, frame: GreyFrame, scene: SceneNow, predicted: list[Matrix]) -> None:
        """Look for it after it was lost: where it was, where its motion `predicted` by others puts it, everywhere."""
        companions = [motion @ self._template.to_image for motion in predicted]
        expected = [*companions, *self._expected(scene)]
        if self._held is not None:
            expected.insert(0, self._held)
        tried = [
            (position, match)
            for position in expected
            if (match := self._aligned(frame, position)) and self._again(match)
        ]
        for position, match in tried:
            near = dist(
                self._appearance.middle(match.fit.to_image), self._appearance.middle(position)
            ) < self._appearance.reach(position)
            certain = (
                any(position is one for one in companions)
                or position is self._held
                or match.fit.quality >= SETTINGS.good_quality
            )
            if near and certain and self._sure(match, position, known=any(position is one for one in companions)):
                self._again_from(frame, scene, match)
                return
        everywhere = [match for match in self._everywhere(frame) if self._again(match)]
        best = self._appearance.clear(everywhere)
        if best is None and not tried:
            self._again_by_filter(frame, scene, expected)
            return
        match = best or max((match for _, match in tried), key=lambda one: one.fit.quality)
        if not self._sure(match, expected[-1], known=False):
            self._held = None
            self._say_alike()
        elif (match.fit.quality >= SETTINGS.good_quality and self._lit(match.fit)) or (
            self._held_at(match.fit) and self._within(match)
        ):
            self._again_from(frame, scene, match)
        else:
            self._held = match.fit.to_image

    def _again_by_filter(self, frame: GreyFrame, scene: SceneNow, expected: list[Matrix]) -> None:
        """Take the region for found where the first filter sees it twice in a row, and nowhere else."""
        held, self._held = self._held, None
        if isfinite(self._appearance.repeat_px):
            return
        correlation = self._appearance.filter
        positions = [*expected, *self._appearance.candidates(frame, self._to_image)]
        responses = [one for position in positions if (one := correlation.glance(frame, position)) is not None]
        best = max(responses, key=lambda one: one.first, default=None)
        if best is None or best.first < SETTINGS.filter_first:
            return
        best = correlation.locate(frame, best.to_image) or best
        if best.first < SETTINGS.filter_again or best.inner < SETTINGS.filter_inner:
            return
        apart = [one.first for one in responses if self._apart(one.to_image, best.to_image) > 1]
        if best.first < max(apart, default=0.0) + SETTINGS.lead_quality:
            return
        if held is None or self._apart(held, best.to_image) > 1:
            self._held = best.to_image
            return
        match = self._appearance.by_filter(frame, best, self._expected_light, 0.0)
        if match is not None:
            self._again_from(frame, scene, match)

    def _again_from(self, frame: GreyFrame, scene: SceneNow, match: Match) -> None:
        self._held = None
        self._velocity = (0.0, 0.0)
        self._to_image = match.fit.to_image
        self._appearance.begin_again()
        self._accept(frame, scene, match)

    def _held_at(self, fit: Fit) -> bool:
        """Whether it was seen near this place in the frame before."""
        return self._held is not None and dist(
            self._appearance.middle(self._held), self._appearance.middle(fit.to_image)
        ) < self._appearance.reach(self._held)

    def _within(self, match: Match) -> bool:
        """Whether it can have got there meanwhile by its usual motion."""
        moved = dist(self._appearance.middle(match.fit.to_image), self._appearance.middle(self._to_image))
        frames = min(self._lost_for, SETTINGS.back_frames) if self._left else self._lost_for
        return moved < self._appearance.reach(self._to_image) + frames * (hypot(*self._velocity) + 1)

    def _say_alike(self) -> None:
        if all(one.code != _SAME for one in self.result.reasons):
            self.result = replace(self.result, reasons=(*self.result.reasons, self._finding(_SAME)))

    def _sure(self, match: Match, expected: Matrix, *, known: bool) -> bool:
        """Whether a place found after a loss can be no other one that looks the same."""
        if self._left and not known and not self._within(match):
            return False
        off = self._appearance.off(match.fit, expected)
        if known or off == 0:
            return off < SETTINGS.alike_share
        speed = hypot(*self._velocity) + 1
        scale = local_scale(expected, self._appearance.centre) * self._template.reduction
        # Of a pattern that fills the frame the scene seems to move by a part of its distances, too.
        if self._appearance.off(match.fit, self._to_image) > SETTINGS.alike_share:
            return False
        return (
            off < SETTINGS.alike_again_share
            and self._lost_for * speed < SETTINGS.alike_moved_share * scale * self._appearance.repeat_px
        )

    def _light_in(self, scene: SceneNow) -> tuple[float, float]:
        """Light that is expected of it: the one it had, less or more of it where the scene's changed."""
        change = scene.light_over(self._rest[1])
        return self._light[0] * change, self._light[1] * change

    def _lit(self, fit: Fit) -> bool:
        """Whether its light is about the expected one."""
        return 1 / SETTINGS.again_light < fit.light[0] / self._expected_light[0] < SETTINGS.again_light

    def _again(self, match: Match) -> bool:
        """Whether a fit is good enough to take the region for found after a loss."""
        # What changes its looks is more easily taken for another thing.
        need = (
            min(
                max(self._appearance.usual - SETTINGS.below_usual_quality, SETTINGS.search_quality),
                SETTINGS.good_quality,
            )
            if self._appearance.usual > SETTINGS.changing_quality
            else SETTINGS.changing_again_quality
        )
        return match.fit.quality >= need and match.aligner.vanished(match.fit) <= SETTINGS.outline_lost_share

    def _expected(self, scene: SceneNow) -> Iterator[Matrix]:
        """Where it should be: as it moves, and at rest with the scene."""
        moving = shift(*self._velocity) @ self._to_image if self.seen else self._to_image
        yield moving
        rest, then = self._rest
        at_rest = None if (motion := scene.moved_since(then)) is None else motion @ rest
        if at_rest is not None and dist(self._appearance.middle(at_rest), self._appearance.middle(moving)) > 1:
            yield at_rest

    def _best(self, frame: GreyFrame, scene: SceneNow) -> Match | None:
        """Best alignment from the expected positions, or what the filter finds there, or a search finds anywhere."""
        best: Match | None = None
        moving = next(self._expected(scene))
        for position in self._expected(scene):
            best = self._appearance.better(moving, best, self._aligned(frame, position))
            if best is not None and best.fit.quality - self._appearance.off(best.fit, moving) >= SETTINGS.good_quality:
                return self._doubted(frame, best) if self._appearance.doubted else best
        if scene.change == "cut":
            return self._elsewhere(frame, None)
        response = self._appearance.filter.locate(frame, moving)
        if response is not None and self._seen_by_filter(response):
            return self._refined(frame, best, response)
        if best is not None and not self._agrees(frame, best, SETTINGS.filter_agrees):
            best = None
        least = max(self._quality - SETTINGS.steady_quality, SETTINGS.lost_quality)
        if best is not None and best.fit.quality >= least:
            return best
        return self._elsewhere(frame, best)

    def _doubted(self, frame: GreyFrame, aligned: Match) -> Match:
        """Return what the filter sees, if that is elsewhere and more like the region than the position of the fit."""
        here = aligned.fit.to_image
        response = self._appearance.filter.locate(frame, here)
        if response is None or not self._seen_by_filter(response) or not self._better(frame, response, here):
            return aligned
        return self._refined(frame, None, response) or aligned

    def _better(self, frame: GreyFrame, response: Response, position: Matrix) -> bool:
        """Whether the region itself is clearly more alike where the filter sees it than at another position."""
        if self._apart(response.to_image, position) < SETTINGS.filter_moved:
            return False
        there = self._appearance.filter.respond(frame, position)
        return there is None or response.inner >= there.inner + SETTINGS.lead_quality

    def _seen_by_filter(self, response: Response) -> bool:
        return response.first >= SETTINGS.filter_first and response.recent >= SETTINGS.filter_recent

    def _refined(self, frame: GreyFrame, best: Match | None, response: Response) -> Match | None:
        """Alignment where the filter sees the region, if it fits, or else the filter's position."""
        fits = [one for one in (best, self._aligned(frame, response.to_image)) if one is not None]
        near = [one for one in fits if self._apart(one.fit.to_image, response.to_image) < SETTINGS.filter_near]
        aligned = max(near, key=lambda one: one.fit.quality, default=None)
        if aligned is not None and aligned.fit.quality >= SETTINGS.filter_fit_quality:
            return aligned
        # What does not change its looks is rather somewhere else.
        if not self._appearance.changes and (clear := self._elsewhere(frame, None)) is not None:
            return clear
        quality = 0.0 if aligned is None else aligned.fit.quality
        match = self._appearance.by_filter(frame, response, self._expected_light, quality)
        if match is not None and not self._possible(match.fit):
            match = None
        return match or aligned

    def _apart(self, a: Matrix, b: Matrix) -> float:
        """Distance of two positions in parts of the region's size."""
        size: float = self._first.area**0.5 * local_scale(a, self._appearance.centre) * self._template.reduction
        return dist(self._appearance.middle(a), self._appearance.middle(b)) / size

    def _agrees(self, frame: GreyFrame, match: Match, least: float) -> bool:
        """Whether the filter sees the region where a fit puts it."""
        response = self._appearance.filter.respond(frame, match.fit.to_image)
        return response is not None and response.first >= least

    def _elsewhere(self, frame: GreyFrame, near: Match | None) -> Match | None:
        """Search the whole frame, against what is near; None if it is not clear which is the region."""
        others = [match for match in self._everywhere(frame) if self._again(match)]
        clear = self._appearance.clear([*others, near] if near is not None else others)
        if clear is not None and clear.fit.quality >= SETTINGS.search_quality:
            return clear if clear is near or self._lit(clear.fit) else near
        return None if others else near

    def _aligned(self, frame: GreyFrame, position: Matrix) -> Match | None:
        return self._appearance.aligned(frame, position, self._expected_light, self._possible)

    def _everywhere(self, frame: GreyFrame) -> list[Match]:
        return self._appearance.everywhere(frame, self._to_image, self._expected_light, self._possible)

    def _possible(self, fit: Fit) -> bool:
        """Whether the target can have got there: not suddenly of another size, and in the image."""
        return shape_allows(self._template, self._to_image, fit, 1 + min(self._lost_for, 3))

    def _accept(self, frame: GreyFrame, scene: SceneNow, match: Match) -> None:
        fit = match.fit
        (x, y), (u, v) = self._appearance.middle(self._to_image), self._velocity
        self._to_image = fit.to_image
        here = self._appearance.middle(self._to_image)
        self._velocity = (
            SETTINGS.velocity_rate * (here[0] - x) + (1 - SETTINGS.velocity_rate) * u,
            SETTINGS.velocity_rate * (here[1] - y) + (1 - SETTINGS.velocity_rate) * v,
        )
        self._lost_for = 0
        self._light, self._quality = fit.light, fit.quality
        self._rest = self._to_image, scene
        self._found = match
        roi = carried(self._first, self.motion)
        height, width = frame.shape
        x0, y0, x1, y1 = roi.bounds
        if x0 < 0 or y0 < 0 or x1 > width or y1 > height:
            border = self._finding("tracking-region-at-border")
            self.result = TrackedRoi(self.result.roi, fit.quality, True, (border,))
        elif fit.covered > SETTINGS.covered_share:
            reason = self._finding("tracking-region-covered", covered_share=float(fit.covered))
            self.result = TrackedRoi(roi, fit.quality, True, (reason,))
        elif fit.light[0] < self._template.shown_from:
            # What is learnt of a place must be certain.
            self._found = None
            self.result = TrackedRoi(roi, fit.quality, True, (self._finding("tracking-region-faint"),))
        else:
            self.result = TrackedRoi(roi, fit.quality, False)

    def off(self, motion: Matrix) -> float:
        """Pixels from where a `motion` since the first frame carries its middle to where it is."""
        return dist(self._appearance.middle(motion @ self._template.to_image), self._appearance.middle(self._to_image))

    def put_back(self, frame: GreyFrame, scene: SceneNow, motion: Matrix) -> bool:
        """Put it where a `motion` since the first frame carries it, if it fits there about as well; whether it does."""
        if self._before is None or self._found is None:
            return False
        position = motion @ self._template.to_image
        view = view_around(frame, self._template.shape, position, self._appearance.reach(position))
        fit = None if view is None else self._found.aligner.align(view, position, self._expected_light, improve=False)
        if fit is None or fit.quality < self._found.fit.quality - SETTINGS.as_good_quality or not self._possible(fit):
            return False
        before = self._before
        self._to_image, self._velocity = before
        self._accept(frame, scene, Match(fit, self._found.aligner, fit.quality))
        self._before = before
        return True

    def learn(self, frame: GreyFrame) -> None:
        """Learn from what was found in this frame."""
        match, self._found = self._found, None
        if match is not None and self.seen:
            self._appearance.learn(frame, match)

    def _lose(self, reason: Finding, quality: float, roi: Roi | None = None) -> None:
        self._lost_for += 1
        self._held = None
        # Out of the image it went on one side, and comes back there.
        self._left = reason.code in _LEFT or any(one.code in _LEFT for one in self.result.reasons)
        self.result = TrackedRoi(self.result.roi if roi is None else roi, quality, True, (reason,))
