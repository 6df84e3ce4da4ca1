import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.core.luminance import LuminanceMap
from labcdp.regions import EllipseShape, GridShape, PolygonShape, RectangleShape, Shape, rois_of
from labcdp.web.regions import shapes
from labcdp.web.regions.page_image import PageImage
from labcdp.web.regions.shapes import box_shape, handles, moved, propose, with_corner, with_handle, without_corner

SIZE = (100, 80)
TRIANGLE = PolygonShape("t", ((10, 10), (40, 10), (10, 40)))
SHAPES: list[Shape] = [
    TRIANGLE,
    RectangleShape("r", 10, 20, 30, 40),
    RectangleShape("turned", 30, 20, 30, 20, 30.0),
    EllipseShape("e", 10, 20, 30, 40),
    GridShape("g", 10, 20, 60, 40, 2, 3, 2),
]


def test_a_box_comes_from_any_two_opposite_corners_and_keeps_to_pixels() -> None:
    wanted = RectangleShape("r", 10, 20, 30, 40)
    assert box_shape("rectangle", "r", (10.2, 20.4), (40.3, 59.6), SIZE) == wanted
    assert box_shape("rectangle", "r", (40.3, 20.4), (10.2, 59.6), SIZE) == wanted
    assert box_shape("ellipse", "e", (-5, 100), (30, 20), SIZE) == EllipseShape("e", 0, 20, 30, 60)


@pytest.mark.parametrize("at", range(4))
@pytest.mark.parametrize("shape", SHAPES[1:], ids=lambda shape: shape.name)
def test_the_opposite_corner_of_a_box_stays_and_the_dragged_one_follows(shape: Shape, at: int) -> None:
    x, y = handles(shape)[at]
    to = (x + 4, y + 3) if at in (1, 2) else (x - 4, y - 3)
    changed = with_handle(shape, at, to, SIZE)
    assert handles(changed)[(at + 2) % 4] == pytest.approx(handles(shape)[(at + 2) % 4], abs=0.02)
    assert handles(changed)[at] == pytest.approx(to, abs=0.02)
    assert getattr(changed, "angle_deg", None) == getattr(shape, "angle_deg", None)


@given(
    shape=st.sampled_from(SHAPES),
    dx=st.floats(-300, 300, allow_nan=False),
    dy=st.floats(-300, 300, allow_nan=False),
)
def test_what_is_moved_keeps_its_form_and_stays_in_the_image(shape: Shape, dx: float, dy: float) -> None:
    after = moved(shape, (dx, dy), SIZE)
    for roi in after.rois():
        roi.window((SIZE[1], SIZE[0]))
    sides = [math.dist(a, b) for a, b in zip(handles(shape), handles(shape)[1:], strict=False)]
    assert [math.dist(a, b) for a, b in zip(handles(after), handles(after)[1:], strict=False)] == pytest.approx(
        sides, abs=0.05
    )


def test_polygons_get_and_lose_corners_and_boxes_are_turned_over() -> None:
    four = with_corner(TRIANGLE, 1, (40, 40), SIZE)
    assert four == PolygonShape("t", ((10, 10), (40, 10), (40, 40), (10, 40)))
    assert without_corner(four, 2) == TRIANGLE
    assert with_handle(SHAPES[1], 2, (4, 12), SIZE) == RectangleShape("r", 4, 12, 6, 8)


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (lambda: box_shape("rectangle", "r", (10, 20), (10.3, 50), SIZE), "holds no pixel"),
        (lambda: box_shape("star", "r", (10, 20), (50, 50), SIZE), "'star': give 'rectangle' or 'ellipse'"),
        (lambda: with_handle(SHAPES[1], 2, (10, 50), SIZE), "nothing would be left of region 'r'"),
        (lambda: without_corner(TRIANGLE, 0), "'t' has 3 corners left"),
        (lambda: with_corner(SHAPES[1], 0, (2, 2), SIZE), "'r' is no polygon"),
        (lambda: with_handle(TRIANGLE, 3, (1, 1), SIZE), "'t' has no corner 3: it has 3"),
        (lambda: with_handle(TRIANGLE, 1, (math.nan, 1), SIZE), "a coordinate is nan"),
    ],
)
def test_what_leaves_no_shape_is_refused(act: Callable[[], Shape], message: str) -> None:
    with pytest.raises(InputError, match=message):
        act()


def bayer(light: np.ndarray) -> PageImage:
    """Frame of a colour sensor whose map has a pixel for four."""
    none = np.zeros(light.shape, dtype=np.uint8)
    dn = light.repeat(2, axis=0).repeat(2, axis=1).astype(np.uint16)
    return PageImage("a", dn, True, "RG", LuminanceMap(light, np.zeros_like(light), 0.0, none, step=2), "relative")


def test_superpixels_of_a_colour_sensor_are_joined_and_in_pixels_of_the_image() -> None:
    light = np.random.default_rng(2).normal(100, 1, (60, 80)).astype(np.float32)
    light[:, 40:] *= 3
    found = propose(bayer(light), "superpixels", 20)
    # The edge is at 80; each half is one region, less a margin.
    assert len(found) == 2
    left, right = sorted(roi.bounds for roi in rois_of(found))
    assert left == pytest.approx((0, 0, 80, 120), abs=9)
    assert right == pytest.approx((80, 0, 160, 120), abs=9)
    assert left[2] < 80 < right[0]


def test_more_proposals_than_a_person_confirms_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    squares = np.random.default_rng(2).uniform(50, 500, (6, 8)).repeat(20, axis=0).repeat(20, axis=1)
    image = bayer(squares.astype(np.float32))
    n = len(propose(image, "superpixels", 20))
    assert 40 < n < 60
    monkeypatch.setattr(shapes, "MOST_PROPOSALS", 40)
    with pytest.raises(InputError, match=rf"{n} regions were found, .* limit of 40: give a larger size"):
        propose(image, "superpixels", 20)
