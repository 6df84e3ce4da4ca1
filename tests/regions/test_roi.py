"""The polygon everyone speaks: its pixels, area and moves."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labcdp.errors import InputError
from labcdp.roi import Roi

halves = st.integers(0, 60).map(lambda n: n / 2)
corners = st.lists(st.tuples(halves | st.floats(0, 30), halves | st.floats(0, 30)), min_size=3, max_size=12)


@settings(max_examples=200, deadline=None)
@given(corners)
def test_a_pixel_is_held_if_its_ray_crosses_an_odd_number_of_edges(corners):
    roi = Roi("any", tuple(corners))
    expected = np.zeros((30, 30), dtype=bool)
    for row, column in np.ndindex(expected.shape):
        x, y = column + 0.5, row + 0.5
        for (xa, ya), (xb, yb) in zip(corners, corners[1:] + corners[:1], strict=True):
            if (ya > y) != (yb > y) and x < xa + (y - ya) * (xb - xa) / (yb - ya):
                expected[row, column] ^= True
    if not expected.any():
        with pytest.raises(InputError, match=r"region 'any' holds no pixel: make it larger"):
            roi.mask((30, 30))
        return
    held = np.zeros_like(expected)
    held[roi.window((30, 30))] = roi.mask((30, 30))
    assert np.array_equal(held, expected)


def test_the_area_of_a_polygon_far_from_the_origin():
    assert Roi("t", ((1e6, 1e6), (1e6 + 3, 1e6), (1e6, 1e6 + 4))).area == 6


def test_moving_a_region_moves_its_pixels():
    image = np.arange(400.0).reshape(20, 20)
    roi = Roi("r", ((1, 1), (6, 2), (4, 7)))
    assert np.array_equal(roi.moved(3, 5).select(image), roi.select(image) + 5 * 20 + 3)


def test_an_affine_map_takes_the_corners_along():
    turned = Roi.rectangle("r", 0, 0, 2, 1).transformed([[0, -1, 10], [1, 0, 20]])
    assert turned.name == "r"
    assert turned.corners == ((10, 20), (10, 22), (9, 22), (9, 20))


def test_a_homography_divides_by_depth():
    seen = Roi.rectangle("r", 0, 0, 1, 1).transformed([[1, 0, 0], [0, 1, 0], [1, 0, 1]])
    assert seen.corners == ((0, 0), (0.5, 0), (0.5, 0.5), (0, 1))


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (np.eye(2), r"a map of the plane is a 2 x 3 or 3 x 3 matrix, got the shape \(2, 2\)"),
        ([[1, 0, 0], [0, 1, 0], [1, 0, -0.5]], r"region 'r' is taken to infinity"),
        ([[1, 0, 0], [0, 1, float("nan")]], r"region 'r' has a corner that is not a finite number"),
    ],
)
def test_a_map_that_leaves_no_region_is_refused(matrix, message):
    with pytest.raises(InputError, match=message):
        Roi.rectangle("r", 0, 0, 1, 1).transformed(matrix)
