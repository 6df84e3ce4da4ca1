"""What every method promises: input, results, the same each time."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.core.roi import Roi
from labcdp.tracking import METHODS, make_tracker, methods_of

from .simulated import Moment, SimulatedVideo, pose


@pytest.fixture(scope="module")
def video():
    return list(SimulatedVideo(lambda t: Moment(pose(90 + 2.5 * t, 70 + t, 1 + 0.01 * t)), 6, size=(240, 160)).frames())


def scene(shape=(120, 160), seed=1):
    noise = np.random.default_rng(seed).standard_normal(shape).astype(np.float32)
    return cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 3), None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


@pytest.mark.parametrize("method", METHODS)
def test_regions_are_carried_with_their_target_and_alike_each_time(method, video):
    results = []
    for seed in (1, 2):
        cv2.setRNGSeed(seed)
        tracker = make_tracker(method, video[0].grey, video[0].rois)
        results.append([tracker.update(frame.grey) for frame in video])
    assert results[0] == results[1]
    for found, frame in zip(results[0], video, strict=True):
        for one, first, truth in zip(found, video[0].rois, frame.rois, strict=True):
            assert (one.roi.name, one.lost) == (truth.name, False)
            expected = first if method == "fixed" else truth
            assert np.abs(np.subtract(one.roi.corners, expected.corners)).max() < 0.5
    # A fixed region tells what has changed.
    assert all((one.quality < 0.9) == (method == "fixed") for one in results[0][-1])


def test_each_region_may_have_a_method_of_its_own(video):
    tracker = make_tracker("follow,b=fixed", video[0].grey, video[0].rois)
    a, b = [tracker.update(frame.grey) for frame in video][-1]
    assert a.roi.centre == pytest.approx(video[-1].rois[0].centre, abs=0.5)
    assert b.roi == video[0].rois[1]
    assert methods_of("b=homography", "ab") == ("follow", "homography")
    for method in ("kcf", "", "fixed,follow", "a=flow", "c=fixed"):
        with pytest.raises(InputError):
            methods_of(method, "ab")


def test_a_region_without_structure_around_it_is_refused():
    constant = np.full((120, 160), 90, np.uint8)
    only_a_line = constant + np.where(np.arange(160) < 80, 0, 60).astype(np.uint8)
    noise = np.clip(np.random.default_rng(1).normal(90, 5, (120, 160)), 0, 255).astype(np.uint8)
    # The last one is black but for its noise.
    for image in (constant, only_a_line, noise, noise[:6], noise[:1], (noise > 98).astype(np.uint8)):
        middle = Roi.rectangle("sign", 70, (len(image) - 1) * 5 // 12, 20, -(-len(image) // 6))
        with pytest.raises(InputError, match=r"region 'sign' cannot be followed: neither it and its surroundings nor"):
            make_tracker("follow", image, [middle])


@pytest.mark.parametrize(
    ("method", "corner_and_size"),
    [("follow", (60, 40, 4, 4)), ("homography", (0, 0, 30, 20)), ("follow", (130, 90, 30, 30)),
     ("homography", (5, 20, 150, 60)), ("follow", (20, 20, 100, 6))],
    ids=["tiny", "upper left", "lower right", "half the image", "narrow"],
)  # fmt: skip
def test_odd_regions_are_followed(method, corner_and_size):
    big = scene((160, 200), seed=4)
    windows = [np.ascontiguousarray(big[20 - step : 140 - step, 20 - step : 180 - step]) for step in range(4)]
    roi = Roi.rectangle("odd", *corner_and_size)
    tracker = make_tracker(method, windows[0], [roi])
    # The window moves up and left over the scene, so the region moves down and right; those at the end go out.
    x, y = roi.corners[0]
    for step in (1, 2, 3):
        (found,) = tracker.update(windows[step])
        if max(roi.bounds[2] + step - 160, roi.bounds[3] + step - 120) > 0:
            assert found.lost
            assert [one.code for one in found.reasons] == ["tracking-region-at-border"]
        else:
            assert not found.lost
            assert found.roi.corners[0] == pytest.approx((x + step, y + step), abs=0.3)


@settings(max_examples=6)
@given(
    x=st.floats(0, 100), y=st.floats(0, 60), width=st.floats(1, 60), height=st.floats(1, 60), seed=st.integers(0, 999)
)
def test_what_is_returned_lies_in_the_image(x, y, width, height, seed):
    try:
        tracker = make_tracker("follow", scene(seed=1), [Roi.rectangle("any", x, y, width, height)])
    except InputError:
        return
    for number in range(3):
        (found,) = tracker.update(scene(seed=seed + number))
        left, top, right, bottom = found.roi.bounds
        assert 0 <= left < right <= 160
        assert 0 <= top < bottom <= 120
        assert 0 <= found.quality <= 1
        assert bool(found.reasons) == found.lost
