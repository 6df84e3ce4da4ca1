"""Shapes as regions: which pixels they hold, and what is refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.core.roi import Roi
from labcdp.regions import EllipseShape, GridShape, PolygonShape, RectangleShape, inset, require_simple, rois_of

SHAPE = (100, 100)


def pixels(roi, shape=SHAPE):
    whole = np.zeros(shape, dtype=bool)
    whole[roi.window(shape)] = roi.mask(shape)
    return whole


def test_a_rectangle_holds_the_pixels_it_covers():
    (roi,) = RectangleShape("r", 10, 20, 5, 4).rois()
    held = np.argwhere(pixels(roi))
    assert held.min(axis=0).tolist() == [20, 10]
    assert held.max(axis=0).tolist() == [23, 14]
    assert len(held) == 20


def test_a_positive_angle_turns_clockwise_as_the_image_is_seen():
    (roi,) = RectangleShape("r", 0, 0, 10, 10, 45).rois()
    # The upper left corner goes to the top.
    assert roi.corners[0] == pytest.approx((5, 5 - 50**0.5))


@settings(max_examples=25, deadline=None)
@given(
    width=st.floats(1.5, 1000),
    height=st.floats(1.5, 1000),
    angle=st.floats(-180, 180),
    dx=st.floats(0, 1),
    dy=st.floats(0, 1),
)
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
    try:
        held = pixels(roi, (size, size))
    except InputError:
        held = np.zeros((size, size), dtype=bool)
    assert not (smaller & ~held).any()
    assert not (held & ~larger).any()


def test_a_grid_has_its_rectangles_row_by_row_with_gaps_between():
    rois = GridShape("board", 10, 20, 32, 20, rows=2, columns=3, gap=4).rois()
    assert [roi.name for roi in rois] == [f"board-r{r}c{c}" for r in (1, 2) for c in (1, 2, 3)]
    assert rois[0].bounds == (10, 20, 18, 28)
    assert rois[5].bounds == (34, 32, 42, 40)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: RectangleShape("r", 0, 0, 0, 4), r"region 'r': width is 0: give a number of pixels above 0"),
        (lambda: EllipseShape("e", 0, float("nan"), 3, 4), r"region 'e': y is nan: give a finite number"),
        (
            lambda: PolygonShape("p", ((0, 0), (1, 1))),
            r"region 'p': corners is \(\(0, 0\), \(1, 1\)\): give a list of 3",
        ),
        (
            lambda: PolygonShape(" p", ((0, 0), (1, 1), (1, 0))),
            r"the name of a region is ' p': give 1 to 100 printable characters",
        ),
        (lambda: GridShape("g", 0, 0, 10, 10, 0, 2), r"region 'g': rows is 0: give a whole number of at least 1"),
        (lambda: GridShape("g", 0, 0, 10, 10, 200, 200), r"200 rows of 200 columns are 40000 regions: give at most"),
        (lambda: GridShape("g", 0, 0, 10, 10, 2, 3, 5), r"gaps of 5 pixels leave nothing of 2 x 3 rectangles"),
        (lambda: GridShape("g", 0, 0, 10, 10, 2, 3, -1), r"region 'g': gap is -1: give at least 0"),
    ],
)
def test_a_shape_that_cannot_be_is_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_regions_need_names_of_their_own():
    with pytest.raises(InputError, match=r"2 regions have the name 'a': give each its own"):
        rois_of([RectangleShape("a", 0, 0, 2, 2), EllipseShape("a", 5, 5, 2, 2)])


def test_crossing_edges_are_reported_with_their_place():
    with pytest.raises(InputError, match=r"region 'x' crosses itself at x 5, y 5: give its corners in order"):
        require_simple(Roi("x", ((0, 0), (10, 10), (10, 0), (0, 10))))


@settings(max_examples=60, deadline=None)
@given(
    radii=st.lists(st.floats(5, 45), min_size=3, max_size=9),
    margin=st.floats(0, 6),
)
def test_what_is_left_keeps_the_margin_from_all_edges(radii, margin):
    angles = np.linspace(0, 2 * np.pi, len(radii), endpoint=False)
    roi = Roi("star", tuple((50 + r * np.cos(t), 50 + r * np.sin(t)) for r, t in zip(radii, angles, strict=True)))
    try:
        left = inset(roi, margin)
    except InputError:
        # Nothing is left, or several pieces.
        return
    assert left.name == "star"
    a, b = np.array(roi.corners), np.roll(roi.corners, -1, axis=0)
    for corner in left.corners:
        along = np.clip(((corner - a) * (b - a)).sum(1) / ((b - a) ** 2).sum(1), 0, 1)[:, None]
        assert np.hypot(*(a + along * (b - a) - corner).T).min() >= margin - 1e-6
