"""Things that vanish or are covered, and places that look the same."""

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


@pytest.mark.parametrize("method", ["follow", "homography"])
@pytest.mark.parametrize("plain_cover", [False, True])
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


def test_a_square_that_was_covered_is_not_taken_for_another_one():
    rng = np.random.default_rng(7)
    results = follow([board(2 * number, rng, covered=4 <= number < 10) for number in range(18)], BOARD)
    assert not any(one.lost for one in results[2])
    assert all(one.lost for found in results[3:9] for one in found)
    for number, found in enumerate(results[9:], start=10):
        assert all(one.lost or near([one], [roi.moved(2 * number, 0)], 0.5)
                   for one, roi in zip(found, BOARD, strict=True))  # fmt: skip
