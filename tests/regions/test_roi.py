"""The polygon everyone speaks: its pixels, area and moves."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.core.roi import Roi

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


def test_moving_a_region_moves_its_pixels():
    image = np.arange(400.0).reshape(20, 20)
    roi = Roi("r", ((1, 1), (6, 2), (4, 7)))
    assert np.array_equal(roi.moved(3, 5).select(image), roi.select(image) + 5 * 20 + 3)
