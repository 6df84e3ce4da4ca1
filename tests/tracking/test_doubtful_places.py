"""Things that vanish or are covered, and places that look the same."""

import cv2
import numpy as np
import pytest

from labcdp.core.roi import Roi

from .test_following import follow, near

WALL, BRIGHT, DARK = 70.0, 200.0, 10.0
ON_THE_WALL = [Roi.rectangle("bright", 66, 37, 28, 36), Roi.rectangle("dark", 106, 37, 28, 36)]


def exposed(light, rng):
    return np.clip(np.rint(light + rng.normal(0, 1, light.shape) * 0.3 * np.sqrt(light)), 0, 255).astype(np.uint8)


def wall(dark, rng, plain_cover=False):
    light = np.full((160, 240), WALL)
    light[130:] += 40 * np.sin(np.arange(240) / 5)
    light[30:80, 60:100] = BRIGHT
    light[30:80, 100:140] = dark
    if plain_cover:
        light[20:90, 100:170] = 120
    return exposed(light, rng)


@pytest.mark.parametrize(("method", "plain_cover"), [("follow", False), ("homography", True), ("follow", True)])
def test_what_vanishes_at_once_is_lost_although_an_edge_to_its_neighbour_stays(method, plain_cover):
    rng = np.random.default_rng(3)
    frames = [wall(DARK, rng) for _ in range(6)] + [wall(WALL, rng, plain_cover) for _ in range(6)]
    results = follow(frames, ON_THE_WALL, method)
    assert [one.lost for one in results[4]] == [False, False]
    for bright, dark in results[5:]:
        assert (bright.lost, dark.lost, bool(dark.reasons)) == (False, True, True)


def test_what_fades_slowly_is_followed():
    rng = np.random.default_rng(4)
    frames = [wall(DARK + share * (WALL - DARK), rng) for share in np.linspace(0, 0.7, 36)]
    assert all(near(found, ON_THE_WALL, 1.0) for found in follow(frames, ON_THE_WALL))


SQUARE = 16
BOARD = [Roi.rectangle("a", 84, 64, 8, 8), Roi.rectangle("b", 100, 64, 8, 8)]


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
    rng, right = np.random.default_rng(6), (0, 7, 14, 21, 24, 21, 17, 13, 9, 5, 0)
    results = follow([board(x, rng) for x in right], BOARD, method)
    for x, found in zip(right[1:], results, strict=True):
        assert near(found, [roi.moved(x, 0) for roi in BOARD], 0.5)


def test_a_square_that_may_be_another_one_is_lost():
    """A cover behind which the board moves by two squares; a jump by more than half the way to the next like it."""
    rng, right = np.random.default_rng(7), [*range(0, 8, 2), *range(40, 56, 2), 76]
    results = follow([board(x, rng, covered=4 <= number < 8) for number, x in enumerate(right)], BOARD)
    assert not any(one.lost for one in results[2])
    assert all(one.lost for found in results[3:7] for one in found)
    for x, found in zip(right[8:], results[7:], strict=True):
        assert all(one.lost or near([one], [roi.moved(x, 0)], 0.5) for one, roi in zip(found, BOARD, strict=True))
    results = follow([board(x, rng) for x in (0, 0, 20)], BOARD)
    assert not any(one.lost for one in results[0])
    assert all(one.lost for one in results[1])


def test_a_plain_part_of_the_scene_stays_there_and_is_lost_behind_what_passes():
    rng = np.random.default_rng(8)
    ground = cv2.GaussianBlur(rng.normal(0, 60, (300, 400)), (0, 0), 3) * 4 + 110
    ground[30:270, 40:320] = 150
    region, height = Roi.rectangle("wall", 160, 130, 40, 40), slice(100, 200)
    frames, hidden = [], []
    for number in range(28):
        light, left = ground.copy(), 20 + 14 * number
        light[height, left : left + 90] = 60
        frames.append(exposed(light[:, number : number + 320].clip(0, 255), rng))
        hidden.append(min(left + 90, 200) - max(left, 160))
    for number, ((found,), common) in enumerate(zip(follow(frames, [region]), hidden[1:], strict=True), start=1):
        if common > 2 or common < -10:
            assert found.lost == (common > 0)
        assert found.lost or near([found], [region.moved(-number, 0)], 0.5)
