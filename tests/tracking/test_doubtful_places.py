"""Coded videos, things that vanish or are covered in part, and places that look the same."""

from functools import cache

import numpy as np
import pytest

from labcdp.core.roi import Roi
from labcdp.tracking import make_tracker
from labcdp.tracking.pairs import Companions

from .simulated import Cover, Moment, SimulatedVideo, pose, shift

SIZE = (240, 160)


def box(name, x, y, width, height):
    return Roi(name, ((x, y), (x + width, y), (x + width, y + height), (x, y + height)))


def exposed(light, rng):
    return np.clip(np.rint(light + rng.normal(0, 1, light.shape) * 0.3 * np.sqrt(light)), 0, 255).astype(np.uint8)


def follow(frames, rois, method="follow"):
    tracker = make_tracker(method, frames[0], rois)
    return [tracker.update(frame) for frame in frames[1:]]


def coded(frames, path, kind):
    import cv2

    height, width = frames[0].shape
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter_fourcc(*kind), 25, (width, height))
    for frame in frames:
        writer.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
    writer.release()
    video = cv2.VideoCapture(str(path))
    read = [cv2.cvtColor(video.read()[1], cv2.COLOR_BGR2GRAY) for _ in frames]
    video.release()
    return read


@cache
def moving_scene(speed):
    """Frames with regions well inside their patches, where a coder leaves hardly any noise."""
    path = lambda t: Moment(pose(100 + speed * t, 80), background=shift(-speed * t / 2, 0))  # noqa: E731
    return list(SimulatedVideo(path, n_frames=12, size=SIZE, inset=5, full_scale_e=4000.0).frames())


@pytest.mark.parametrize("speed", [0, 1.5])
@pytest.mark.parametrize(("kind", "suffix"), [("mp4v", ".mp4"), ("MJPG", ".avi"), ("XVID", ".avi")])
def test_regions_are_followed_in_a_coded_video(kind, suffix, speed, tmp_path):
    truth = moving_scene(speed)
    frames = coded([frame.grey for frame in truth], tmp_path / f"video{suffix}", kind)

    for found, frame in zip(follow(frames, truth[0].rois), truth[1:], strict=True):
        for one, true in zip(found, frame.rois, strict=True):
            assert not one.lost
            assert one.roi.centre == pytest.approx(true.centre, abs=0.5)


WALL, BRIGHT, DARK = 70.0, 200.0, 10.0
ON_THE_WALL = [box("bright", 66, 37, 28, 36), box("dark", 106, 37, 28, 36)]


def wall(dark, rng, plain_cover=False):
    light = np.full((160, 240), WALL)
    light[130:] += 40 * np.sin(np.arange(240) / 5)
    light[30:80, 60:100] = BRIGHT
    light[30:80, 100:140] = dark
    if plain_cover:
        light[20:90, 100:170] = 120
    return exposed(light, rng)


@pytest.mark.parametrize("method", ["follow", "homography"])
@pytest.mark.parametrize("plain_cover", [False, True])
def test_what_vanishes_at_once_is_lost_although_an_edge_to_its_neighbour_stays(method, plain_cover):
    rng = np.random.default_rng(3)
    frames = [wall(DARK, rng) for _ in range(6)] + [wall(WALL, rng, plain_cover) for _ in range(6)]
    results = follow(frames, ON_THE_WALL, method)

    assert [one.lost for one in results[4]] == [False, False]
    for bright, dark in results[5:]:
        assert not bright.lost
        assert dark.lost
        assert dark.reasons


def test_what_fades_slowly_is_followed():
    rng = np.random.default_rng(4)
    frames = [wall(DARK + share * (WALL - DARK), rng) for share in np.linspace(0, 0.7, 36)]

    for found in follow(frames, ON_THE_WALL):
        for one, roi in zip(found, ON_THE_WALL, strict=True):
            assert not one.lost
            assert one.roi.centre == pytest.approx(roi.centre, abs=1.0)


@pytest.mark.parametrize("width", [3, 6])
def test_a_region_is_not_measured_with_a_narrow_strip_of_it_covered(width):
    # A tenth and a fifth of its 28 columns.
    cover = Cover(86, 60, width, 40, 0.9)
    path = lambda t: Moment(pose(120, 80), covers=(cover,) if t >= 4 else ())  # noqa: E731
    video = SimulatedVideo(path, n_frames=7, size=SIZE)
    frames = list(video.frames())
    results = follow([frame.grey for frame in frames], frames[0].rois)

    assert [one.lost for one in results[2]] == [False, False]
    for a, b in results[3:]:
        assert a.lost
        assert [one.code for one in a.reasons] == ["tracking-region-covered"]
        assert not b.lost


SQUARE = 16
BOARD = [box("a", 84, 64, 8, 8), box("b", 100, 64, 8, 8)]


def board(x, rng, covered=False):
    """A checkerboard of 10 x 8 squares, `x` pixels right of its first place."""
    v, u = np.mgrid[:128, :160] // SQUARE
    light = np.full((160, 320), 60.0)
    light[:, ::7] = 90
    light[12:140, 32 + x : 192 + x] = np.where((u + v) % 2, 110, 20)
    if covered:
        light[40:96, 60 + x : 140 + x] = 150
    return exposed(light, rng)


@pytest.mark.parametrize("method", ["follow", "homography"])
def test_squares_of_a_board_are_not_taken_for_each_other(method):
    rng = np.random.default_rng(6)
    right = (0, 7, 14, 21, 24, 21, 17, 13, 9, 5, 0)
    results = follow([board(x, rng) for x in right], BOARD, method)

    for x, found in zip(right[1:], results, strict=True):
        for one, roi in zip(found, BOARD, strict=True):
            assert not one.lost
            assert one.roi.centre == pytest.approx((roi.centre[0] + x, roi.centre[1]), abs=0.5)


def test_a_square_that_was_covered_is_not_taken_for_another_one():
    rng = np.random.default_rng(7)
    frames = [board(2 * number, rng, covered=4 <= number < 10) for number in range(18)]
    results = follow(frames, BOARD)

    assert not any(one.lost for one in results[2])
    assert all(one.lost for found in results[3:9] for one in found)
    for number, found in enumerate(results[9:], start=10):
        for one, roi in zip(found, BOARD, strict=True):
            assert one.lost or one.roi.centre == pytest.approx((roi.centre[0] + 2 * number, roi.centre[1]), abs=0.5)


def test_a_region_that_jumps_against_its_companion_is_named():
    companions = Companions()
    still = (0.0, 0.0)
    for _ in range(3):
        assert companions.jumped({0: (3.0, 1.0), 1: (3.2, 1.0)}, {0: still, 1: still}) == set()

    # Both jump alike, then only the second one.
    assert companions.jumped({0: (40.0, 0.0), 1: (40.5, 0.0)}, {0: still, 1: still}) == set()
    assert companions.jumped({0: (3.0, 1.0), 1: (25.0, 1.0)}, {0: still, 1: still}) == {1}
