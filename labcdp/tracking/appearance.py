"""How a region looks: in the first frame, and when it was last confirmed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import dist, inf, isfinite

import numpy as np

from .alignment import Aligner, Fit
from .correlation import CorrelationFilter, Response
from .frame import GreyFrame, view_around
from .geometry import Matrix, box_of, local_scale, moved, shape_change
from .level import GainOffset
from .search import candidates, look_at
from .settings import SETTINGS
from .template import Template


@dataclass(frozen=True, eq=False)
class Match:
    """A fit, by which look, how well the first look fits, and the filter's response if that found it instead."""

    fit: Fit
    aligner: Aligner
    first: float
    response: Response | None = None


#: Whether a region can have got where a fit puts it.
Possible = Callable[[Fit], bool]


class Appearance:
    """The looks of one region, and fits by them."""

    def __init__(self, frame: GreyFrame, template: Template, *, planar: bool) -> None:
        self.template = template
        self._aligner = Aligner(template, planar=planar)
        self.filter = CorrelationFilter(frame, template)
        self._frames = 0
        #: Whether the region itself looks otherwise where alignment with its surroundings puts it.
        self.doubted = False
        self._recent: Aligner | None = None
        #: Distance in pixels to the nearest other place in the first frame that looks the same; infinite: none.
        self.repeat_px = inf
        #: Usual quality of the first look.
        self.usual = 1.0
        self._anchored = True
        self._values = template.values
        self._chain = 0
        rows, columns = np.nonzero(template.trust == 1)
        # Box around the patch and its edge in template pixels.
        self._patch = float(columns.min()), float(rows.min()), float(columns.max() + 1), float(rows.max() + 1)
        first = look_at(frame, template.to_image, self._patch)
        self._glances = [] if first is None else [first]

    @property
    def centre(self) -> tuple[float, float]:
        """Middle of the template in its pixels."""
        height, width = self.template.shape
        return width / 2, height / 2

    def middle(self, to_image: Matrix) -> tuple[float, float]:
        """Middle of the region at a place."""
        return moved(to_image, self.centre)[0]

    def reach(self, to_image: Matrix) -> float:
        """Pixels around a place that are looked at."""
        size = max(self.template.shape) * local_scale(to_image, self.centre)
        return max(SETTINGS.reach_share * size, SETTINGS.reach_px)

    def aligned(self, frame: GreyFrame, position: Matrix, light: GainOffset, possible: Possible) -> Match | None:
        """Fit near a place by the first look, or if that is not good by the last one."""
        view = view_around(frame, self.template.shape, position, self.reach(position))
        if view is None:
            return None
        first = self._aligner.align(view, position, light)
        if first is not None and not possible(first):
            first = None
        like_first = 0.0 if first is None or first.covered > SETTINGS.covered_share else first.quality
        if self._recent is not None and like_first < SETTINGS.good_quality:
            fit = self._recent.align(view, position, light)
            like_now = 0.0 if fit is None or fit.covered > SETTINGS.covered_share or not possible(fit) else fit.quality
            if fit is not None and like_now > like_first + SETTINGS.newer_lead_quality:
                return Match(fit, self._recent, like_first)
        return None if first is None else Match(first, self._aligner, like_first)

    @property
    def changes(self) -> bool:
        """Whether the object changes its looks, as a face or a walking person does."""
        return self.usual < SETTINGS.changing_quality

    def by_filter(self, frame: GreyFrame, response: Response, light: GainOffset, aligned: float) -> Match | None:
        """Fit where the filter responded, which need not look as it did; `aligned` is the quality of the best fit."""
        view = view_around(frame, self.template.shape, response.to_image, self.reach(response.to_image))
        fit = None if view is None else self._aligner.align(view, response.to_image, light, improve=False)
        if fit is None:
            return None
        # The filter's position is not exact: edges of the region itself seem to differ there.
        covered = 0.0 if self.changes or fit.covered < SETTINGS.filter_covered_share else fit.covered
        fit = replace(fit, quality=min(response.recent, 1.0), covered=covered, light=light)
        return Match(fit, self._aligner, aligned, response)

    def candidates(self, frame: GreyFrame, to_image: Matrix) -> list[Matrix]:
        """Positions in the whole frame, of about the size at one, that look like the region at a glance."""
        scale = local_scale(to_image, self.centre)
        looks = [(look, scale / local_scale(look.to_image, self.centre)) for look in self._glances]
        return candidates(frame, looks, SETTINGS.search_aligned)

    def everywhere(self, frame: GreyFrame, to_image: Matrix, light: GainOffset, possible: Possible) -> list[Match]:
        """Fits in the whole frame, of about the size at a position."""
        match = (self.aligned(frame, position, light, possible) for position in self.candidates(frame, to_image))
        return [one for one in match if one is not None]

    def find_repeats(self, frame: GreyFrame, possible: Possible) -> None:
        """Find the nearest other place in the first frame that looks the same."""
        to_image = self.template.to_image
        left, top, right, bottom = box_of(to_image, self._patch[2] - self._patch[0], self._patch[3] - self._patch[1])
        apart_least, here = max(min(right - left, bottom - top) / 2, 4.0), self.middle(to_image)
        # Of a pattern many places look as much alike: the nearest one need not be among the best.
        positions = candidates(
            frame, [(look, 1.0) for look in self._glances], SETTINGS.repeats_aligned, SETTINGS.repeats_aligned
        )
        for position in sorted(positions, key=lambda one: dist(here, self.middle(one))):
            match = self.aligned(frame, position, (1.0, 0.0), possible)
            apart = 0.0 if match is None else dist(here, self.middle(match.fit.to_image))
            if match is not None and match.fit.quality >= SETTINGS.search_quality and apart > apart_least:
                self.repeat_px = apart
                return

    def off(self, fit: Fit, expected: Matrix) -> float:
        """Distance of a fit from the `expected` place over that to the next place that looks the same."""
        if not isfinite(self.repeat_px):
            return 0.0
        scale = local_scale(expected, self.centre) * self.template.reduction
        return dist(self.middle(fit.to_image), self.middle(expected)) / (scale * self.repeat_px)

    def better(self, expected: Matrix, best: Match | None, other: Match | None) -> Match | None:
        """Of two fits the better one, and of places that look the same the one nearer to the expected place."""
        if other is None or best is None:
            return best or other
        gained = self.off(best.fit, expected) - self.off(other.fit, expected)
        return other if other.fit.quality + gained > best.fit.quality else best

    def clear(self, match: list[Match]) -> Match | None:
        """Choose the best of places in the whole frame; None if another one is nearly as good."""
        ranked = sorted(match, key=lambda one: -one.fit.quality)
        if not ranked:
            return None
        best = ranked[0]
        middle, apart = self.middle(best.fit.to_image), self.reach(best.fit.to_image)
        for other in ranked[1:]:
            if dist(self.middle(other.fit.to_image), middle) > apart:
                return best if best.fit.quality - other.fit.quality >= SETTINGS.lead_quality else None
        return best

    def begin_again(self) -> None:
        """Learn nothing new until the first look is confirmed: the region was lost."""
        self._chain, self._anchored = 0, False

    def learn(self, frame: GreyFrame, match: Match) -> None:
        """Learn from what was found: what moves with the region, and how its look slowly changes."""
        fit = match.fit
        if fit.quality < SETTINGS.good_quality or self._frames % SETTINGS.filter_every_frames == 0:
            response = self.filter.learn(frame, fit.to_image)
            self.doubted = response is not None and response.inner < SETTINGS.filter_inner
        self._frames += 1
        if match.response is not None:
            self._chain = 0
            self.usual += (match.first - self.usual) / SETTINGS.usual_frames
            return
        gain, offset = fit.light
        values = (fit.values - np.float32(offset)) / np.float32(gain)
        sudden = self._aligner.changed(self._values, values)
        self._values = values
        self._chain = self._chain + 1 if sudden <= SETTINGS.sudden_share and fit.in_image == 1 else 0
        if fit.covered > SETTINGS.covered_share:
            return
        self._anchored = self._anchored or fit.quality >= SETTINGS.good_quality
        if not self._anchored:
            return
        if match.aligner is self._aligner:
            self.usual += (fit.quality - self.usual) / SETTINGS.usual_frames
            self._aligner.learn(fit)
        if fit.quality >= SETTINGS.good_quality and self._chain > 0:
            look = look_at(frame, fit.to_image, self._patch)
            if look is not None:
                self._glances = [*self._glances[:1], look]
        if match.first < SETTINGS.newer_below_quality and self._chain >= SETTINGS.newer_frames:
            self._recent = self._aligner.relooked(values)
            self._chain = 0


def shape_allows(template: Template, before: Matrix, fit: Fit, frames: int) -> bool:
    """Whether a region can have got from one place to that of a fit in some frames, in the image and of its shape."""
    if fit.in_image < SETTINGS.in_image_share:
        return False
    height, width = template.shape
    long, short, turned, tilted = shape_change(before, fit.to_image, template.to_centred, template.from_centred)
    size = (long * short) ** 0.5
    over_all = local_scale(fit.to_image, (width / 2, height / 2)) * template.reduction
    return (
        1 / SETTINGS.size_step**frames < size < SETTINGS.size_step**frames
        and long < SETTINGS.stretch_step**frames * short
        and abs(turned) < SETTINGS.turn_step_rad * frames
        and tilted < SETTINGS.tilt_step * frames
        and SETTINGS.size_least < over_all < SETTINGS.size_most
    )
