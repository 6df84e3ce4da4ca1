"""Accuracy under what happens on the road, and that a loss is noticed."""

from math import sin

import numpy as np
import pytest

from labcdp.metrics import cdp
from labcdp.tracking import make_tracker

from .simulated import Cover, Moment, SimulatedVideo, pose, shift

SIZE = (240, 160)


def drive(t):
    return pose(100 + 1.5 * t + 2 * sin(t), 75 + 2 * sin(t / 3), 1 + 0.01 * t)


FOLLOWED = {
    "shift": lambda t: Moment(pose(90 + 25 * sin(t / 4), 75 + 5 * sin(t / 3)), background=shift(-t, 0)),
    "scale": lambda t: Moment(pose(110, 80, 1 + 0.03 * t)),
    "light": lambda t: Moment(drive(t), gain=0.3 if 6 <= t < 14 else 1, veil=0.08 * sin(t / 5) ** 2),
    "partly covered": lambda t: Moment(drive(t), covers=(Cover(35 + 3 * t, 95, 150, 40, 0.5),)),
}


@pytest.mark.parametrize("disturbance", FOLLOWED)
def test_place_and_cdp_are_right(disturbance):
    close, right, n = 0, 0, 0
    tracker = None
    for frame in SimulatedVideo(FOLLOWED[disturbance], n_frames=21, size=SIZE, full_scale_e=1000.0).frames():
        if tracker is None:
            tracker = make_tracker("follow", frame.grey, frame.rois)
            continue
        found = tracker.update(frame.grey)
        near = [np.hypot(*np.subtract(a.roi.centre, b.centre)) < 2 for a, b in zip(found, frame.rois, strict=True)]
        close += all(near) and not any(one.lost for one in found)
        true = cdp(*(roi.select(frame.grey) for roi in frame.rois), 1.0)
        here = cdp(*(one.roi.select(frame.grey) for one in found), 1.0)
        low, high = here.interval
        right += low <= true.cdp <= high
        n += 1

    assert close >= 0.95 * n
    assert right >= 0.9 * n


def test_the_homography_follows_a_target_that_tilts():
    path = lambda t: Moment(pose(120, 80, 1 + 0.01 * t, 0.01 * t, (0.0003 * t, -0.0002 * t)))  # noqa: E731
    frames = list(SimulatedVideo(path, n_frames=16, size=SIZE).frames())
    tracker = make_tracker("homography", frames[0].grey, frames[0].rois)
    for frame in frames[1:]:
        found = tracker.update(frame.grey)

    for one, true in zip(found, frames[-1].rois, strict=True):
        assert not one.lost
        assert np.abs(np.subtract(one.roi.corners, true.corners)).max() < 0.6


LOST = {
    "covered": (lambda t: Moment(drive(t), covers=(Cover(0, 0, 240, 160, 0.4),) if 8 <= t < 13 else ()), 8),
    "behind": (lambda t: Moment(drive(t), covers=(Cover(200 - 25 * t, 0, 240, 160, 0.4),) if t < 13 else ()), 8),
    "cut": (lambda t: Moment(drive(t), scene=int(8 <= t < 13)), 8),
    "black": (lambda t: Moment(drive(t), gain=0.0 if 8 <= t < 13 else 1.0), 8),
}


@pytest.mark.parametrize("method", ["follow", "homography"])
@pytest.mark.parametrize("event", LOST)
def test_a_loss_is_noticed_and_the_target_found_again(event, method):
    path, start = LOST[event]
    frames = list(SimulatedVideo(path, n_frames=20, size=SIZE).frames())
    tracker = make_tracker(method, frames[0].grey, frames[0].rois)
    results = [tracker.update(frame.grey) for frame in frames[1:]]

    for one in results[start + 3]:
        assert one.lost
        assert one.reasons
    for one, true in zip(results[-1], frames[-1].rois, strict=True):
        assert not one.lost
        assert one.roi.centre == pytest.approx(true.centre, abs=0.5)


def test_a_region_that_leaves_the_image_is_lost_and_stays_where_it_was():
    frames = list(SimulatedVideo(lambda t: Moment(pose(130 + 12 * t, 80)), n_frames=12, size=SIZE).frames())
    tracker = make_tracker("follow", frames[0].grey, frames[0].rois)
    for frame in frames[1:]:
        found = tracker.update(frame.grey)
        for one, true in zip(found, frame.rois, strict=True):
            assert one.lost == (true.bounds[2] > SIZE[0])

    assert all(one.lost and one.roi.bounds[2] <= SIZE[0] for one in found)


def test_a_region_that_is_covered_in_itself_is_not_measured():
    # A narrow bar lies over the region, and leaves the edges around it to be seen.
    path = lambda t: Moment(pose(120, 80), covers=(Cover(85, 60, 18, 40, 0.1),) if t >= 5 else ())  # noqa: E731
    frames = list(SimulatedVideo(path, n_frames=8, size=SIZE).frames())
    tracker = make_tracker("follow", frames[0].grey, frames[0].rois)
    results = [tracker.update(frame.grey) for frame in frames[1:]]

    assert [one.lost for one in results[3]] == [False, False]
    a, b = results[-1]
    assert a.lost
    assert not b.lost
