"""States of a region, and the constants that decide them."""

from dataclasses import fields
from itertools import pairwise

import cv2
import numpy as np
import pytest

from labcdp.core.errors import InputError
from labcdp.core.roi import Roi
from labcdp.tracking import make_tracker
from labcdp.tracking.frame import GreyFrame
from labcdp.tracking.group import RegionGroup
from labcdp.tracking.region import State
from labcdp.tracking.settings import TrackingSettings

from .simulated import Cover, Moment, SimulatedVideo, pose, shift
from .test_following import SIZE, drive, near

#: Those that docs/concepts/tracking.md draws.
DRAWN = {("SEEN", "HIDDEN"), ("HIDDEN", "SEEN"), ("SEEN", "LOST"), ("HIDDEN", "LOST"), ("LOST", "SEEN"),
         ("LOST", "SIGHTED"), ("SIGHTED", "LOST"), ("SIGHTED", "SEEN"), ("LOST", "HIDDEN"),
         ("SIGHTED", "HIDDEN")}  # fmt: skip


@pytest.mark.parametrize(
    ("path", "seen"),
    [
        (lambda t: Moment(drive(t), covers=(Cover(200 - 25 * t, 0, 240, 160, 0.4),) if t < 13 else ()), {"LOST"}),
        (lambda t: Moment(drive(t), scene=int(8 <= t < 13)), {"LOST"}),
        (lambda t: Moment(pose(120, 80), covers=(Cover(86, 60, 3, 40, 0.9),) if t > 4 else ()), {"HIDDEN"}),
        (lambda t: Moment(drive(t), gain=float(not 8 <= t < 13)), {"HIDDEN"}),
    ],
    ids=["behind", "cut", "a strip", "black"],
)
def test_states_follow_each_other_as_drawn(path, seen):
    first, *frames = SimulatedVideo(path, 20, size=SIZE).frames()
    group = RegionGroup(first.grey, (0.0, np.nan, 0.0), first.rois, [False, False])
    (region, *_) = group._followers
    states = ["SEEN"]
    for frame in frames:
        group.update(frame.grey)
        states.append(region.state.name)
        assert (region.state is State.SEEN) == (not region.result.lost)
    assert {(a, b) for a, b in pairwise(states) if a != b} <= DRAWN
    assert seen <= set(states)


def walker(step, rng):
    """A figure whose arms and legs swing before a textured background, 2 pixels a frame to the right."""
    background = cv2.GaussianBlur(np.random.default_rng(5).normal(0, 60, (160, 320)), (0, 0), 4) + 110
    x, swing = 60 + 2 * step, 6 * np.sin(step / 3)
    for left, top, width, height, light in [
        (-14, 50, 28, 44, 190), (-7, 32, 14, 17, 150), (-18 + swing, 54, 7, 34, 70), (11 - swing, 54, 7, 34, 70),
        (-12 + swing, 94, 10, 40, 40), (2 - swing, 94, 10, 40, 40),
    ]:  # fmt: skip
        background[top : top + height, round(x + left) : round(x + left + width)] = light
    smooth = cv2.GaussianBlur(background, (0, 0), 0.8)
    return np.clip(smooth + rng.normal(0, 2, smooth.shape), 0, 255).astype(np.uint8)


def test_a_person_who_walks_is_followed_and_no_other_place_is_taken_for_her():
    rng = np.random.default_rng(2)
    jacket = Roi.rectangle("jacket", 48, 54, 24, 36)
    tracker = make_tracker("follow", walker(0, rng), [jacket])
    results = [tracker.update(walker(step, rng)) for step in range(1, 41)]
    right = [near(found, [jacket.moved(2 * step, 0)], 10) for step, found in enumerate(results, start=1)]
    seen = [not found.lost for (found,) in results]
    assert right == seen
    assert np.mean(seen) >= 0.5


def test_a_filter_sees_the_region_in_other_light_and_nothing_else_for_it():
    video = SimulatedVideo(lambda t: Moment(pose(120, 80), background=shift(-t, 0), gain=1 - 0.1 * t), 6, size=SIZE)
    first, *_, last = video.frames()
    group = RegionGroup(first.grey, (0.0, np.nan, 0.0), first.rois, [False, False])
    region = group._followers[0]
    correlation, here = region._appearance.filter, region._template.to_image
    frame = GreyFrame(last.grey, *group._levels)
    settings = TrackingSettings()
    assert correlation.respond(frame, here).first > settings.filter_again
    assert correlation.respond(frame, shift(-60, -50) @ here).first < settings.filter_agrees
    moved = correlation.locate(frame, shift(6, -5) @ here)
    assert np.abs(moved.to_image[:2, 2] - here[:2, 2]).max() < 1.5


def test_each_constant_has_meaning_origin_and_a_range_that_holds_its_value():
    for constant in fields(TrackingSettings):
        about = constant.metadata
        assert about["meaning"]
        assert about["origin"]
        assert about["least"] <= constant.default <= about["most"]
        with pytest.raises(InputError, match=f"tracking constant {constant.name} is"):
            TrackingSettings(**{constant.name: about["most"] + 1})
