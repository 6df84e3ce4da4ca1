"""Shapes and polygons as regions: which pixels they hold, what a margin leaves, and which are the same."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.core.roi import Roi
from labcdp.regions import EllipseShape, RectangleShape, inset


def pixels(roi, shape):
    """Pixels that a region holds; none, where it is refused for that."""
    whole = np.zeros(shape, dtype=bool)
    try:
        whole[roi.window(shape)] = roi.mask(shape)
    except InputError as error:
        assert "holds no pixel: make it larger" in str(error)  # noqa: PT017 - that it may hold none is the point
    return whole


halves = st.integers(0, 60).map(lambda n: n / 2)


@settings(max_examples=50)
@given(st.lists(st.tuples(halves | st.floats(0, 30), halves | st.floats(0, 30)), min_size=3, max_size=12))
def test_a_pixel_is_held_if_its_ray_crosses_an_odd_number_of_edges(corners):
    y, x = np.mgrid[:30, :30] + 0.5
    expected = np.zeros((30, 30), dtype=bool)
    for (xa, ya), (xb, yb) in zip(corners, corners[1:] + corners[:1], strict=True):
        rows = (ya > y[:, 0]) != (yb > y[:, 0])
        expected[rows] ^= x[rows] < xa + (y[rows] - ya) * (xb - xa) / (yb - ya)
    assert np.array_equal(pixels(Roi("any", tuple(corners)), (30, 30)), expected)


def test_a_positive_angle_turns_clockwise_as_the_image_is_seen():
    (roi,) = RectangleShape("r", 0, 0, 10, 10, 45).rois()
    # The upper left corner goes to the top.
    assert roi.corners[0] == pytest.approx((5, 5 - 50**0.5))


sides, shifts = st.floats(1.5, 1000), st.floats(0, 1)


@settings(max_examples=25)
@given(width=sides, height=sides, angle=st.floats(-180, 180), dx=shifts, dy=shifts)
def test_an_ellipse_holds_the_pixels_whose_centres_are_within_it(width, height, angle, dx, dy):
    size = int(np.hypot(width, height)) + 4
    x0, y0 = (size - width) / 2 + dx, (size - height) / 2 + dy
    (roi,) = EllipseShape("e", x0, y0, width, height, angle).rois()
    y, x = np.ogrid[:size, :size]
    t = np.radians(angle)
    x, y = x + 0.5 - x0 - width / 2, y + 0.5 - y0 - height / 2
    u, v = x * np.cos(t) + y * np.sin(t), y * np.cos(t) - x * np.sin(t)
    # An ellipse that is 0.02 pixels smaller on each side holds no pixel more, one that is larger none less.
    smaller, larger = ((u / (width / 2 + d)) ** 2 + (v / (height / 2 + d)) ** 2 <= 1 for d in (-0.02, 0.02))
    held = pixels(roi, (size, size))
    assert not (smaller & ~held).any()
    assert not (held & ~larger).any()


@settings(max_examples=40)
@given(radii=st.lists(st.floats(5, 45), min_size=3, max_size=9), margin=st.floats(0, 6))
def test_what_is_left_keeps_the_margin_from_all_edges(radii, margin):
    angles = np.linspace(0, 2 * np.pi, len(radii), endpoint=False)
    roi = Roi("star", tuple((50 + r * np.cos(t), 50 + r * np.sin(t)) for r, t in zip(radii, angles, strict=True)))
    try:
        left = inset(roi, margin)
    except InputError:
        # Nothing is left, or several pieces.
        return
    a, b = np.array(roi.corners), np.roll(roi.corners, -1, axis=0)
    for corner in left.corners:
        along = np.clip(((corner - a) * (b - a)).sum(1) / ((b - a) ** 2).sum(1), 0, 1)[:, None]
        assert np.hypot(*(a + along * (b - a) - corner).T).min() >= margin - 1e-6
