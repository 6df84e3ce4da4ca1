"""Which pixels shapes and polygons hold, what a margin leaves, which are the same; and what speaks against a region."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.core.result import warning
from labcdp.core.roi import Roi
from labcdp.regions import EllipseShape, RectangleShape, check_region, inset


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


ROI = Roi.rectangle("grey", 30, 30, 40, 40)


def noisy(**pixels):
    """Noise, of which a part is another value."""
    image = np.random.default_rng(5).normal(100.0, 2.0, (100, 100))
    for window, value in pixels.values():
        image[window] += value
    return image


@pytest.mark.parametrize(
    "make",
    [
        lambda rng: rng.normal(100, 5, (100, 100)),
        lambda rng: rng.poisson(0.5, (100, 100)),
        lambda rng: np.rint(rng.normal(100, 0.3, (100, 100))).astype(np.uint16),
    ],
    ids=["normal", "few photons", "whole numbers"],
)
def test_nothing_speaks_against_noise_alone(make):
    # 25 images: a check that is wrong once in a thousand times fails here in 2.5 % of all seeds.
    assert [check_region(make(np.random.default_rng(seed)), None, ROI) for seed in range(25)] == [()] * 25


SATURATED = np.zeros((100, 100), dtype=bool)
SATURATED[[*range(20), 30, 31, 32, 33]] = True
FAULTS = {
    "saturated": (noisy(), ROI, warning("region-saturated", "grey", share=0.1)),
    "few pixels": (noisy(), Roi.rectangle("dot", 30, 30, 6, 6),
                   warning("region-few-pixels", "dot", pixels=36, recommended=100)),
    "missing": (noisy(a=(np.s_[40:42], np.nan)), ROI,
                warning("region-missing-values", "grey", share=pytest.approx(0.05))),
    **{f"edge {n} px deep": (noisy(a=(np.s_[:, : 30 + n], -50)), ROI, warning("region-edge", "grey", margin_px=n))
       for n in (1, 2, 3)},
    **{f"{n} odd by {off}": (noisy(a=(np.s_[50, 50 : 50 + n], off)), ROI,
                             warning("region-odd-pixels", "grey", odd=n, pixels=1600, sigma=6.0))
       for n, off in ((1, 60), (3, 20), (1, 1000))},
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_what_speaks_against_a_region_is_the_only_finding(name):
    image, roi, expected = FAULTS[name]
    assert check_region(image, SATURATED if name == "saturated" else None, roi) == (expected,)


@pytest.mark.parametrize(("across", "down"), [(0.2, 0.0), (0.0, -0.2), (0.12, 0.12)])
def test_non_uniform_light(across, down):
    ramp = 1 + across * np.linspace(-0.5, 0.5, 100) + down * np.linspace(-0.5, 0.5, 100)[:, None]
    (found,) = check_region(ramp * noisy(), None, ROI)
    assert found.code == "region-uneven"
    # 40 of 100 pixels: 8 % across or down; of a diagonal 98 % are seen, and 4.8 % + 4.8 % made of it.
    assert found.values["share"] == pytest.approx(0.08 if 0 in (across, down) else 0.084, abs=0.008)
